"""A record beside its prediction: what its residuals tell where some samples are glitches."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pdssjax.study import compare
from pdssjax.study.measurement.effector import Effector

RANDOM = np.random.default_rng(0)
TIME = np.arange(800) / 100.0
NOISE = 1e-8


def compared(residual):
    """Eight cycles of 1 Hz predicted but for this residual, in units of the noise."""
    motion = 1e-6 * np.abs(np.mod(TIME, 1.0) - 0.5)
    drive = SimpleNamespace(cycle_frequency=lambda: 1.0)
    record = SimpleNamespace(
        name="walk", file=Path("walk.csv"), excitation="", role="fit",
        measures="effector", measurement=Effector(), drive=drive, motion=None,
        time=TIME, measured=motion + NOISE * residual, noise=NOISE, offset=0.0,
    )  # fmt: skip
    return compare(record, motion, noise=NOISE, offset=0.0)  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("glitches", [[], [333], [40, 333, 505, 777]])
def test_what_repeats_is_seen_beside_glitches(glitches):
    residual = RANDOM.normal(size=TIME.size) + 0.7 * np.sin(6.0 * np.pi * TIME)
    for place in glitches:
        residual[place : place + 3] += 100.0
    found = compared(residual)
    assert found.outliers.size == 3 * len(glitches)
    assert np.isnan(found.rest).sum() == 3 * len(glitches)
    assert found.lack_of_fit.sigmas > 4.0
    assert found.lack_of_fit.noise == pytest.approx(NOISE, rel=0.1)
    assert found.lack_of_fit.misfit == pytest.approx(0.7 * NOISE / np.sqrt(2.0), rel=0.3)
    assert found.rest_rmse == pytest.approx(float(np.hypot(1.0, 0.7 / np.sqrt(2.0))) * NOISE, rel=0.1)
