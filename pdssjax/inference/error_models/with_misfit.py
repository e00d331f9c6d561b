"""Coloured noise, and a misfit of the model that every cycle repeats.

    y = f(parameters) + g(phase) + noise,     cov = G' C G + (Z' G)' K (Z' G)

The misfit g is a Gaussian process in the phase of the drive, shared by all cycles of a record (Z says which sample
belongs to which phase): more cycles do not average it away.  It is as M. C. Kennedy and A. O'Hagan, J. R. Statist. Soc.
B 63(3), 2001, have it, marginalised as the zero of a record is; its size and length K are those that explain the mean
residuals best, what the fit could take up set aside (`_phase_process.py`).

Where a record does not repeat, misfit and slow noise cannot be told apart: its residuals are white noise, of the size
that neighbours show, and a process in time.
"""

import numpy as np
from jaxtyping import Float, Int

from ...metrics import CycleSplit, grid_positions, neighbour_scatter, stationary_product
from ._phase_process import PhaseProcess, phase_process
from .base import AbstractErrorModel, RecordErrors, RecordShare
from .coloured import Coloured, cycle_split, noise_of

MOST_PHASES = 200
"""Phases in which a misfit is described; finer ones are taken together."""

FEWEST = 16
"""Samples from which a misfit is looked for."""


class WithMisfit(AbstractErrorModel):
    """A misfit in drive phase, beside stationary noise."""

    rank = 2
    covers = (
        "the physical parameters, if the model's misfit is as likely to go their way as any other of its size and "
        "smoothness, and the pseudo-true ones more often than 95 %"
    )

    def share(self, record: RecordErrors) -> RecordShare:
        coloured = Coloured().share(record).covariance
        if record.residual.size < FEWEST:
            return RecordShare(coloured, 0.0)
        split = cycle_split(record)
        process, phase = misfit_of(record, split)
        sums = sums_at(phase, record.influence, process.covariance.shape[0])
        misfit = sums.T @ process.covariance @ sums
        if split is not None:
            return RecordShare(coloured + misfit, process.evidence)
        noise = neighbour_scatter(record.residual) ** 2
        return RecordShare(_larger(coloured, misfit + noise * record.influence.T @ record.influence), process.evidence)


def misfit_of(record: RecordErrors, split: CycleSplit | None) -> tuple[PhaseProcess, Int[np.ndarray, " n"]]:
    """The misfit of a record without NaN, and the phase that each sample belongs to, 0 to `MOST_PHASES` - 1."""
    n = record.residual.size
    if split is None:
        span = np.ptp(record.time) * (1.0 + 1e-9)
        count = min(MOST_PHASES, n)
        phase = np.floor((record.time - record.time[0]) / span * count).astype(int)
    else:
        count = min(MOST_PHASES, split.sizes.size)
        phase = split.group * count // split.sizes.size
    # A phase without samples takes no part.
    there, phase = np.unique(phase, return_inverse=True)
    sizes = np.bincount(phase)
    if split is None:
        noise = np.diag(neighbour_scatter(record.residual) ** 2 / sizes)
    else:
        noise = noise_of_means(record, split, phase)
    mean = sums_at(phase, record.residual[:, None], sizes.size)[:, 0] / sizes
    slopes = sums_at(phase, record.jacobian, sizes.size) / sizes[:, None]
    return phase_process(mean, slopes, noise, there / count, periodic=split is not None), phase


def noise_of_means(
    record: RecordErrors, split: CycleSplit, phase: Int[np.ndarray, " n"]
) -> Float[np.ndarray, "phases phases"]:
    """Covariance of the mean noise at each phase; all phases have samples."""
    places, count = grid_positions(record.time), int(phase.max()) + 1
    noise = noise_of(record, split)[0].autocovariance(int(places[-1]) + 1)
    member = (phase[:, None] == np.arange(count)) / np.bincount(phase)
    return stationary_product(noise, member, places)


def sums_at(
    phase: Int[np.ndarray, " n"], columns: Float[np.ndarray, "n p"], count: int
) -> Float[np.ndarray, "phases p"]:
    """Sums of the rows of each phase."""
    out = np.zeros((count, columns.shape[1]))
    np.add.at(out, phase, columns)
    return out


def _larger(one: Float[np.ndarray, "p p"], other: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """The smallest covariance above `one` that is as large as `other` wherever that is larger.

    In the coordinates in which `one` is the identity; a parameter without error in it takes that of `other`.
    """
    scale = np.sqrt(np.maximum(np.diag(one), np.diag(other)))
    scale = np.where(scale > 0, scale, 1.0)
    values, axes = np.linalg.eigh(one / np.outer(scale, scale))
    root = axes * np.sqrt(np.maximum(values, 1e-14 * max(float(values[-1]), 1e-300)))
    inverse = np.linalg.inv(root)
    gain, turn = np.linalg.eigh(inverse @ (other / np.outer(scale, scale)) @ inverse.T)
    grown = root @ turn * np.sqrt(np.maximum(gain, 1.0))
    return grown @ grown.T * np.outer(scale, scale)
