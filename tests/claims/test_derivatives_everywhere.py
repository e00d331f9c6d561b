"""Derivatives and values are right for actuators drawn at random, of every structure.

Required at the default accuracy: values within 1e-4 um (1e-4 N) of the tightest; every column that the record
shows within 1e-3 of central differences, or a discontinuity that the differences show, too; forward and reverse mode
alike.  The quick version has few actuators of the published structure; `experiments.map_of_rightness` has many.
"""

from functools import cache

import numpy as np
import pytest

from experiments.derivative_judge import REVERSE, VALUES, Judge, Verdict
from experiments.map_of_rightness import drawn, wrongs
from experiments.random_actuators import PUBLISHED, STRUCTURES, Structure
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
}
"""Settled too early or never, noise in what is left of a ringing, the error of its phase (docs/numerics.md)."""

judge = cache(lambda name: Judge(STRUCTURES[name]))


def check(name: str, count: int) -> None:
    found = [Verdict(**drawn(judge(name), number)) for number in range(count)]
    told = {number: said for number, said in enumerate(wrongs(name, found)) if said}
    assert not told


@pytest.mark.parametrize("name", QUICK)
def test_some_actuators(name):
    check(name, QUICK[name])


@pytest.mark.slow
@pytest.mark.parametrize("name", STRUCTURES)
def test_actuators_of_every_structure(name):
    check(name, MANY)


@pytest.mark.slow
def test_a_ringing_that_is_rounding_has_no_reversals_to_derive():
    """A stack that never settles rings on; reversals of 1e-17 m took a column of sigma0 24 % off."""
    name = "maxwell-slip, loaded"
    assert wrongs(name, [Verdict(**drawn(judge(name), number)) for number in (5, 9)]) == ["", ""]


@pytest.mark.slow
@pytest.mark.parametrize("name", ONCE_WRONG)
def test_actuators_that_were_once_wrong(name):
    found = [Verdict(**drawn(judge(name), number)) for number in ONCE_WRONG[name]]
    assert all(verdict.is_right and verdict.reverse < 1e-10 for verdict in found), found


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


class Made:
    """A structure of two parameters whose record is given in closed form."""

    def __init__(self, wrong=0.0, jump=0.0):
        self.nominal, self.times = {"a.slow": 1.0, "b.jump": 1.0}, np.linspace(0.0, 1.0, 20)
        self.wrong, self.jump = wrong, jump

    def slopes(self, factors):
        """The derivative of `values`, the second column off by the part `wrong`."""
        return np.stack([np.cos(factors[0] + self.times), (1.0 + self.wrong) * np.ones(20)], axis=1)

    def values(self, factors):
        return np.sin(factors[0] + self.times) + factors[1] + self.jump * (factors[1] > 0.0)


def made_judge(made, failed=False, back=1.0):
    """A judge to whom both accuracies show the same."""
    found = Judge(made)
    found.values = lambda factors, accuracy: made.values(factors)
    jacobian = lambda factors: made.slopes(factors) * (np.nan if failed else 1.0)
    found.slopes = lambda factors, accuracy: (jacobian(factors), back * (found.weights @ jacobian(factors)))
    return found


def test_a_wrong_column_a_discontinuity_a_failure_and_a_wrong_reverse_mode_are_told_apart():
    at = np.zeros(2)
    right = made_judge(Made()).verdict(at)
    assert right.is_right and right.error < 1e-8 and right.discontinuity is None and right.above == 0
    wrong = made_judge(Made(wrong=2e-3)).verdict(at)
    assert not wrong.is_right and not wrong.is_cliff and wrong.column == "b.jump" and wrong.above == 1
    assert wrong.error == pytest.approx(2e-3, rel=1e-3) and wrong.tight == pytest.approx(2e-3, rel=1e-3)
    jumping = made_judge(Made(jump=1e-6)).verdict(at)
    assert jumping.is_cliff and jumping.is_right and jumping.above == 0 and jumping.error > 1e-3
    assert made_judge(Made(), failed=True).verdict(at).failure == "usual"
    backward = made_judge(Made(), back=1.0 + 1e-6).verdict(at)
    assert not backward.is_right and backward.reverse > REVERSE
