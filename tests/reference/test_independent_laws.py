"""Every friction law moves the end-effector as an independent simulator has it: load, tilt, fall time, feedback.

Required of the default accuracy are 1e-3 um and 1e-4 N; what differs more would be another law.
"""

import dataclasses
import importlib
from functools import cache
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parts import Sawtooth, SecondOrder

from pdssjax import Accuracy, Actuator, Effector, simulate as simulated
from pdssjax.core import member, members
from pdssjax.integration import TIGHT
from tests.reference.independent import Rig, simulate
from tests.reference.independent_friction import Law
from tests.reference.laws.coulomb import Coulomb

SAMPLES = 150
DEFAULT, FINE = Accuracy(), Accuracy(1e-12, 1e-13)
ASIDE = {"anisotropic-lugre": "`test_independent` has it, in both readings"}
"""Laws that are not simulated here, and why."""
FOUND = sorted(path.stem.replace("_", "-") for path in (Path(__file__).parent / "laws").glob("*.py"))
"""The laws that have a simulator, found by its file."""
SIMULATED = [name for name in FOUND if name not in ASIDE]


def cases(name: str) -> dict[str, Law]:
    """The cases of a law, by what is special of each."""
    return importlib.import_module(f"tests.reference.laws.{name.replace('-', '_')}").CASES


LAWS = {f"{name}, {kind}".rstrip(", "): (name, law) for name in SIMULATED for kind, law in cases(name).items()}
QUICK = {"coulomb": ("20 Hz, ideal", "20 Hz, fall time, backward, downhill")}
"""Rigs that take less than a few seconds, by law; of others it is the first, if any."""
RIGS: dict[str, dict[str, Any]] = {
    "20 Hz, ideal": dict(cycle=0.05),
    "20 Hz, fall time, backward, downhill": dict(cycle=0.05, fall=8e-4, forward=False, load=-0.1),
    "20 Hz, fall time, tilted": dict(cycle=0.05, fall=8e-4, tilt=0.1),
    "5 Hz, ideal, backward": dict(cycle=0.2, forward=False),
    "20 Hz, feedback, fall time": dict(cycle=0.05, fall=8e-4, feedback=True),
    "20 Hz, feedback, backward, tilted": dict(cycle=0.05, forward=False, tilt=-0.05, feedback=True),
}


def marks(law, rig):
    return () if rig in QUICK.get(law, ()) else pytest.mark.slow


CASES = [pytest.param(law, rig, marks=marks(law, rig), id=f"{law}: {rig}") for law in LAWS for rig in RIGS]


@cache
def compiled(name: str, feedback: bool):
    """The package's run of a law as a function of the law, the other numbers, and the times."""

    def run(friction, numbers, times, tolerance, settle_tolerance):
        gain, frequency, damping, stack, *effector = numbers[:7]
        actuator = Actuator(SecondOrder(gain, frequency, damping, stack), friction, Effector(*effector), feedback)
        return simulated(actuator, Sawtooth(*numbers[7:]), times, Accuracy(tolerance, settle_tolerance))

    return jax.jit(run)


def packaged(rig: Rig, name: str, times, accuracy: Accuracy = DEFAULT):
    numbers: list[float] = [rig.gain, rig.frequency, rig.damping, rig.stack, rig.mass, rig.load, rig.tilt]
    numbers += [rig.voltage, 1.0 / rig.cycle, rig.fall, 1.0 if rig.forward else -1.0]
    friction = member("friction", name)(**{key: jnp.asarray(x) for key, x in dataclasses.asdict(rig.law).items()})
    return compiled(name, rig.feedback)(
        friction, np.array(numbers), times, accuracy.tolerance, accuracy.settle_tolerance
    )


def moments(rig: Rig) -> np.ndarray:
    """Three cycles at 20 Hz, two at 5 Hz: half of the samples while it slips; none at a corner of the drive."""
    cycles = 3 if rig.cycle < 0.1 else 2
    each = SAMPLES // cycles
    slow = rig.cycle * (np.arange(each // 2) + 0.61) / (each // 2)
    fast = 1.3e-5 + 0.012 * np.arange(each - each // 2) / (each - each // 2)
    cycle = np.sort(np.concatenate([slow[slow < rig.cycle], fast]))
    return np.sort(np.concatenate([k * rig.cycle + cycle for k in range(cycles)]))


def test_every_law_has_a_simulator():
    assert set(members("friction")) == set(FOUND)
    assert set(ASIDE) <= set(FOUND)


@pytest.mark.parametrize(("law", "rig"), CASES)
def test_the_end_effector_walks_as_the_independent_simulator_has_it(law, rig):
    """The required tolerances; what the default accuracy reaches is 5e-10 m at the worst, mostly below 1e-10 m."""
    name, contact = LAWS[law]
    given = Rig(law=contact, **RIGS[rig])
    times = moments(given)
    expected = simulate(given, times, longest=2e-5)
    run = packaged(given, name, times, FINE if contact.undamped else DEFAULT)
    assert int(run.failure) == 0
    np.testing.assert_allclose(run.platform, expected[:, 0], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(run.effector, expected[:, 1], rtol=0.0, atol=1e-9)
    # Where the force jumps, a sample may fall between the two instants of one jump.
    aside = np.abs(np.asarray(run.friction) - expected[:, 2]) > 1e-4
    assert aside.sum() <= 1
    assert np.abs(expected[-1, 1]) > 1e-7


@pytest.mark.slow
def test_feedback_fades_as_one_over_the_mass_of_the_platform():
    """The coupled model (5.25), whose stiffness k = m_g w^2 grows with m_g, tends to the simplified one (5.27)."""
    rig = Rig(law=Coulomb(), cycle=0.05, fall=8e-4)
    times = moments(rig)
    alone = packaged(rig, "coulomb", times, TIGHT)
    away = []
    for stack in (1e2, 1e3, 1e4):
        coupled = packaged(dataclasses.replace(rig, feedback=True, stack=stack), "coulomb", times, TIGHT)
        moved = (coupled.platform - alone.platform, coupled.effector - alone.effector)
        away.append([float(jnp.abs(x).max()) for x in moved])
    away = np.array(away)
    assert (away[0] > 1e-10).all()
    np.testing.assert_allclose(away[0] / away[1], 10.0, rtol=0.02)
    np.testing.assert_allclose(away[1] / away[2], 10.0, rtol=0.02)
