"""What a drive did before a record's t = 0: cycles that were run, or a voltage that was held.

Where a study says nothing of a sampled voltage that begins off zero, its first voltage was held: `rest_before`.
"""

import dataclasses

import numpy as np

from ..actuator import ZeroOrderHold
from ..core import InputError, to_si
from ..drive.base import AbstractDrive
from ..drive.sampled import Sampled
from ..metrics import flicker_of
from .toml_table import Table

_EXPECTED = '"3 cycles", or of a sampled drive { cycles = 3, period = "1 s" } or a time such as "60 s"'

_HELD = 60.0
"""How long the first voltage was held [s] where a study does not say it: long beside what rings."""

_SHORTEST = 2.0
"""The same [s], at least, of a stack that is integrated all the while."""

_FLICKERS = 2.0
"""Times its flicker from which a voltage is off zero."""

_CHANGES = 3.0
"""Times that by which it has to go to and fro to be more than noise about one level."""

_NOTHING = 1e-3
"""Part of the peak that counts as 0 V without noise, too."""

_MOST = 10_000
"""Cycles; more than any stack remembers."""

_CLOSED = 0.02
"""Part of the swing by which a period of samples may miss its begin."""


def conditioned(record: Table, drive: AbstractDrive | None) -> tuple[AbstractDrive | None, float]:
    """The drive of a `record` with what its "conditioning" adds before t = 0, and by how much it starts earlier [s].

    Cycles of a waveform are run before its t = 0, a sampled drive's first period is repeated, or its first
    voltage held for a time; held for none, it sets in at t = 0.

    **Raises:** `InputError` where the key is at fault, or does not suit the drive.
    """
    if "conditioning" not in record.entries:
        return drive, 0.0
    where = record.at("conditioning")
    if drive is None:
        raise InputError(f"{where}: found conditioning, expected none: the record has no drive.")
    if isinstance(drive, Sampled):
        return _of_samples(record, drive)
    frequency, given = drive.cycle_frequency(), record.get("conditioning", str, _EXPECTED)
    number, _, unit = given.strip().partition(" ")
    if unit.strip() not in ("cycle", "cycles") or not number.isdecimal():
        raise InputError(f'{where}: found "{given}", expected whole cycles such as "3 cycles".')
    if frequency is None:
        raise InputError(f'{where}: found "{given}", expected none: this waveform has no cycle.')
    return drive, _cycles(int(number), where) / float(frequency)


def rest_before(
    record: Table, parameters: Table, drive: AbstractDrive | None, begin: float, length: float, settles: bool
) -> tuple[AbstractDrive | None, float, float | None]:
    """The drive of a `record` that has long rested at its first voltage, where that is off zero and nothing is said.

    **Arguments:** the study's `parameters`, of which those of the stack's initial state say what was before; `begin`
    is when the record begins, on the clock of the drive [s], and `length` how long it is [s]; whether the stack
    `settles`, so that a rest costs nothing.

    **Returns:** the drive, by how much it starts earlier [s], and the voltage at which it rested [V], None where the
    voltage sets in at t = 0: a record that begins before that shows what was there, and a voltage that never changes
    moves the actuator by setting in.
    """
    inner = drive.drive if isinstance(drive, ZeroOrderHold) else drive
    said = "conditioning" in record.entries or any(path.startswith("piezo.initial_") for path in parameters.entries)
    if drive is None or not isinstance(inner, Sampled) or said or begin < 0:
        return drive, 0.0, None
    volts = np.asarray(inner.voltages)
    noise = _FLICKERS * flicker_of(volts)
    if abs(volts[0]) <= max(noise, _NOTHING * float(np.max(np.abs(volts)))) or np.ptp(volts) <= _CHANGES * noise:
        return drive, 0.0, None
    held = _HELD if settles else float(np.clip(length, _SHORTEST, _HELD))
    if isinstance(drive, ZeroOrderHold):
        # In whole intervals, so that the stairs fall where they did.
        held = float(np.ceil(held / drive.interval)) * float(drive.interval)
        return dataclasses.replace(drive, drive=_held(inner, held)), held, float(volts[0])
    return _held(inner, held), held, float(volts[0])


def _held(drive: Sampled, time: float) -> Sampled:
    """With its first voltage held for a `time` [s]: until the first sample its voltage holds."""
    return dataclasses.replace(drive, times=np.asarray(drive.times) + time)


def _of_samples(record: Table, drive: Sampled) -> tuple[Sampled, float]:
    where = record.at("conditioning")
    given = record.get("conditioning", object, _EXPECTED)
    if isinstance(given, str) and given.rstrip().endswith(("cycle", "cycles")):
        raise InputError(f'{where}: found "{given}" of a sampled drive, expected its period, too: {_EXPECTED}.')
    if not isinstance(given, dict):
        held = to_si(given, "s", where)
        if held < 0:
            raise InputError(
                f"{where}: found {held:g} s, expected a time above 0, or 0 s of a voltage that sets in at t = 0."
            )
        return _held(drive, held), held
    table = record.table("conditioning", _EXPECTED)
    table.only(["cycles", "period"])
    count = table.get("cycles", int, "a whole number of cycles")
    period = table.number("period", "s")
    times, voltages = np.asarray(drive.times), np.asarray(drive.voltages)
    inside = times < times[0] + period * (1.0 - 1e-9)
    if not (period > 0 and inside.sum() >= 3 and inside.sum() < times.size):
        raise InputError(f"{table.at('period')}: found {period:g} s, expected a time that the samples hold.")
    misses = abs(float(voltages[inside.sum()] - voltages[0]))
    if misses > _CLOSED * float(np.ptp(voltages)):
        raise InputError(
            f"{table.at('period')}: found {period:g} s, after which the voltage is {misses:.3g} V from where it began, "
            "expected a period of it."
        )
    count = _cycles(count, table.at("cycles"))
    earlier = (np.arange(count)[:, None] * period + times[inside]).ravel()
    return (
        dataclasses.replace(
            drive,
            times=np.concatenate([earlier, times + count * period]),
            voltages=np.concatenate([np.tile(voltages[inside], count), voltages]),
        ),
        count * period,
    )


def _cycles(count: int, where: str) -> int:
    if isinstance(count, bool) or not 1 <= count <= _MOST:
        raise InputError(f"{where}: found {count}, expected a number of cycles from 1 to {_MOST}.")
    return count
