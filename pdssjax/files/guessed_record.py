"""What a user's file suggests for a record of a new study, and what its voltage leaves open of the drive.

Fast flanks, and the voltage itself, are then parameters of the record.

A sample or two on a flank, with noise, or none, tell how long it lasts and when it begins within bounds only; the
motion tells the rest.  Taken for exact they bias all other parameters: the ringing after a step that is 20 us late is
not that of any damping.  The noise of all samples leaves the voltage open, and with it how far the platform moves with
a volt.
"""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..core import InputError
from ..metrics import RecordGuess, Timing, gain_of, guess_record
from .channel_roles import Hints, Roles, roles_of
from .record_columns import Columns, read_columns
from .toml_table import quoted

_LONGEST_INTERVAL = 2.5e-4
"""Interval [s] up to which samples show the ringing after a flank, which tells when it was; beyond, a drive's start and
a contact that is seen in aliases would be taken for each other."""

_NEGLIGIBLE = 0.1
"""Part of a sample's noise below which what the voltage leaves open moves no sample."""

_FLANK = {"step": "drive.rise_time", "sawtooth": "drive.fall_time", "cycloidal": "drive.fall_time"}
"""The parameter that is the duration of the fast flank, by waveform."""


def has_open_flanks(guess: RecordGuess) -> bool:
    """Whether the motion of a record tells more of its drive's flanks than its voltage does."""
    wave, gain = guess.waveform, gain_of(guess)
    if wave.timing is None or guess.volts is None:
        return False
    if wave.timing.errors is None and sampling_interval(guess) > _LONGEST_INTERVAL:
        return False
    shortest, longest, *_ = wave.timing
    moved = gain * abs(wave.numbers["voltage"]) * (longest - shortest) / max(longest, sampling_interval(guess))
    return moved > _NEGLIGIBLE * guess.motion_noise


def has_uncertain_voltage(guess: RecordGuess) -> bool:
    """Whether the noise of the voltage leaves more open of the motion's extent than the noise of the motion does."""
    return gain_of(guess) * guess.waveform.voltage_error > guess.motion_noise / math.sqrt(guess.time.size)


def condition_of(name: str) -> str:
    """The condition under which a record alone is made, by its name."""
    return name.replace("@", " at ")


def sampling_interval(guess: RecordGuess) -> float:
    """Time between samples [s], their mean."""
    return float((guess.time[-1] - guess.time[0]) / (guess.time.size - 1))


def early_start(guess: RecordGuess) -> float:
    """When the drive starts at the earliest [s]: a sensor's delay in the fit makes it later."""
    return guess.start - _timing(guess).within


def numbers_of(guess: RecordGuess) -> dict[str, float]:
    """The numbers of the drive; the voltage of a sawtooth whose fast flank is free follows from its slope."""
    numbers = dict(guess.waveform.numbers)
    if has_open_flanks(guess):
        lasts = numbers.pop(_FLANK[guess.waveform.name].partition(".")[2], 0.0)
        if guess.waveform.name == "sawtooth":
            numbers["voltage"] /= 1.0 - lasts * numbers["frequency"]
    return numbers


def _timing(guess: RecordGuess) -> Timing:
    assert guess.waveform.timing is not None
    return guess.waveform.timing


