"""The errors of a linear model under each error model are those of the dense formulas, and cover what they claim."""

import numpy as np
import pytest
from marks import slow
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from pdssjax.core import member
from pdssjax.inference import influence_of
from pdssjax.inference.uncertainty.error_models.base import RecordErrors
from pdssjax.inference.uncertainty.error_models.coloured import Coloured
from pdssjax.inference.uncertainty.error_models.white import White
from pdssjax.inference.uncertainty.error_models.with_misfit import (
    WithMisfit,
    _basis,
    distances,
    matern,
    misfit_of,
    noise_of_means,
    phase_process,
    restricted_likelihood,
)
from pdssjax.metrics import ResidualSplit, split_residuals

RANDOM = np.random.default_rng(4)
CYCLES, PHASES = 6, 40
TIME = np.arange(CYCLES * PHASES) / PHASES
PHASE = np.mod(TIME, 1.0)
COLUMNS = np.stack([np.exp(-3 * PHASE), np.cos(9 * PHASE), PHASE], axis=1) * np.array([1e-3, 1.0, 1e4])
DESIGN = COLUMNS - COLUMNS.mean(axis=0)
"""Whitened Jacobian of a record whose zero is free."""


def coloured_noise(coefficient, count=TIME.size, random=RANDOM):
    """An autoregression of order one and of variance one."""
    white = random.normal(size=count + 300) * np.sqrt(1.0 - coefficient**2)
    return lfilter([1.0], [1.0, -coefficient], white)[300:]


def fitted(measured, frequency=1.0, design=DESIGN, time=TIME):
    """What a linear fit leaves of a record, and its influence."""
    off = measured - measured.mean()
    residual = off - design @ np.linalg.lstsq(design, off, rcond=None)[0]
    freedom = time.size - design.shape[1] - 1.0
    return RecordErrors(residual, design, influence_of(design), time, frequency, 1.0, freedom)


def split_of(record: RecordErrors) -> ResidualSplit:
    return split_residuals(record.residual, record.time, record.frequency, record.freedom)


SCALE = np.linalg.norm(DESIGN, axis=0)


def agree(found, expected, digits=1e-8):
    """Covariances whose parameters have different units agree."""
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(size, size), expected / np.outer(size, size), atol=digits)


def middle(covariance):
    """The sandwich of the textbook, of a dense covariance of the samples."""
    unit = DESIGN / SCALE
    bread = np.linalg.inv(unit.T @ unit)
    return bread @ unit.T @ covariance @ unit @ bread / np.outer(SCALE, SCALE)


def test_white_errors_are_those_of_the_normal_equations():
    agree(
        White().covariance([fitted(coloured_noise(0.0))._replace(variance_factor=1.7)])[0],
        1.7 * middle(np.eye(TIME.size)),
    )


@pytest.mark.parametrize("frequency", [1.0, None], ids=["cycles", "no cycle"])
def test_coloured_errors_are_the_sandwich_with_the_dense_covariance(frequency):
    record = fitted(coloured_noise(0.7), frequency)
    noise = split_of(record).noise
    assert noise.coefficients.size > 0
    dense = toeplitz(noise.autocovariance(TIME.size))
    agree(Coloured().covariance([record])[0], middle(dense))


def test_the_errors_with_misfit_are_those_of_the_dense_formula():
    record = fitted(coloured_noise(0.5) + 2.0 * np.sin(7.0 * PHASE**2))
    split = split_of(record)
    process, phase = misfit_of(record, split)
    members = (phase[:, None] == np.arange(PHASES)).astype(float)
    dense = toeplitz(split.noise.autocovariance(TIME.size)) + members @ process.covariance @ members.T
    agree(WithMisfit().covariance([record])[0], middle(dense))
    means = members / CYCLES
    np.testing.assert_allclose(
        noise_of_means(record, split, phase),
        means.T @ toeplitz(split.noise.autocovariance(TIME.size)) @ means,
        rtol=1e-8,
        atol=1e-12,
    )


