"""Coloured noise, and a misfit of the model that every cycle repeats.

    y = f(parameters) + g(phase) + noise,     cov = G' C G + (Z' G)' K (Z' G)

The misfit g is a Gaussian process in the phase of the drive, shared by all cycles of a record (Z says which sample
belongs to which phase): more cycles do not average it away.  It is as M. C. Kennedy and A. O'Hagan, J. R. Statist. Soc.
B 63(3), 2001, have it, marginalised as the zero of a record is; its size and length K are those that explain the mean
residuals best, what the fit could take up set aside (`_phase_process.py`).  Samples that stand out are noise, by their
size, and say nothing of a misfit.

Where a record does not repeat, misfit and slow noise cannot be told apart: its residuals are white noise, of the size
that neighbours show, and a process in time.
"""

import numpy as np
from jaxtyping import Float, Int

from ....metrics import CycleSplit, ResidualSplit, neighbour_scatter, split_residuals
from ._phase_process import PhaseProcess, phase_process
from .base import AbstractErrorModel, RecordErrors, RecordShare
from .coloured import Coloured

MOST_PHASES = 200
"""Phases in which a misfit is described; finer ones are taken together."""

_AT_ONCE = 20
"""Phases whose covariance with all others is computed at once."""

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
        found = Coloured().share(record)
        coloured = found.covariance
        record = record.without_outliers()
        if record.residual.size < FEWEST:
            return found._replace(evidence=0.0)
        split = split_residuals(record.residual, record.time, record.frequency, record.freedom)
        process, phase = misfit_of(record, split)
        sums = sums_at(phase, record.influence, process.covariance.shape[0])
        misfit = sums.T @ process.covariance @ sums
        if split.cycles is not None:
            return RecordShare(coloured + misfit, process.evidence, found.freedom)
        noise = neighbour_scatter(record.residual) ** 2
        larger = _larger(coloured, misfit + noise * record.influence.T @ record.influence)
        return RecordShare(larger, process.evidence, found.freedom)


def misfit_of(record: RecordErrors, split: ResidualSplit) -> tuple[PhaseProcess, Int[np.ndarray, " n"]]:
    """The misfit of a record without NaN, and the phase that each sample belongs to, 0 to `MOST_PHASES` - 1."""
    phase, count = _phases(record, split.cycles)
    # A phase without samples takes no part.
    there, phase = np.unique(phase, return_inverse=True)
    sizes = np.bincount(phase)
    if split.cycles is None:
        noise = np.diag(neighbour_scatter(record.residual) ** 2 / sizes)
    else:
        noise = noise_of_means(record, split, phase)
    mean = sums_at(phase, record.residual[:, None], sizes.size)[:, 0] / sizes
    slopes = sums_at(phase, record.jacobian, sizes.size) / sizes[:, None]
    return phase_process(mean, slopes, noise, there / count, periodic=split.cycles is not None), phase


def _phases(record: RecordErrors, cycles: CycleSplit | None) -> tuple[Int[np.ndarray, " n"], int]:
    """The phase of each sample, and how many phases there are; of a record that does not repeat parts of its span."""
    if cycles is not None:
        count = min(MOST_PHASES, cycles.sizes.size)
        return cycles.group * count // cycles.sizes.size, count
    count = min(MOST_PHASES, record.residual.size)
    share = (record.time - record.time[0]) / np.ptp(record.time)
    return np.minimum(np.floor(share * count), count - 1).astype(int), count


def noise_of_means(
    record: RecordErrors, split: ResidualSplit, phase: Int[np.ndarray, " n"]
) -> Float[np.ndarray, "phases phases"]:
    """Covariance of the mean noise at each phase; all phases have samples."""
    count = int(phase.max()) + 1
    sizes, out = np.bincount(phase), np.zeros((count, count))
    # A few phases at a time: all of them would be an n x phases matrix.
    for some in np.array_split(np.arange(count), -(-count // _AT_ONCE)):
        member = (phase[:, None] == some) / sizes[some]
        out[:, some] = sums_at(phase, split.noise.times(member, record.time), count) / sizes[:, None]
    return 0.5 * (out + out.T)


def sums_at(
    phase: Int[np.ndarray, " n"], columns: Float[np.ndarray, "n p"], count: int
) -> Float[np.ndarray, "phases p"]:
    """Sums of the rows of each phase."""
    out = np.zeros((count, columns.shape[1]))
    np.add.at(out, phase, columns)
    return out


def _larger(first: Float[np.ndarray, "p p"], second: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
    """The smallest covariance above `first` that is as large as `second` wherever that is larger.

    In the coordinates in which `first` is the identity; a parameter without error in it takes that of `second`.
    """
    scale = np.sqrt(np.maximum(np.diag(first), np.diag(second)))
    scale = np.where(scale > 0, scale, 1.0)
    values, axes = np.linalg.eigh(first / np.outer(scale, scale))
    root = axes * np.sqrt(np.maximum(values, 1e-14 * max(float(values[-1]), 1e-300)))
    inverse = np.linalg.inv(root)
    gain, turn = np.linalg.eigh(inverse @ (second / np.outer(scale, scale)) @ inverse.T)
    grown = root @ turn * np.sqrt(np.maximum(gain, 1.0))
    return grown @ grown.T * np.outer(scale, scale)
