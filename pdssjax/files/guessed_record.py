"""What a user's file suggests for a record of a new study."""

import dataclasses
from pathlib import Path

import numpy as np

from ..core import InputError
from ..metrics import RecordGuess, guess_record
from .channel_roles import Hints, Roles, roles_of
from .record_columns import Columns, read_columns

_FEW = 0.05
"""Part of a record's samples that may be no numbers, and are excluded."""


@dataclasses.dataclass(frozen=True)
class Told:
    """What the user says of the rig and of all records."""

    peak: float | None = None
    """Of the drive [V], where no voltage was recorded."""
    frequency: float | None = None
    """Of the drive [Hz], where no voltage was recorded; None: found in the motion."""
    mass: float | None = None
    """Of the end-effector [kg]."""


@dataclasses.dataclass(frozen=True, eq=False)
class NewRecord:
    """A file, and what it suggests."""

    name: str
    roles: Roles
    guess: RecordGuess
    measures_told: bool = False
    """What it measures was told, and not guessed."""
    without: tuple[tuple[float, float], ...] = ()
    """Stretches in which the file has no numbers, from when to when [s] on its clock: what the record excludes."""

    @property
    def left_out(self) -> int:
        """Samples in these stretches."""
        return sum(int(np.sum((self.guess.time > begin) & (self.guess.time < end))) for begin, end in self.without)


def guess_file(file: Path, hints: Hints, told: Told, measures: str = "") -> NewRecord:
    """What `file` suggests for a record of a study; it `measures` "platform" or "effector", "": to be guessed.

    **Raises:** `InputError` where a channel, a unit or the drive is not clear, with the option that tells it.
    """
    roles = roles_of(file, hints)
    if "voltage" not in roles.channels and told.peak is None:
        raise InputError(f'{file}: found no voltage, expected --peak with that of the drive, such as --peak "30 V".')
    read = read_columns(file, roles.layout)
    columns, without = _filled(read, roles.motion)
    columns.check_numbers()
    if columns.data["time"].size < 16:
        raise InputError(f"{file}: found {columns.data['time'].size} samples, expected a record of 16 at least.")
    guess = _guessed(file, columns, roles.motion, told, measures)
    if guess.waveform.name in ("sampled", "sine") and not np.all(np.isfinite(read.data["voltage"])):
        # The samples themselves may be the drive then, and have to be known everywhere.
        read.check_numbers()
    return NewRecord(file.stem, roles, guess, bool(measures), without)


def _guessed(file: Path, columns: Columns, quantity: str, told: Told, measures: str) -> RecordGuess:
    data = columns.data
    try:
        return guess_record(
            data["time"],
            data[quantity],
            data.get("voltage"),
            velocity=quantity == "velocity",
            measures=measures,
            peak=told.peak,
            frequency=told.frequency,
            where=str(file),
        )
    except ValueError as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{file}: {error}.") from None


def _filled(columns: Columns, motion: str) -> tuple[Columns, tuple[tuple[float, float], ...]]:
    """The columns with samples that are no numbers filled from beside them, where they are few, and when those were."""
    time = columns.data["time"]
    wrong = ~np.all([np.isfinite(column) for column in columns.data.values()], axis=0)
    if not wrong.any() or not np.all(np.isfinite(time)) or np.mean(wrong) > _FEW:
        return columns, ()
    known, data = np.flatnonzero(~wrong), dict(columns.data)
    for quantity in set(data) - {"time"}:
        # A motion keeps the steps in which its sensor counts.
        last = known[np.maximum(np.searchsorted(known, np.arange(time.size), "right") - 1, 0)]
        held = data[quantity][last]
        between = np.interp(time, time[known], data[quantity][known])
        data[quantity] = np.where(wrong, held if quantity == motion else between, data[quantity])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wrong, [False]]).astype(int)))
    beside = 0.25 * float(np.median(np.diff(time)))
    gaps = zip(edges[::2], edges[1::2] - 1, strict=True)
    return dataclasses.replace(columns, data=data), tuple(
        (float(time[a]) - beside, float(time[b]) + beside) for a, b in gaps
    )
