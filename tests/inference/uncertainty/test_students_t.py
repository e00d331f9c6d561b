"""Intervals are those of Student's t where noise was estimated, by the records that tell each parameter."""

import dataclasses
import itertools
from types import SimpleNamespace

import fabricated
import numpy as np
import platform_study
import pytest
from scipy.stats import t

import pdssjax
from pdssjax.inference import NORMAL_95, Evidence
from pdssjax.inference.losses.huber import Huber
from pdssjax.inference.losses.squares import Squares
from pdssjax.inference.parameter_transform import ParameterTransform
from pdssjax.inference.prior import Prior
from pdssjax.inference.uncertainty.drawn_intervals import with_draws
from pdssjax.inference.uncertainty.linear_intervals import effective_freedom, half_width_95
from pdssjax.inference.uncertainty.parameter_errors import standard_errors_of
from pdssjax.study import Draws, ParameterDraws

PATHS = ("piezo.gain", "friction.sigma0", "friction.f_ss")


def errors(design, off, sizes, given, loss=None):
    """Estimate and standard errors of a linear model of records whose noise is 1, given or known from what is left."""
    ends, cuts = np.full(3, np.inf), np.cumsum([0, *sizes])
    scale = ParameterTransform(PATHS, np.zeros(3, bool), np.ones(3), -ends, ends)
    records = tuple(
        SimpleNamespace(
            time=np.arange(size),
            offset=0.0,
            noise=1.0 if is_given else None,
            conditions=(),
            measurement=SimpleNamespace(platform_alone=False),
        )
        for size, is_given in zip(sizes, given, strict=True)
    )
    free = np.linalg.lstsq(design, off, rcond=None)[0]
    rest = off - design @ free
    rows = [slice(*pair) for pair in itertools.pairwise(cuts)]
    noise = np.ones(len(sizes))
    if len(sizes) == 1 and not given[0]:
        noise *= np.sqrt(rest @ rest / (len(off) - 3))
    problem = SimpleNamespace(
        records=records,
        residual=SimpleNamespace(transform=scale, prior=Prior(), loss=loss or Squares()),
        rows=rows,
        rows_apart=slice(cuts[-1], cuts[-1]),
    )
    each = np.repeat(noise, sizes)
    state = SimpleNamespace(jacobian=-design / each[:, None], residual=rest / each)
    return free, standard_errors_of("joint", Evidence(problem, SimpleNamespace(free=free, state=state)), None)


def test_widths_are_those_of_tables_and_of_a_normal_distribution_where_the_noise_is_known():
    np.testing.assert_allclose(half_width_95(np.array([1.0, 2.0, 10.0])), [12.7062, 4.3027, 2.2281], rtol=1e-4)
    assert half_width_95(np.inf) == NORMAL_95
    assert half_width_95(1e9) == pytest.approx(NORMAL_95, rel=1e-7)


def test_shares_are_weighed_by_what_is_known_of_their_noise():
    variance = np.array([1.0, 5.0, 2.0, np.nan])
    shares = [np.array([1.0, 2.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0, 1.0])]
    found = effective_freedom(variance, shares, [4.0, 10.0, 10.0], [False, True, True])
    np.testing.assert_allclose(found, [4.0, 25.0 / (4.0 / 4.0 + 4.0 / 10.0), np.inf, np.inf])


@pytest.mark.parametrize("samples", [5, 12])
def test_intervals_of_a_few_samples_hold_the_truth_in_95_of_100(samples):
    """By the normal distribution 80 and 91 of 100."""
    random, inside = np.random.default_rng(3), []
    for _ in range(600):
        free, found = errors(random.normal(size=(samples, 3)), random.normal(size=samples), [samples], [False])
        inside.append(np.abs(free) < half_width_95(found.freedom) * np.sqrt(np.diag(found.covariance.matrix)))
    np.testing.assert_allclose(found.freedom, samples - 3.0)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.016)


def test_a_parameter_that_few_samples_tell_has_their_degrees_of_freedom_beside_a_long_record():
    random = np.random.default_rng(3)
    design = random.normal(size=(805, 3))
    design[5:, 0] = 0.0
    design[:5, 1:] *= 0.1
    _, found = errors(design, random.normal(size=805), [5, 800], [False, False])
    assert found.freedom[0] == pytest.approx(4.0, abs=0.1)
    assert np.all(found.freedom[1:] > 700.0)
    _, found = errors(design, 0.9 * random.normal(size=805), [5, 800], [True, True])
    assert found.factor == 1.0 and np.isinf(found.freedom).all()


def test_noise_that_residuals_exceed_is_known_from_all_records_that_give_it():
    random = np.random.default_rng(3)
    design = random.normal(size=(30, 3))
    _, found = errors(design, 3.0 * random.normal(size=30), [10, 20], [True, True])
    np.testing.assert_allclose(found.freedom, 27.0)


def test_the_scatter_of_a_robust_loss_is_that_of_so_many_samples():
    random = np.random.default_rng(3)
    _, found = errors(random.normal(size=(12, 3)), random.normal(size=12), [12], [True], Huber())
    np.testing.assert_allclose(found.freedom, 9.0)


def test_linear_intervals_and_profiles_of_a_fit_of_few_samples_agree(tmp_path):
    text = platform_study.PLATFORM.replace('"friction.sigma0" = {}', '"friction.sigma0" = { value = 1e6 }')
    study = pdssjax.load_study(platform_study.write_platform(tmp_path, text))
    every = slice(None, None, max(study.records[0].time.size // 14, 1))
    few = [
        dataclasses.replace(r, time=r.time[every], measured=r.measured[every], noise=None) for r in study.records[:1]
    ]
    study = dataclasses.replace(study, records=tuple(few))
    linear, profiled = (pdssjax.identify(study, intervals=kind) for kind in ("linear", "profile"))
    for path in linear.names:
        found = linear.parameters[path]
        left = few[0].time.size - len(linear.names) - (few[0].offset is None)
        assert found.degrees_of_freedom == pytest.approx(left)
        assert found.errors["white"].interval == pytest.approx(found.interval, rel=1e-9)
        assert found.interval[1] / found.value == pytest.approx(
            np.exp(t.ppf(0.975, left) * found.standard_error / found.value), rel=1e-6
        )
        assert np.log(profiled.parameters[path].interval) == pytest.approx(np.log(found.interval), rel=1e-2)


def test_drawn_intervals_lie_as_much_farther_out_on_the_scale_of_the_fit():
    estimate = fabricated.estimate("joint")
    path = estimate.names[0]
    known = estimate.parameters[path]
    value, ends = known.value, (0.9 * known.value, 1.2 * known.value)
    drawn = Draws("posterior", "so", (path,), np.ones((1, 2, 1)), 0, "", 0, (ParameterDraws(path, value, 1.0, ends),))
    found = with_draws(estimate, drawn, [], np.array([True]))
    assert found.parameters[path].interval == ends and found.draws.description == "so"
    few = dataclasses.replace(known, degrees_of_freedom=3.0, bounds=(0.0, 1.3 * value))
    found = with_draws(
        dataclasses.replace(estimate, parameters=estimate.parameters | {path: few}), drawn, [], np.array([True])
    )
    wider = t.ppf(0.975, 3.0) / NORMAL_95
    assert found.parameters[path].interval == pytest.approx((value * 0.9**wider, min(1.2**wider, 1.3) * value))
    assert "62.4 % farther out" in found.draws.description
