"""The judge of derivatives: what it makes of records whose derivatives are known."""

import numpy as np
import pytest

from experiments.derivative_judge import REVERSE, Judge


class Made:
    """A structure of two parameters whose record is given in closed form."""

    def __init__(self, wrong=0.0, jump=0.0, width=0.0):
        self.nominal, self.times = {"a.slow": 1.0, "b.jump": 1.0}, np.linspace(0.0, 1.0, 20)
        self.wrong, self.jump, self.width = wrong, jump, width

    def slopes(self, factors):
        """The derivative of `values`, the second column off by the part `wrong`."""
        return np.stack([np.cos(factors[0] + self.times), (1.0 + self.wrong) * np.ones(20)], axis=1)

    def values(self, factors):
        steps = self.width * np.floor(factors[1] / self.width + 0.3) if self.width else 0.0
        return np.sin(factors[0] + self.times) + factors[1] + self.jump * (factors[1] > 0.0) + steps


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


@pytest.mark.parametrize("width", [3e-6, 3e-8, 3e-10])
def test_a_derivative_between_many_discontinuities_is_seen_by_fine_differences(width):
    verdict = made_judge(Made(width=width)).verdict(np.zeros(2))
    assert verdict.is_right and not verdict.is_cliff and verdict.error < 1e-4 and verdict.discontinuity is not None
    assert not made_judge(Made(width=width, wrong=2e-3)).verdict(np.zeros(2)).error < 1e-3


def test_a_record_that_shows_nothing_has_right_derivatives():
    still = Made()
    still.slopes = lambda factors: np.zeros((20, 2))
    still.values = lambda factors: np.zeros(20)
    verdict = made_judge(still).verdict(np.zeros(2))
    assert verdict.is_right and verdict.reverse == 0.0 and verdict.error == 0.0
