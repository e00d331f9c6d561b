"""Derivatives and values are right for actuators drawn at random, of every structure.

Required at the default accuracy: values within 1e-4 um (1e-4 N) of the tightest; every column that the record
shows within 1e-3 of central differences, or a discontinuity that the differences show, too; forward and reverse mode
alike.  The quick version has few actuators of the published structure; `experiments.map_of_rightness` has many.
"""

from collections.abc import Iterable, Iterator

import jax
import numpy as np
import pytest

from experiments.actuator_structure import Structure
from experiments.derivative_judge import VALUES, Judge, Verdict
from experiments.map_of_rightness import drawn, wrongs
from experiments.random_actuators import PUBLISHED, STRUCTURES
from pdssjax.drive.sawtooth import Sawtooth

QUICK = {"deflection, backward, 5 Hz": 6}
MANY = 3

ONCE_WRONG = {
    "force, forward, 5 Hz": (131, 176),
    "reset-integrator": (137,),
    "composed:second-order+asymmetry-2+creep-1, loaded": (93, 145),
    "platform with feedback": (31, 54, 143),
    "maxwell-slip, loaded": (73,),
    "dahl": (174,),
    "anisotropic-lugre under a load and on a tilt": (19, 21, 111, 162),
    "lugre with little friction": (189,),
    "simplified-lugre with little friction": (102,),
    "dahl with little friction": (124,),
    "generalized-maxwell-slip on a static stack": (4,),
    "stribeck on a static stack, held voltage, amplifier that slews": (0, 1),
}
"""Settled too early or never, noise in what is left of a ringing, the error of its phase, deflections that are a
rounding of the motion (docs/numerics.md); a jump of the velocity past a law's own event."""


@pytest.fixture(autouse=True)
def a_structure_at_a_time() -> Iterator[None]:
    """What is compiled for 108 of them took 21 GB."""
    yield
    jax.clear_caches()


def verdicts(name: str, numbers: Iterable[int]) -> dict[int, Verdict]:
    judge = Judge(STRUCTURES[name])
    return {number: Verdict(**drawn(judge, number)) for number in numbers}


def check(name: str, found: dict[int, Verdict]) -> None:
    told = dict(zip(found, wrongs(name, list(found.values())), strict=True))
    assert not any(told.values()), told


@pytest.mark.parametrize("name", QUICK)
def test_some_actuators(name):
    check(name, verdicts(name, range(QUICK[name])))


@pytest.mark.slow
@pytest.mark.parametrize("name", STRUCTURES)
def test_actuators_of_every_structure(name):
    found = verdicts(name, dict.fromkeys((*range(MANY), *ONCE_WRONG.get(name, ()))))
    check(name, {number: found[number] for number in range(MANY)})
    assert all(found[number].is_right and found[number].reverse < 1e-10 for number in ONCE_WRONG.get(name, ())), found


def test_structures_that_were_once_wrong_are_still_asked():
    assert set(ONCE_WRONG) <= set(STRUCTURES)


@pytest.mark.slow
def test_a_ringing_that_is_rounding_has_no_reversals_to_derive():
    """A stack that never settles rings on; reversals of 1e-17 m took a column of sigma0 24 % off."""
    name = "maxwell-slip, loaded"
    check(name, verdicts(name, (5, 9)))


SLIDING = {
    "piezo.gain": 8.689e-8,
    "piezo.natural_frequency": 10642.0,
    "piezo.damping_ratio": 0.5712,
    "effector.mass": 0.1,
    "friction.f_c": 8.831e-3,
    "friction.f_s": 8.079e-2,
    "friction.sigma0": 2.387e6,
    "friction.sigma1": 283.9,
    "friction.sigma2": 408.3,
    "friction.v_s": 2.881e-5,
    "friction.elastic_part": 0.9807,
}
"""Where a fit of the measured record of Liu et al. (2015) went."""


@pytest.mark.slow
def test_a_narrow_transition_to_sliding_is_resolved_for_derivatives():
    """Values were right, the Jacobian off by 1e42: steps passed poles of what is left of the transition."""
    structure = Structure("elastoplastic", drive=Sawtooth(30.0, 5.0, 7.314e-5), given=SLIDING)
    verdict = Judge(structure).verdict(np.zeros(len(structure.nominal)))
    assert verdict.is_right and verdict.reverse < 1e-8, verdict


def test_every_unit_has_its_structure():
    assert {structure.unit for structure in STRUCTURES.values()} == set(VALUES)
    assert len(PUBLISHED) == 4
