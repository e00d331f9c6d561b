"""Checks of the records before a fit: samples listed twice, and sensors that count the other way.

A study fits samples twice where a file has two names, a record is listed twice, or windows overlap.  Standard errors
are then too small by up to the root of two.  Samples are compared, not names; two similar runs differ in their noise.

A platform follows the voltage, and so does an end-effector late on the slow flanks.  Where one moves against it, the
sensor counts the other way, or the drive has the other direction.
"""

import itertools
import warnings
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..core import InputError, InputWarning
from ..metrics import goes_against, rides_against
from ..study import Record
from .initial_values.record_features import voltages

_FEWEST = 16
"""Fewest common samples, all equal, for two records to be the same and not so by chance."""


def check_measured_once(records: Sequence[Record], where: object) -> None:
    """**Raises** `InputError`, which begins with `where`, for the first two of the `records` that share samples.

    Only what is fitted counts, and only records of the same quantity are compared.
    """
    fitted = [record for record in records if record.role == "fit"]
    for earlier, later in itertools.combinations(fitted, 2):
        if earlier.measurement == later.measurement and (shared := _count_shared(earlier, later)):
            raise InputError(
                f'{where}: record "{later.name}" ({later.file}): found {shared} of its {later.time.size} samples in '
                f'record "{earlier.name}" ({earlier.file}), too, expected every sample once. Fitted twice they would '
                "pass for new measurements, and the errors be too small: leave one record out, or give it role = "
                '"validate" or another window.'
            )


def _count_shared(earlier: Record, later: Record) -> int:
    """Number of samples that two records have in common; 0 where any sample at a common time differs."""
    if earlier.time.size == later.time.size and _equal(earlier.measured, later.measured):
        # The clock of a copy may have been reset.
        return _count_informative(earlier.measured)
    # On the clocks of the files, each up to a rounding.
    interval = float(np.median(np.diff(earlier.time))) if earlier.time.size > 1 else 1.0
    first, second = (np.round((r.time + r.start) / (1e-3 * interval)) for r in (earlier, later))
    _, here, there = np.intersect1d(first, second, return_indices=True)
    same = here.size and _equal(earlier.measured[here], later.measured[there])
    return _count_informative(earlier.measured[here]) if same else 0


_ROUNDING = 1e-12
"""Relative rounding of the same samples in another unit."""


def _equal(one: Float[np.ndarray, " n"], other: Float[np.ndarray, " n"]) -> bool:
    return np.allclose(one, other, rtol=0.0, atol=_ROUNDING * np.max(np.abs(one), initial=0.0))


def _count_informative(values: Float[np.ndarray, " n"]) -> int:
    """The number of samples; 0 of few, and of those that show nothing but rest."""
    return values.size if values.size >= _FEWEST and np.ptp(values) > 0 else 0


def warn_of_reversed_signs(records: Sequence[Record]) -> None:
    """Warn with `InputWarning` of records of displacements that move against their drives."""
    for record in records:
        if found := _reversed_sign(record):
            warnings.warn(f"{record.file}: {found}", InputWarning, stacklevel=2)


def about_signs(records: Sequence[Record]) -> list[str]:
    """Sentences for a report on records of displacements that move against their drives."""
    return [f"{found[0].upper()}{found[1:]}" for record in records if (found := _reversed_sign(record))]


def _reversed_sign(record: Record) -> str | None:
    """The fault of a record that moves against its drive; None where it does not, or where that cannot be told."""
    drive, alone = record.drive, record.measurement.platform_alone
    if drive is None or record.measurement.unit != "m" or record.time.size < 8:
        return None
    frequency, has_flanks = drive.cycle_frequency(), drive.flanks() is not None
    # The lag of a platform behind a periodic voltage without flanks hides the sign of its motion.
    if not has_flanks and not (alone and frequency is None):
        return None
    samples = record.time, record.measured, voltages(record)
    if alone or frequency is None:
        is_reversed = goes_against(*samples)
    else:
        is_reversed = rides_against(*samples, 1.0 / float(frequency))
    if not is_reversed:
        return None
    turned = " or the drive's direction is the other one" if has_flanks else ""
    return (
        f'record "{record.name}": found a motion against the voltage, expected one with it; the sensor counts the '
        f"other way (scale = -1 in the record turns it; where it has a scale, the other sign){turned}."
    )
