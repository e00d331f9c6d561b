"""Questions a record that moves against its drive: a sensor that counts the other way, or the other direction.

The record is explained by a line in time and the voltage, x = a + b t + c u.  A platform, and an end-effector that
walks, follow the voltage between the slips, so c > 0; where the voltage explains half of what the line leaves and
c < 0, something is the wrong way round.
"""

import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..core import InputWarning
from ..study import Record
from .initial_values.record_features import voltages

_CLEAR = -0.7
"""Correlation of motion and voltage, both without their lines in time, below which a record moves against its drive."""

_FEWEST = 8
"""Samples from which it is looked at."""


def question_signs(records: Sequence[Record]) -> None:
    """Warns with `InputWarning` of records of displacements that move against their drives."""
    for record in records:
        if _told(record) and _follows(record.time, record.measured, voltages(record)) < _CLEAR:
            turned = " or the drive's direction is the other one" if _has_flanks(record) else ""
            warnings.warn(
                f'{record.file}: record "{record.name}": found a motion against the voltage, expected one with it; the '
                f"sensor counts the other way (scale = -1 in the record turns it){turned}.",
                InputWarning,
                stacklevel=2,
            )


def _has_flanks(record: Record) -> bool:
    return record.drive is not None and record.drive.flanks() is not None


def _told(record: Record) -> bool:
    """Whether the voltage says which way a record goes: not where it is a wave that the platform may lag behind."""
    if record.drive is None or record.measurement.unit != "m" or record.time.size < _FEWEST:
        return False
    return _has_flanks(record) or (record.measurement.platform_alone and record.drive.cycle_frequency() is None)


def _follows(time: Float[np.ndarray, " n"], motion: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"]) -> float:
    """Correlation of motion and voltage, both without their lines in time; 0 where the voltage is a line."""
    line = np.stack([np.ones(time.size), time - time.mean()], axis=1)
    bent = [column - line @ np.linalg.lstsq(line, column, rcond=None)[0] for column in (motion, volts)]
    size = [float(np.linalg.norm(column)) for column in bent]
    if size[1] <= 1e-6 * np.linalg.norm(volts) or size[0] == 0:
        return 0.0
    return float(bent[0] @ bent[1]) / (size[0] * size[1])
