"""Checks of a record's clock: times increase, meet the drive, and do not begin too late.

Times are in seconds; what is at fault is said with its file.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from ..core import InputError

if TYPE_CHECKING:
    # Files are read without JAX, which takes most of a second to load.
    from ..drive.base import AbstractDrive
    from .record import Record

STEP_TIME = 0.01
"""Time [s] in which a platform under a step comes to rest; for checks of units and clocks only."""


def check_increasing(
    file: Path, column: str, time: Float[np.ndarray, " samples"], places: Int[np.ndarray, " samples"], place: str
) -> None:
    """**Raises** `InputError` that names the first of `places` at which the `time` [s] does not increase."""
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        before, here = time[late[0]], time[late[0] + 1]
        coarse = "; of a clock with too few digits give the interval: "
        coarse += "time = { interval = ... } in a record, or --interval"
        raise InputError(
            f'{file}: {place} {places[late[0] + 1]}, column "{column}": found {here:.15g} s after {before:.15g} s, '
            f"expected times that increase{coarse if here == before else ''}."
        )


def check_meets_drive(
    where: str, begin: float, time: Float[np.ndarray, " samples"], drive: "AbstractDrive | None", start: float
) -> None:
    """Refuse a record whose samples cannot be of its drive.

    **Arguments:** `begin` is the first time in the file, `time` those of the samples kept, and
    `start` when the drive starts, all on the clock of the file [s].

    **Raises:** `InputError` that begins with `where`.
    """
    if drive is None:
        return
    found = f"{where}: found times from {begin:.12g} s to {time[-1]:.12g} s"
    on = f"on this clock the drive starts at {start:.12g} s, which the record's key start tells (0 if left out)"
    if time[-1] <= start:
        raise InputError(f"{found}, expected some after the drive has started; {on}.")
    frequency = drive.cycle_frequency()
    # Beyond that a record is taken for one on another clock.
    latest, what = 10 * max(float(time[-1]) - begin, STEP_TIME), "10 times the record's length"
    if frequency is not None:
        latest, what = 1000 / float(frequency), "1000 periods of the drive"
    if begin - start > latest:
        raise InputError(f"{found}, expected the first within {what}, {latest:g} s, of the drive's start; {on}.")


def check_begins_early(record: "Record") -> None:
    """**Raises** `InputError` where a record, of a file or made in Python, begins too late to be of its drive."""
    first, length = float(record.time[0]), float(np.ptp(record.time))
    if record.drive is not None and abs(first) > max(1e6, 10.0 * length):
        raise InputError(
            f'{record.file}: record "{record.name}": found a first sample at {first:g} s, and samples over '
            f"{length:g} s, expected times from the start of the drive on, which is t = 0."
        )