def test_the_likelihood_is_that_of_what_the_parameters_leave_of_the_samples():
    """Restricted likelihood of Patterson and Thompson: that of any full set of contrasts A'y with A'X = 0."""
    base = _basis(DESIGN[:PHASES])
    values = RANDOM.normal(size=PHASES)
    full = np.linalg.qr(np.column_stack([base, RANDOM.normal(size=(PHASES, PHASES - base.shape[1]))]))[0]
    contrasts = full[:, base.shape[1] :]
    found, expected = [], []
    for length in (0.05, 0.4):
        covariance = 0.3 * np.eye(PHASES) + 2.0 * matern(distances(PHASE[:PHASES], True), length)
        inner = contrasts.T @ covariance @ contrasts
        left = contrasts.T @ values
        expected.append(-0.5 * np.linalg.slogdet(inner)[1] - 0.5 * left @ np.linalg.solve(inner, left))
        found.append(restricted_likelihood(values, base, covariance))
    # Up to a constant, the same for all covariances.
    assert found[0] - found[1] == pytest.approx(expected[0] - expected[1], rel=1e-8)


@pytest.mark.parametrize("periodic", [True, False])
def test_a_misfit_s_covariance_is_one(periodic):
    values = np.linalg.eigvalsh(matern(distances(np.linspace(0.0, 0.99, 100), periodic), 0.3))
    assert values.min() > -1e-12
    apart = distances(np.array([0.0, 0.01, 0.99]), periodic)
    assert apart[0, 1] == pytest.approx(0.01, rel=1e-3)
    assert apart[0, 2] == pytest.approx(0.01 if periodic else 0.99, rel=1e-3)


def test_the_size_of_a_misfit_is_found():
    phases, random = np.arange(100) / 100, np.random.default_rng(4)
    root = np.linalg.cholesky(4.0 * matern(distances(phases, True), 0.08) + 1e-9 * np.eye(100))
    slopes = np.cos(2 * np.pi * phases)[:, None]
    found = [
        phase_process(root @ process + 0.3 * noise, slopes, 0.09 * np.eye(100), phases, True)
        for process, noise in random.normal(size=(40, 2, 100))
    ]
    assert np.median([np.mean(np.diag(f.covariance)) for f in found]) == pytest.approx(4.0, rel=0.3)
    assert np.median([f.length for f in found]) == pytest.approx(0.08, rel=0.3)
    assert min(f.evidence for f in found) > 100.0


def test_white_residuals_are_evidence_of_nothing_and_all_errors_agree():
    record = fitted(coloured_noise(0.0, random=np.random.default_rng(11)))
    white, coloured, whole = (np.sqrt(np.diag(m().share(record).covariance)) for m in (White, Coloured, WithMisfit))
    np.testing.assert_allclose(coloured, white, rtol=0.15)
    np.testing.assert_allclose(whole, white, rtol=0.3)
    assert max(m().share(record).evidence for m in (Coloured, WithMisfit)) < 10.0


def test_a_misfit_that_repeats_is_seen_and_more_cycles_do_not_average_it_away():
    misfit, random = np.sin(7.0 * PHASE**2), np.random.default_rng(4)
    record = fitted(0.3 * coloured_noise(0.5, random=random) + misfit)
    less = fitted((0.3 * coloured_noise(0.5, random=random) + misfit)[:80], design=DESIGN[:80], time=TIME[:80])
    assert WithMisfit().share(record).evidence > 50.0
    ratios = np.sqrt(np.diag(WithMisfit().share(record).covariance) / np.diag(WithMisfit().share(less).covariance))
    np.testing.assert_allclose(ratios, 1.0, atol=0.3)
    ratios = np.sqrt(np.diag(Coloured().share(record).covariance) / np.diag(Coloured().share(less).covariance))
    assert np.all(ratios < 0.8)


