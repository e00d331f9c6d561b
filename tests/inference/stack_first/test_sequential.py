"""A fit in two steps: which parameters each fits, and what is said where the first one fails."""

from types import SimpleNamespace

import numpy as np
import pytest

from pdssjax.inference import Ending, Fit, sequential
from pdssjax.inference.prior import Prior
from pdssjax.inference.stack_parameters import stack_parameters, stack_residuals

MODULE = "pdssjax.inference.stack_first.held_stack"


def record(platform_alone, *conditions):
    measurement = SimpleNamespace(platform_alone=platform_alone)
    return SimpleNamespace(measurement=measurement, conditions=frozenset(conditions), time=np.zeros(3))


def problem(*paths):
    """One record of the platform, under "cold", and one of a walk, under "walk" and "warm"."""
    transform = SimpleNamespace(paths=paths, encode=lambda starts: np.zeros(len(paths)))
    residual = SimpleNamespace(transform=transform, prior=Prior(paths))
    return SimpleNamespace(records=(record(True, "cold"), record(False, "walk", "warm")), residual=residual)


def test_what_only_the_walk_shows_of_the_stack_is_fitted_in_the_second_step():
    paths = "piezo.gain", "piezo.gain@walk", "piezo.mass@cold", "drive.rise_time@cold", "friction.f_ss", "sensor.delay"
    posed = problem(*paths)
    np.testing.assert_array_equal(stack_parameters(posed), [True, False, True, True, False, False])  # pyright: ignore
    # Samples of the platform, none of the walk's, and what was measured apart of what is fitted first.
    expected = [True] * 3 + [False] * 3 + [True, False, True, True, False, False]
    np.testing.assert_array_equal(stack_residuals(posed), expected)  # pyright: ignore


@pytest.mark.parametrize("success", [True, False])
def test_where_the_first_step_fails_its_reason_is_that_of_the_fit(monkeypatch, success):
    state = SimpleNamespace(residual=np.ones(3))
    ended = lambda success, message, ending: Fit(np.zeros(2), state, success, message, 3, 4, ending)  # pyright: ignore
    first = ended(success, "stalled", Ending.STALLED)
    last = ended(True, "the gradient is small", Ending.CONVERGED)
    monkeypatch.setattr(f"{MODULE}.fit_phase", lambda *given: first)
    monkeypatch.setattr(f"{MODULE}.with_piezo_held", lambda *given: last)
    fit = sequential(problem("piezo.gain", "friction.f_ss"), {}, lambda message: None)  # pyright: ignore
    assert (fit.success, fit.iterations, fit.evaluations) == (success, 6, 8)
    assert fit.message == ("the gradient is small" if success else "piezo: stalled")
    assert fit.ending == (Ending.CONVERGED if success else Ending.STALLED)
