"""Degrees of freedom by record, noise that is estimated, and what makes a loss a likelihood."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from pdssjax.core import member
from pdssjax.inference import Ending, Evidence
from pdssjax.inference.losses.base import AbstractLoss
from pdssjax.inference.losses.squares import Squares
from pdssjax.inference.parameter_transform import ParameterTransform
from pdssjax.inference.search.multistart import with_noise


class Linear(SimpleNamespace):
    """A problem that is linear, of several records without offsets; `_replace` as of a named tuple."""

    def _replace(self, **changes):
        return Linear(**{**vars(self), **changes})

    def decode(self, free):
        return free


def linear(designs, measured, noise, given=None):
    ends = np.cumsum([0, *(len(design) for design in designs)])
    rows = [slice(a, b) for a, b in itertools.pairwise(ends)]
    given = [None] * len(designs) if given is None else given
    records = [SimpleNamespace(time=np.zeros(len(d)), offset=0.0, noise=g) for d, g in zip(designs, given, strict=True)]
    count, linear = designs[0].shape[1], np.zeros(designs[0].shape[1], bool)
    names, ends = tuple(f"p{number}" for number in range(count)), np.full(count, np.inf)
    residual = SimpleNamespace(loss=Squares(), transform=ParameterTransform(names, linear, np.ones(count), -ends, ends))
    return Linear(
        designs=designs, data=measured, records=records, noise=np.array(noise), rows=rows, residual=residual
    )  # fmt: skip


class Fitted(SimpleNamespace):
    def _replace(self, **changes):
        return Fitted(**{**vars(self), **changes})


def run(problem, starts, report, ending=Ending.CONVERGED):
    jacobian = np.concatenate([-d / n for d, n in zip(problem.designs, problem.noise, strict=True)])
    whitened = np.concatenate([y / n for y, n in zip(problem.data, problem.noise, strict=True)])
    free = np.linalg.lstsq(-jacobian, whitened, rcond=None)[0]
    residual = whitened + jacobian @ free
    state = SimpleNamespace(residual=residual, jacobian=jacobian)
    chi2 = float(residual @ residual)
    return Fitted(free=free, state=state, chi2=chi2, iterations=1, evaluations=1, ending=ending)


def test_each_record_s_share_is_the_trace_of_its_part_of_the_hat_matrix():
    random = np.random.default_rng(1)
    designs = [random.normal(size=(10, 3)), random.normal(size=(200, 3))]
    problem = linear(designs, [random.normal(size=10), random.normal(size=200)], [0.01, 1.0])
    fit = run(problem, None, None)
    jacobian = fit.state.jacobian
    hat = jacobian @ np.linalg.inv(jacobian.T @ jacobian) @ jacobian.T
    expected = [np.trace(hat[:10, :10]), np.trace(hat[10:, 10:])]
    np.testing.assert_allclose(Evidence(problem, fit).effective_parameters, expected)  # pyright: ignore
    # What nothing is known of counts as well: where, the samples say that tell of the rest.
    fit.state.jacobian[:, 2] = 0.0
    assert np.sum(Evidence(problem, fit).effective_parameters) == pytest.approx(3.0)  # pyright: ignore
    fit.state.jacobian[:] = np.nan
    np.testing.assert_allclose(Evidence(problem, fit).effective_parameters, [3.0 / 21.0, 60.0 / 21.0])  # pyright: ignore


def test_the_noise_of_few_precise_samples_beside_many_others_is_found():
    """From a first guess a hundred times too large."""
    random, ratios = np.random.default_rng(2), []
    truth = np.array([1.0, -2.0, 0.5])
    for _ in range(200):
        designs = [random.normal(size=(10, 3)), random.normal(size=(800, 3))]
        measured = [d @ truth + n * random.normal(size=len(d)) for d, n in zip(designs, (0.01, 1.0), strict=True)]
        problem = linear(designs, measured, [1.0, 1.0])
        _, found = with_noise(run(problem, None, None), problem, run, lambda message: None)  # pyright: ignore
        ratios.append(found.noise / [0.01, 1.0])
    # 7 degrees of freedom: a mean of variances of 200 is known to 4 %.
    np.testing.assert_allclose(np.mean(np.square(ratios), axis=0), 1.0, atol=0.15)


def test_noise_that_is_given_stays():
    random = np.random.default_rng(3)
    problem = linear([random.normal(size=(50, 2))] * 2, [random.normal(size=50)] * 2, [0.5, 0.5], [0.5, None])
    _, found = with_noise(run(problem, None, None), problem, run, lambda message: None)  # pyright: ignore
    assert found.noise[0] == 0.5 and found.noise[1] == pytest.approx(1.0, rel=0.3)


def test_a_fit_without_an_end_is_weighed_by_the_noise_that_it_leaves_once():
    problem = linear([np.ones((20, 1))] * 2, [np.arange(20.0), np.zeros(20)], [100.0, 1.0])
    ends = iter([Ending.RUNNING, Ending.RUNNING])
    unended = lambda *args: run(*args, ending=next(ends))
    fit, found = with_noise(unended(problem, None, None), problem, unended, lambda message: None)  # pyright: ignore
    assert fit.iterations == 2 and found.noise[0] < 50.0


@pytest.mark.parametrize("name", ["squares", "huber", "cauchy"])
def test_a_loss_is_a_likelihood_with_its_volume(name):
    loss = member("inference.losses", name)()
    exact = {
        "squares": 0.5 * math.log(2.0 * math.pi),
        # Normal in the middle, exponential beyond 1.345.
        "huber": math.log(
            math.sqrt(2.0 * math.pi) * (1.0 - 2.0 * stats.norm.sf(1.345)) + 2.0 / 1.345 * math.exp(-0.5 * 1.345**2)
        ),
        # A Student t of 2 m - 1 degrees of freedom with (1 + r^2 / c^2)^-m, m = c^2 / 2.
        "cauchy": math.log(quad(lambda r: (1.0 + (r / 2.3849) ** 2) ** (-0.5 * 2.3849**2), -np.inf, np.inf)[0]),
    }
    assert loss.log_volume() == pytest.approx(exact[name], abs=1e-6)
    assert AbstractLoss.log_volume(loss) == pytest.approx(exact[name], abs=1e-6)
