"""Fits from starts on request: where the points lie, which ends are one optimum, and which fit is taken."""

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import qmc

from pdssjax import InputError
from pdssjax.core import sobol_points
from pdssjax.inference import Ending, Fit
from pdssjax.inference.parameter_transform import ParameterTransform
from pdssjax.inference.search import multistart
from pdssjax.inference.search.multistart import best_of_starts, check_starts, optima

PATHS = "a", "b"
RANGES = {"a": (0.5, 20.0)}


def test_points_fill_the_cube_evenly_and_differ_by_seed():
    points = sobol_points(64, 23, 3)
    assert points.shape == (64, 23)
    strata = np.sort(np.floor(64 * points).astype(int), axis=0)  # one point in each 64th of every axis
    np.testing.assert_array_equal(strata, np.arange(64)[:, None] * np.ones(23, int))
    np.testing.assert_array_equal(points, sobol_points(64, 23, 3))
    assert not np.array_equal(points, sobol_points(64, 23, 4))
    random = np.random.default_rng(0).random((64, 4))
    assert qmc.discrepancy(points[:, :4]) < 0.3 * qmc.discrepancy(random)


def whitened(free):
    """Valleys in log a, the lowest at a = 3 and b = 2."""
    beside = np.exp(free[0]) - 3.0
    return np.array([0.3 * beside, 8.0 * np.sin(beside), free[1] - 2.0, 0.01])


class Toy(SimpleNamespace):
    """A problem of two numbers, the first positive."""

    def decode(self, free):
        return {"a": float(np.exp(free[0])), "b": float(free[1])}


def toy() -> Toy:
    free = np.full(2, np.inf)
    transform = ParameterTransform(PATHS, np.array([True, False]), np.ones(2), -free, free)
    record = SimpleNamespace(offset=0.0)
    return Toy(residual=SimpleNamespace(transform=transform), records=(record,))


def run(problem, starts, report, limit=200):
    begun = np.array([np.log(starts["a"]), starts["b"]])
    found = least_squares(whitened, begun, xtol=1e-12, ftol=1e-12, gtol=1e-12)
    success = bool(starts["a"] < 15.0)  # far out nothing converges
    state = SimpleNamespace(residual=found.fun, jacobian=found.jac)
    return Fit(found.x, state, success, found.message, found.nfev, found.nfev, Ending.CONVERGED)  # pyright: ignore


@pytest.fixture
def study(monkeypatch):
    monkeypatch.setattr(multistart, "scatter_ranges", lambda *given: RANGES)
    return SimpleNamespace(models=None, parameters={}, records=())


@pytest.mark.parametrize("threads", [0, 3])
def test_the_best_of_all_starts_is_taken_and_the_optima_are_counted(study, threads):
    problem, usual_starts = toy(), dict(a=9.2, b=1.0)
    usual = run(problem, usual_starts, None)
    assert usual.chi2 > 1.0
    messages = []
    with ThreadPoolExecutor(threads or 1) as pool:
        executor = pool if threads else None
        fit, starts, table = best_of_starts(study, problem, usual, usual_starts, 32, run, executor, messages.append)
    assert fit.chi2 == pytest.approx(1e-4)
    assert np.exp(fit.free[0]) == pytest.approx(3.0)
    assert starts["a"] != 9.2 and starts["b"] == pytest.approx(usual.free[1])
    assert table.chi2.size == 33 and np.all(np.diff(table.chi2) >= 0.0)
    assert np.all(table.starts[:, 0] >= 0.5) and np.all(table.starts[:, 0] <= 20.0)
    np.testing.assert_array_equal(table.converged, table.starts[:, 0] < 15.0)
    np.testing.assert_array_equal(table.optimum < 0, ~table.converged)
    # As many as there are valleys that were reached, each at its own place.
    places = {round(float(end), 3) for end in table.ends[table.converged, 0]}
    assert table.distinct == len(places) > 2
    assert fit.evaluations == usual.evaluations + int(np.sum(table.iterations)) - usual.iterations
    assert messages[0] == "fitting from 32 more starts"
    assert messages[-1].startswith("more starts: 32 of 32, lowest chi-square 0.0001")


def test_the_usual_fit_stays_where_none_is_better(study):
    problem, usual_starts = toy(), dict(a=3.1, b=1.0)
    usual = run(problem, usual_starts, None)
    fit, starts, _ = best_of_starts(study, problem, usual, usual_starts, 8, run, None, lambda message: None)
    assert starts is usual_starts and np.array_equal(fit.free, usual.free)


def test_of_many_samples_too_a_better_optimum_is_taken(study, monkeypatch):
    """By 150 of 200 000: a part in a thousand, and a likelihood ratio of exp(75)."""
    problem, usual_starts = toy(), dict(a=1.0, b=2.0)
    state = SimpleNamespace(residual=np.ones(200_000), jacobian=np.zeros((200_000, 2)))
    usual = Fit(np.zeros(2), state, True, "", 1, 1)  # pyright: ignore
    better = usual._replace(free=np.ones(2), state=SimpleNamespace(residual=np.ones(199_850), jacobian=state.jacobian))
    run_better = lambda *given: better
    fit, _, _ = best_of_starts(study, problem, usual, usual_starts, 1, run_better, None, lambda message: None)
    assert fit.chi2 == better.chi2
    hardly = usual._replace(state=SimpleNamespace(residual=np.full(200_000, 1 - 1e-6), jacobian=state.jacobian))
    fit, _, _ = best_of_starts(study, problem, usual, usual_starts, 1, lambda *given: hardly, None, lambda m: None)
    assert fit.chi2 == usual.chi2


def test_ends_that_the_data_do_not_tell_apart_are_one_optimum():
    problem = toy()
    state = SimpleNamespace(residual=np.full(10, 1.0), jacobian=np.array([[10.0, 0.0]] * 10))
    at = lambda a, b, success=True: Fit(np.array([a, b]), state, success, "", 1, 1)  # pyright: ignore
    fits = [at(0.0, 0.0), at(0.01, 50.0), at(0.2, 0.0), at(0.2, 0.0, False), at(0.205, 1.0)]
    assert optima(fits, problem) == [0, 0, 1, -1, 1]  # pyright: ignore


@pytest.mark.parametrize(
    ("count", "said"),
    [(-1, "found -1, expected 0 or more"), (1.5, "found 1.5, expected an integer"), (10**9, "expected at most 100000")],
)
def test_a_number_of_starts_that_is_none_is_refused(count, said):
    with pytest.raises(InputError, match=f"starts: {said}" if "at most" not in said else said):
        check_starts(count)
