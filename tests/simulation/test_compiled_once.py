"""`simulate` compiles once for all numbers, is differentiable by every leaf, and moves as `integrate` has it."""

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parts import Coulomb, Sawtooth, SecondOrder, Step

import pdssjax
from pdssjax import Accuracy, Actuator, Effector, InputError, Taylor
from pdssjax.core import member, members
from pdssjax.integration import integrate
from pdssjax.simulation import StickSlip, trajectory

TIMES = np.linspace(0.0, 5e-3, 6)
"""[s]"""


def rig(mass=0.086):
    return Actuator(SecondOrder(), Coulomb(), Effector(mass))


def drive(voltage=64.0):
    return Sawtooth(voltage=voltage, frequency=400.0)


@pytest.fixture
def traced(monkeypatch):
    """Grows whenever the body of `simulate` is traced, which it does before it is compiled."""
    counted, made = [], trajectory.StickSlip

    def counting(*args):
        counted.append(args)
        return made(*args)

    monkeypatch.setattr(trajectory, "StickSlip", counting)
    return counted


def test_one_compilation_serves_all_numbers(traced):
    # As many times as in no other test.
    times, ends = np.linspace(0.0, 5e-3, 9), []
    for k, mass in enumerate((0.08, np.float32(0.09), jnp.asarray(0.1), np.array(0.11), 0.12)):
        ends.append(pdssjax.simulate(rig(mass), drive(60 + k), times + 1e-5 * k).effector[-1])
    lighter = eqx.tree_at(lambda actuator: actuator.effector.mass, rig(), 0.07)
    ends.append(pdssjax.simulate(lighter, drive(), jnp.asarray(times), Accuracy()).effector[-1])
    assert len(traced) == 1 and len(np.unique(ends)) == 6
    np.testing.assert_array_equal(ends[-1], pdssjax.simulate(rig(0.07), drive(), list(times)).effector[-1])
    assert len(traced) == 1


LAWS = [pytest.param(name, marks=[] if name == "coulomb" else pytest.mark.slow) for name in members("friction")]


@pytest.mark.parametrize("name", LAWS)
def test_gradients_are_right_in_every_leaf(name):
    # Off the nominal numbers, at which the motion of no law reverses within rounding of a sample.
    actuator = Actuator(SecondOrder(), member("friction", name)(), Effector(0.08, 0.01, 0.02))
    accuracy = Accuracy(method=Taylor(8)) if name == "coulomb" else Accuracy()
    # Compiled, so that a viscous friction of 0 may be varied both ways: given as a number, less is refused.
    loss = eqx.filter_jit(lambda actuator: 1e6 * jnp.sum(pdssjax.simulate(actuator, drive(), TIMES, accuracy).effector))
    leaves, structure = jax.tree.flatten(actuator)
    gradient = jax.tree.leaves(eqx.filter_grad(loss)(actuator))
    assert len(gradient) == len(leaves)
    for i, (leaf, slope) in enumerate(zip(leaves, gradient, strict=True)):
        step = 1e-5 * (abs(leaf) or 1.0)
        moved = lambda by: jax.tree.unflatten(structure, [*leaves[:i], jnp.asarray(leaves[i] + by), *leaves[i + 1 :]])  # noqa: B023
        near, far = ((loss(moved(k * step)) - loss(moved(-k * step))) / (2 * k * step) for k in (1, 2))
        np.testing.assert_allclose(slope * step, (4 * near - far) / 3 * step, rtol=1e-4, atol=1e-8)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: pdssjax.simulate(drive(), rig(), TIMES), r"actuator: found Sawtooth\(.*, expected an Actuator\."),
        (
            lambda: pdssjax.simulate(rig(), 64.0, TIMES),
            r"drive: found 64.0, expected an AbstractDrive, as pdssjax.drive",
        ),
        (lambda: pdssjax.simulate(rig(), drive(), 0.1), r"times: found the shape \(\), expected one dimension"),
        (lambda: pdssjax.simulate(rig(), drive(), TIMES[None]), r"times: found the shape \(1, 6\), expected one dim"),
        (lambda: pdssjax.simulate(rig(), drive(), TIMES[::-1]), r"times: found 0.004 s after 0.005 s at index 1"),
        (lambda: pdssjax.simulate(rig(), drive(np.ones(3)), TIMES), r"drive.voltage: found an array of shape \(3,\)"),
        (lambda: pdssjax.simulate(rig(), drive(), TIMES, 1e-9), r"accuracy: found 1e-09, expected an Accuracy\."),
        (lambda: pdssjax.simulate(rig(), drive(), TIMES, cycles=3), r'cycles: found 3, expected "steady", or None'),
        (
            lambda: pdssjax.simulate(rig(), Step(), TIMES, cycles="steady"),
            r"drive: found Step\(.*expected one that rep",
        ),
        (lambda: pdssjax.steady_cycle(drive(), rig()), r"actuator: found Sawtooth\(.*, expected an Actuator\."),
        (lambda: pdssjax.steady_cycle(rig(), drive(np.ones(3))), r"drive.voltage: found an array of shape \(3,\)"),
        (lambda: Accuracy(method=diffrax.Kvaerno5()), r"Accuracy.method: found Kvaerno5\(\), expected a step method"),
    ],
)
def test_wrong_arguments_are_refused_by_name(call, says):
    with pytest.raises(pdssjax.InputError, match=says):
        call()


def rig_and_drive(mass=0.086):
    return Actuator(SecondOrder(), Coulomb(), Effector(mass)), Sawtooth(voltage=64.0, frequency=400.0)


def test_the_actuator_moves_as_simulate_has_it_and_its_events_move_with_the_mass():
    usual = pdssjax.simulate(*rig_and_drive(), TIMES, Accuracy(tolerance=1e-14, method=Taylor(8)))

    def first_events(mass):
        run = integrate(StickSlip(*rig_and_drive(mass)), 0.0, 5e-3, saveat=TIMES, method=Taylor(8), atol=1e-14)
        return run.events.ts[:3], run

    mass, step = jnp.asarray(0.086), 1e-5
    moved = jax.jit(lambda mass: jax.jvp(first_events, (mass,), (jnp.ones(()),), has_aux=True))
    _, slopes, run = moved(mass)
    np.testing.assert_allclose(run.ys.v, usual.platform_velocity - usual.effector_velocity, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(run.ys.d, usual.platform - usual.effector, rtol=0.0, atol=1e-13)
    assert int(run.events.count) == int(usual.events) > 3
    assert int(run.result) == 0 and run.stats["steps"] > 0
    above, below = (moved(mass + way * step)[0] for way in (1.0, -1.0))
    np.testing.assert_allclose(slopes, (above - below) / (2.0 * step), rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"t0": 1.0, "t1": 2.0}, "found `t0` = 1.0, expected 0 for an AbstractHybridSystem"),
        ({"y0": (0.0, 0.0)}, "found `y0` of the structure .* expected that of the system"),
        ({"args": {}}, "found `args` for an AbstractHybridSystem"),
        ({"mode": 1}, "found `mode` for"),
        ({"atol": (1e-12, 1e-12)}, "found `atol` for .* a displacement"),
        ({"saveat": [6e-3]}, "in `saveat`, expected times from 0 to 0.005"),
    ],
)
def test_what_such_a_system_knows_itself_is_refused(change, says):
    with pytest.raises(InputError, match=says):
        integrate(**({"system": StickSlip(*rig_and_drive()), "t0": 0.0, "t1": 5e-3} | change))
