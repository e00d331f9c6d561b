"""The judge of derivatives: what differences of several steps make of records whose derivative is known."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest

from experiments.derivative_judge import ASKED, Judge

TIMES = np.linspace(0.5, 1.5, 7)


@dataclasses.dataclass(frozen=True)
class Stairs:
    """A record in proportion to its one parameter, and a step up of the given `height` every `width` of that."""

    height: float
    width: float
    slope_told: float = 1.0
    """By what the derivative is told in place of 1."""
    nominal = {"piezo.gain": 1.0}
    times = TIMES

    def shown(self, factors, accuracy) -> Any:
        (a,) = factors
        smooth = self.slope_told * a + jnp.floor((1.0 - self.slope_told) * a * 1e13) * 1e-13
        return TIMES * (smooth + self.height * jnp.floor(a / self.width))


def judged(structure):
    return Judge(structure).verdict(np.array([0.3123456789]))


def test_a_smooth_record_is_judged_by_one_difference():
    verdict = judged(Stairs(0.0, 1.0))
    assert verdict.is_right and verdict.error < 1e-9 and verdict.tight is None


@pytest.mark.parametrize("width", [3e-6, 3e-8])
def test_a_derivative_between_many_discontinuities_is_right_by_the_finest_differences(width):
    verdict = judged(Stairs(width, width))
    assert verdict.is_right and not verdict.is_cliff and verdict.error < 1e-4
    assert verdict.tight is not None


def test_a_derivative_that_no_difference_shows_is_wrong():
    verdict = judged(Stairs(0.0, 1.0, slope_told=0.99))
    assert not verdict.is_right and not verdict.is_cliff and verdict.above == 1
    assert ASKED < verdict.error == pytest.approx(0.01, rel=0.05)


def test_a_discontinuity_at_the_point_itself_is_told_from_an_error():
    verdict = Judge(Stairs(1.0, 0.5)).verdict(np.array([0.5]))
    assert verdict.is_cliff and verdict.is_right and verdict.error > ASKED
