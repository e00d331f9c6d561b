"""Whether a fit leaves more than noise: by its size, its correlation, and what a few samples allow by chance."""

import dataclasses
import itertools
from types import SimpleNamespace

import fabricated
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from pdssjax.inference import Evidence
from pdssjax.inference.beyond_noise import (
    exceeds_given_noise,
    leaves_unresolved,
    neighbour_correlation,
    stays_below_given_noise,
)
from pdssjax.inference.losses.cauchy import Cauchy
from pdssjax.inference.losses.huber import Huber
from pdssjax.inference.losses.squares import Squares

RANDOM = np.random.default_rng(1)


def record(residual, **changes):
    """A record with this residual, in units of its noise."""
    time = np.arange(residual.size) * 1e-3
    plain = fabricated.record("step", "fit", "platform", time, 1e-6 * np.sin(5.0 * time))
    return dataclasses.replace(plain, predicted=plain.measured - plain.noise * residual, **changes)


def test_a_glitch_of_three_samples_does_not_correlate_neighbours():
    residual = RANDOM.normal(size=800)
    residual[333:336] += 50.0
    assert neighbour_correlation(record(residual)) > 0.5
    glitch = record(residual, outliers=np.arange(333, 336))
    assert abs(neighbour_correlation(glitch)) < 0.1
    assert neighbour_correlation(record(np.convolve(RANDOM.normal(size=801), [1, 1], "valid"))) == pytest.approx(
        0.5, abs=0.1
    )


def judged(*records):
    """Whether a fit of three numbers that leaves these (samples, chi-square a sample, noise given) leaves too much.

    Neighbours have opposite signs: by its size alone.
    """
    parts = [np.sqrt(mean) * np.resize([1.0, -1.0], samples) for samples, mean, _ in records]
    return judged_of(
        *((part, part, 1.0 if given else None, 1.0) for part, (_, _, given) in zip(parts, records, strict=True))
    )


def judged_of(*records):
    """The same of these (whitened residuals, measured, noise given, noise by which they were whitened)."""
    parts = [part for part, _, _, _ in records]
    ends = np.cumsum([0, *(part.size for part in parts)])
    rows = [slice(a, b) for a, b in itertools.pairwise(ends)]
    told = [
        SimpleNamespace(time=np.arange(part.size), measured=measured, noise=given, offset=0.0, drive=None)
        for part, measured, given, _ in records
    ]
    residual, noise = SimpleNamespace(loss=Squares()), np.array([noise for *_, noise in records])
    problem = SimpleNamespace(records=told, rows=rows, residual=residual, noise=noise)
    left = np.concatenate(parts)
    fit = SimpleNamespace(chi2=float(left @ left), free=np.zeros(3), state=SimpleNamespace(residual=left))
    return Evidence(problem, fit).leaves_more_than_noise  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("samples", [12, 20, 200])
def test_a_short_record_leaves_too_much_as_rarely_as_a_long_one(samples):
    """Once in 30 000 right fits: between the quantiles of 1e-4 and 1e-5 of chi-square."""
    freedom = samples - 3
    rare, rarer = (stats.chi2.isf(share, freedom) / samples for share in (1e-4, 1e-5))
    assert not judged((samples, rare, True)) and judged((samples, rarer, True))
    reduced = samples / freedom
    told = lambda mean: record(
        np.ones(samples), chi2=samples * mean, reduced_chi2=reduced * mean, rmse=1.04e-8, outliers=np.zeros(0, int)
    )
    assert not exceeds_given_noise(told(rare)) and exceeds_given_noise(told(max(rarer, 1.3)))
    small, smaller = (stats.chi2.ppf(share, freedom) / samples for share in (1e-4, 1e-7))
    assert not stays_below_given_noise(told(small)) and stays_below_given_noise(told(min(smaller, 0.7)))


@pytest.mark.parametrize("others", [0, 400, 40_000])
def test_many_samples_whose_noise_was_estimated_do_not_hide_what_others_leave(others):
    beside = [(others, 1.0, False)] if others else []
    assert judged((50, 3.0, True), *beside)
    assert not judged((50, 1.1, True), *beside)
    assert judged((50, 1.0, True), (400, 1.3, False))


@pytest.mark.parametrize("noise_given", [True, False])
def test_nor_do_many_samples_that_are_explained_hide_a_record_that_is_not(noise_given):
    others = (2000, 1.0, noise_given)
    assert judged((50, 3.0, True), others) and not judged((50, 1.3, True), others)
    # Known with certainty, and too little for a word.
    assert not judged((20_000, 1.1, True), (400_000, 0.9, True))


@pytest.mark.parametrize("loss", [Squares(), Huber(), Cauchy()])
def test_right_fits_under_every_loss_are_hardly_ever_said_to_leave_more_than_noise(loss):
    """By the spread of the scatter: of the median of absolute residuals it is 1.65 times that of the mean square."""
    roots = np.asarray(loss.root(jnp.asarray(RANDOM.normal(size=(1500, 400)))))
    scatters = np.array([loss.scatter(row, 400.0) ** 2 for row in roots])
    assert np.std(scatters) == pytest.approx(np.sqrt(2.0 / 400.0 / loss.scatter_efficiency), rel=0.1)


TIME = np.arange(500)
MOTION = 5.0 * np.sin(0.02 * TIME) + 3.0 * np.sin(0.0317 * TIME)
SMOOTH = np.sin(0.3 * TIME) * np.sqrt(2.0)


@pytest.mark.parametrize(
    ("measured", "given", "left", "unresolved"),
    [
        (MOTION, 0.01, 0.005, True),  # half the noise that the study states
        (MOTION, 0.01, 0.0099, False),  # as large as that noise, and smooth
        (np.round(MOTION, 2), None, 0.0028, True),  # what counting in steps of 0.01 rounds
        (np.round(MOTION, 2), None, 0.0040, False),
        (MOTION, None, 1e-9, True),  # what rounding leaves of exact numbers
        (MOTION, None, 1e-6, False),
    ],
)
def test_smooth_residuals_that_a_record_cannot_show_are_no_misfit(measured, given, left, unresolved):
    assert judged_of((SMOOTH * left / (given or left), measured, given, given or left)) is not unresolved
    beside = dataclasses.replace(
        record(SMOOTH),
        measured=measured,
        predicted=measured - left * SMOOTH,
        noise=given or left,
        noise_estimated=given is None,
    )
    assert leaves_unresolved(beside) is unresolved


def test_records_that_cannot_show_a_misfit_do_not_hide_one_in_others():
    exact = (1e-6 * RANDOM.normal(size=500), MOTION, 1.0, 1.0)
    assert not judged_of(exact) and judged_of(exact, (0.99 * SMOOTH, MOTION, 1.0, 1.0))