@pytest.mark.parametrize("frequency", [None, 1.0 / (TIME[-1] / 1.3)], ids=["no cycle", "less than two cycles"])
def test_where_nothing_repeats_what_is_smooth_may_be_misfit(frequency):
    record = fitted(0.2 * coloured_noise(0.0) + np.sin(7.0 * PHASE**2), frequency)
    coloured, whole = (m().share(record) for m in (Coloured, WithMisfit))
    assert whole.evidence > 100.0
    assert np.linalg.eigvalsh((whole.covariance - coloured.covariance) / np.outer(1 / SCALE, 1 / SCALE)).min() > -1e-9


@pytest.mark.parametrize("frequency", [1.0, slow(None)])
@pytest.mark.parametrize("misfit, least, most", [(0.0, -10.0, 10.0), (1.0, 50.0, np.inf)])
def test_glitches_are_noise_and_no_misfit_and_hide_none(frequency, misfit, least, most):
    random = np.random.default_rng(12)
    glitches = np.zeros(TIME.size)
    glitches[random.choice(TIME.size, 9, replace=False)] = random.choice([-40.0, 40.0], 9)
    record = fitted(0.3 * coloured_noise(0.0, random=random) + misfit * np.sin(7.0 * PHASE**2) + glitches, frequency)
    record = record._replace(outlying=glitches != 0.0)
    coloured, whole = (m().share(record) for m in (Coloured, WithMisfit))
    assert least < whole.evidence < most
    clean = fitted(0.3 * coloured_noise(0.0, random=random), frequency)
    assert np.all(np.diag(coloured.covariance) > 100.0 * np.diag(Coloured().share(clean).covariance))
    assert np.all(np.diag(whole.covariance) > 0.9 * np.diag(coloured.covariance))


@pytest.mark.parametrize("frequency", [1.0, None])
@pytest.mark.parametrize("pattern", [[1, 1, 1, 1, 1], [1, -1, 1, -1, 1]], ids=["one way", "to and fro"])
def test_glitches_side_by_side_do_not_colour_the_noise(frequency, pattern):
    # So long a record that they hardly pull the others.
    design, time = np.tile(DESIGN, (12, 1)), np.arange(12 * TIME.size) / PHASES
    glitches, noise = np.zeros(time.size), np.random.default_rng(12).normal(size=time.size)
    glitches[31:36], glitches[71:76] = 40.0 * np.array(pattern), 25.0 * np.array(pattern)
    record = fitted(noise + glitches, frequency, design, time)
    coloured = Coloured().share(record._replace(outlying=glitches != 0.0))
    assert coloured.evidence < 10.0 < Coloured().share(record).evidence
    moves = [record.residual[run] @ record.influence[run] for run in (slice(31, 36), slice(71, 76))]
    left = coloured.covariance - sum(np.outer(move, move) for move in moves)
    agree(left, Coloured().share(fitted(noise, frequency, design, time)).covariance, 0.2)


@pytest.mark.parametrize("name", ["white", "coloured", "with-misfit"])
@pytest.mark.parametrize("frequency", [1.0, slow(None)])
def test_samples_that_are_nan_are_as_if_they_had_not_been_taken(name, frequency):
    record = fitted(coloured_noise(0.6) + np.sin(7.0 * PHASE**2), frequency)
    gone = RANDOM.random(TIME.size) < 0.1
    gone[0] = False
    holed = record._replace(
        residual=np.where(gone, np.nan, record.residual), jacobian=np.where(gone[:, None], np.nan, record.jacobian)
    )
    without = RecordErrors(*(part[~gone] for part in record[:4]), frequency, 1.0, record.freedom - float(gone.sum()))
    model = member("inference.uncertainty.error_models", name)()
    found, expected = (model.covariance([errors])[0] for errors in (holed, without))
    agree(found, expected, 1e-12)
    assert np.isfinite(found).all()
