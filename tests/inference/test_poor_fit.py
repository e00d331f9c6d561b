"""Whether a fit leaves more than noise: by its size, its correlation, and what a few samples allow by chance."""

import dataclasses

import fabricated
import numpy as np
import pytest

from pdssjax.inference.poor_fit import neighbour_correlation

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