def open_parameters(named: Sequence[tuple[str, RecordGuess]]) -> list[str]:
    """Lines of a study's parameters for those of the named records that leave something open."""
    lines: list[str] = []
    under = lambda path, name: quoted(f"{path}@{condition_of(name)}")
    flanks = [(name, guess) for name, guess in named if has_open_flanks(guess)]
    if flanks:
        lines.append('"sensor.delay" = { value = 0 }')
    if any(guess.waveform.name == "step" for _, guess in flanks):
        lines.append('"drive.rise_time" = { value = 0 }')
    for name, guess in flanks:
        flank = _FLANK[guess.waveform.name]
        shortest, longest, within, errors = _timing(guess)
        if errors is None:
            origin = "as far as the voltage tells"
            # The standard deviation of a number that may lie anywhere between bounds.
            duration = _about(0.5 * (shortest + longest), (longest - shortest) / math.sqrt(12.0))
            delay = _about(within, within / math.sqrt(3.0))
        else:
            origin = "by the samples on the flanks"
            duration = _about(guess.waveform.numbers[flank.partition(".")[2]], errors[0])
            delay = _about(within, errors[1])
        lines.append(f"{under(flank, name)} = {duration}  # {origin}")
        lines.append(f"{under('sensor.delay', name)} = {delay}  # of the drive's start")
    unsure = [(name, guess) for name, guess in named if has_uncertain_voltage(guess)]
    volts = lambda guess: f"{numbers_of(guess)['voltage']:.10g} V"
    if unsure:
        # A sweep, which belongs to no record, takes that of the first walk.
        first = next((guess for _, guess in unsure if guess.measures == "effector"), unsure[0][1])
        lines.append(f'"drive.voltage" = {{ value = "{volts(first)}" }}  # of a record without one')
    for name, guess in unsure:
        value = f'value = "{volts(guess)}", standard_error = "{guess.waveform.voltage_error:.3g} V"'
        lines.append(f"{under('drive.voltage', name)} = {{ {value} }}  # by its samples and their noise")
    return lines


def _about(number: float, error: float) -> str:
    return f'{{ value = "{1e6 * number:.7g} us", standard_error = "{1e6 * error:.3g} us" }}'


@dataclasses.dataclass(frozen=True)
class RigOptions:
    """The user's options on the rig and on all records."""

    peak: float | None = None
    """Peak of the drive [V], where no voltage was recorded."""
    frequency: float | None = None
    """Frequency of the drive [Hz], where no voltage was recorded; None: found in the motion."""
    mass: float | None = None
    """Mass of the end-effector [kg]."""


@dataclasses.dataclass(frozen=True, eq=False)
class NewRecord:
    """A file, and what it suggests."""

    name: str
    roles: Roles
    guess: RecordGuess
    measures_given: bool = False
    """Whether the measurement was given, and not guessed."""
    gaps: tuple[tuple[float, float], ...] = ()
    """Stretches in which the file has no numbers, from when to when [s] on its clock: what the record excludes."""

    @property
    def left_out(self) -> int:
        """Samples in these stretches."""
        return sum(int(np.sum((self.guess.time > begin) & (self.guess.time < end))) for begin, end in self.gaps)


def guess_file(file: Path, hints: Hints, rig: RigOptions, measures: str = "") -> NewRecord:
    """What `file` suggests for a record of a study; it `measures` "platform" or "effector", "": to be guessed.

    **Raises:** `InputError` where a channel, a unit or the drive is not clear, with the option that tells it.
    """
    roles = roles_of(file, hints)
    if "voltage" not in roles.channels and rig.peak is None:
        raise InputError(f'{file}: found no voltage, expected --peak with that of the drive, such as --peak "30 V".')
    read = read_columns(file, roles.layout)
    columns, gaps = _fill_gaps(read, roles.motion)
    columns.check_numbers()
    if columns.data["time"].size < 16:
        raise InputError(f"{file}: found {columns.data['time'].size} samples, expected a record of 16 at least.")
    try:
        guess = guess_record(
            columns.data["time"],
            columns.data[roles.motion],
            columns.data.get("voltage"),
            velocity=roles.motion == "velocity",
            measures=measures,
            peak=rig.peak,
            frequency=rig.frequency,
            where=str(file),
        )
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{file}: {error}.") from None
    if guess.waveform.name in ("sampled", "sine") and not np.all(np.isfinite(read.data["voltage"])):
        # The samples themselves may be the drive then, and have to be known everywhere.
        read.check_numbers()
    return NewRecord(file.stem, roles, guess, bool(measures), gaps)


def _fill_gaps(columns: Columns, motion: str) -> tuple[Columns, tuple[tuple[float, float], ...]]:
    """The columns with samples that are no numbers filled from beside them, where they are few, and when those were."""
    time = columns.data["time"]
    wrong = ~np.all([np.isfinite(column) for column in columns.data.values()], axis=0)
    if not wrong.any() or not np.all(np.isfinite(time)) or np.mean(wrong) > 0.05:
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
    ends = zip(time[edges[::2]], time[edges[1::2] - 1], strict=True)
    gaps = tuple((float(begin) - beside, float(end) + beside) for begin, end in ends)
    return dataclasses.replace(columns, data=data), gaps
