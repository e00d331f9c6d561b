"""`pdssjax new`: makes a study of files, with what their samples suggest."""

import argparse
import math
from collections.abc import Sequence
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import InputError, split_text
from .console import note, say
from .option_values import number_or_text, read_number, read_pairs

if TYPE_CHECKING:
    from ..files import Hints, NewRecord, RigOptions


QUANTITIES = {"time": "s", "voltage": "V", "displacement": "m", "velocity": "m/s", "force": "N"}
"""What a channel may be, and its unit."""

_MANY_SAMPLES = 100_000
"""Samples of a record from which the user is told how to keep fewer."""

_SLOWEST_DRIVE, _FASTEST_DRIVE = 0.05, 15e3
"""Frequencies [Hz] beyond which the clock's unit may be wrong."""

_LEAST_GAIN, _MOST_GAIN = 5e-10, 2e-6
"""Gains of a platform [m/V] beyond which a unit or a scale may be wrong."""

_MOST_USUAL_GAIN = 3e-7
"""Gain [m/V] that few stacks exceed."""


def new(options: argparse.Namespace) -> int:
    from ..core import prepare_jax
    from ..files import (
        RigOptions,
        check_empty,
        friction_file,
        guess_file,
        load_study,
        write_friction_study,
        write_study,
    )
    from ..report.text import format_guesses

    hints, measures = _hints(options), _measures(options)
    # The voltage of a drive that goes down first is negative.
    peak, frequency = _number(options, "peak", "V", above=None), _number(options, "frequency", "Hz")
    if peak == 0:
        raise InputError("option --peak: found 0 V, expected a voltage that is not 0.")
    rig = RigOptions(peak, frequency, _number(options, "mass", "kg"))
    check_empty(options.folder)
    contacts, records, status = [], [], 0
    for file in options.files:
        try:
            contact = None if measures else friction_file(file, hints)
            if contact is not None:
                contacts.append(contact)
            else:
                records.append(guess_file(file, hints, rig, measures.get(file, "")))
        except InputError as error:
            # All questions at once.
            note(f"error: {error}")
            status = 2
    if status:
        return status
    if contacts and records:
        raise InputError(
            f"{records[0].roles.file}: found no force in it, beside {contacts[0].roles.file}, which is of a contact "
            'alone, expected files of one kind: make a study of each, and join their [[record]] tables ("What can be '
            'measured" in docs/study-file.md).'
        )
    prepare_jax(dedicated=True)
    folder = options.folder
    title = options.title or folder.resolve().name
    if contacts:
        path = write_friction_study(contacts, folder, title)
        for contact in contacts:
            turned = ", turned to have the sign of the motion" if contact.turned else ""
            what = f"a contact alone, its force against a {contact.quantity}"
            say(f"{contact.roles.file}: {what}, {contact.force.size} samples{turned}")
    else:
        path = write_study(records, rig, folder, title)
        say(format_guesses([(record.name, record.guess) for record in records]), end="")
        _warn(records, rig)
    load_study(path)
    say(f"Look at {folder / 'check'}, edit {path} where a guess is wrong, then run:")
    say(f"pdssjax identify {path} --out {folder / 'out'}")
    return 0


def _warn(records: Sequence["NewRecord"], rig: "RigOptions") -> None:
    """Say what the user should not overlook."""
    from ..metrics import gain_of

    said = []
    if rig.mass is None and any(record.guess.measures == "effector" for record in records):
        said.append('the mass of the end-effector is a guess, 100 g: give --mass "86 g"')
    if rig.mass is not None and rig.mass > 5.0:
        said.append(f"found a mass of {rig.mass:g} kg, more than friction carries: is its unit right?")
    for record in records:
        guess, file = record.guess, record.roles.file
        if (count := guess.time.size) > _MANY_SAMPLES:
            said.append(f"{file}: {count} samples make a slow fit; the keys window and decimate keep fewer")
        if record.gaps:
            said.append(f"{file}: found {record.left_out} samples that are no numbers; the record excludes them")
        gain = gain_of(guess)
        if gain > _MOST_GAIN:
            said.append(
                f"{file}: found {1e6 * gain:.3g} um/V, more than a stack moves. If the voltage was recorded before the "
                "amplifier, add --scale voltage=20 or so; if the motion is in a sensor's millivolts, add "
                "--unit displacement=mV and its --scale"
            )
        elif volts := _before_an_amplifier(record, gain):
            said.append(
                f"{file}: found {volts} at most, as a monitor or a command of an amplifier has. A study wants the "
                "voltage at the piezo: for a monitor of 1:20 add --scale voltage=20"
            )
        said += [f"{file}: found {what}" for what in _describe_implausible(record)]
        if gain < _LEAST_GAIN:
            said.append(
                f"{file}: found {1e9 * gain:.3g} nm/V, less than a stack moves: is the displacement's unit right?"
            )
    for line in said:
        note(f"warning: {line}")


def _describe_implausible(record: "NewRecord") -> list[str]:
    """The properties of a record that no rig can have, or no waveform of a study, in words."""
    from ..files import drive_of_samples
    from ..metrics import clipped_counts, describe_hold, rounding_of

    said, guess = [], record.guess
    numbers = guess.waveform.numbers
    frequency, peak = numbers.get("frequency"), abs(numbers.get("voltage", 0.0))
    if frequency is not None and not _SLOWEST_DRIVE < frequency < _FASTEST_DRIVE:
        said.append(f"a drive of {frequency:.3g} Hz: is the clock's unit right?")
    if peak > 1000.0:
        said.append(f"{peak:.4g} V, more than stacks bear: is the voltage's unit or scale right?")
    measured = guess.motion if guess.velocity is None else guess.velocity
    for end, count in clipped_counts(measured, guess.volts).items():
        said.append(
            f"{count} samples at exactly the {end} of all, one after the other: a sensor or a scope at the end of its "
            "range shows nothing there; leave them out (exclude)"
        )
    if held := describe_hold(measured):
        said.append(held)
    # Second half of a fast flank over its first one, in time.
    ratio = 0.0 if guess.volts is None else rounding_of(guess.time, guess.volts, guess.waveform)
    if ratio > 1.4:
        said.append(
            f"a fast flank that is no straight line: its second half takes {ratio:.2g} times as long as its first one, "
            'as behind an amplifier (2.7). List "amplifier.bandwidth" = {} among the parameters, or take its samples: '
            f"{drive_of_samples(record)}"
        )
    return said


def _before_an_amplifier(record: "NewRecord", gain: float) -> str:
    """The greatest voltage of a record, in words, where it may not be that at the piezo; else ""."""
    channel, layout = record.roles.channels.get("voltage"), record.roles.layout
    if channel is None or "voltage" in layout.scales:
        return ""
    peak = abs(record.guess.waveform.numbers["voltage"])
    words = ("mon", "cmd", "command", "control", "sense", "setpoint", "soll")
    named = any(word in channel.name.lower() for word in words)
    # Monitors and commands have 10 V at most, and some overshoot.
    return f"{peak:.3g} V" if peak < 10.5 and (named or gain > _MOST_USUAL_GAIN) else ""


def _hints(options: argparse.Namespace) -> "Hints":
    from ..files import Hints

    columns = {q: getattr(options, q) for q in QUANTITIES if getattr(options, q)}
    scales: dict[str, float | str] = {
        quantity: number_or_text(text)
        for quantity, text in read_pairs(options.scale, "--scale", QUANTITIES, "displacement=0.5 um/V").items()
    }
    for quantity, factor in scales.items():
        number = split_text(factor, "option --scale")[0] if isinstance(factor, str) else factor
        if number == 0 or not math.isfinite(number):
            raise InputError(f'option --scale: found "{quantity}={factor}", expected a finite number that is not 0.')
    units = read_pairs(options.unit, "--unit", QUANTITIES, "displacement=um")
    return Hints(columns, units, scales, _number(options, "interval", "s"), options.decimal or "")


def _number(options: argparse.Namespace, key: str, unit: str, above: float | None = 0.0) -> float | None:
    """The number [SI] of an option; None where it is left out."""
    text = getattr(options, key)
    return None if text is None else read_number(text, unit, f"option --{key}", above=above)


def _measures(options: argparse.Namespace) -> dict[Path, str]:
    """What was measured in each file, where that was told: of all, or of those whose name a pattern is."""
    of_all, of_some = {}, {}
    for text in options.measures:
        pattern, _, kind = (part.strip() for part in text.rpartition("="))
        if kind not in ("platform", "effector"):
            raise InputError(
                f'option --measures: found "{text}", expected "platform" or "effector", of some files after their name '
                'or a pattern of names: "step*.csv=platform".'
            )
        fits = lambda name, pattern=pattern: name == pattern or fnmatch(name, pattern)
        meant = [file for file in options.files if not pattern or fits(file.name) or fits(str(file))]
        if not meant:
            names = ", ".join(file.name for file in options.files)
            raise InputError(f'option --measures: found "{pattern}", expected the name of a file of --files: {names}.')
        (of_some if pattern else of_all).update(dict.fromkeys(meant, kind))
    return of_all | of_some


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=new)
    parser.add_argument("folder", type=Path, metavar="DIR", help="new or empty folder for the study")
    text = "records (CSV, MATLAB, TDMS, HDF5, oscilloscope); one of each run of the rig"
    parser.add_argument("--files", nargs="+", type=Path, required=True, metavar="FILE", help=text)
    for quantity, unit in QUANTITIES.items():
        text = f"channel of the {quantity}, by name or number (default: found by unit [{unit}], name or shape)"
        text += '; "none" where none was recorded' if quantity == "voltage" else ""
        parser.add_argument(f"--{quantity}", metavar="COL", help=text)
    text = "unit of time, voltage, displacement, velocity or force, where the file does not tell it; repeatable"
    parser.add_argument("--unit", action="append", default=[], metavar="QUANTITY=UNIT", help=text)
    text = 'factor of voltage, displacement, velocity or force, such as "displacement=0.5 um/V"; repeatable'
    parser.add_argument("--scale", action="append", default=[], metavar="QUANTITY=FACTOR", help=text)
    text = 'time between samples where no clock was stored, such as "50 us"'
    parser.add_argument("--interval", metavar="T", help=text)
    parser.add_argument("--decimal", choices=[",", "."], help="decimal sign of text files (default: found in each)")
    text = "platform or effector: what was measured in all files, or in those of a name or pattern (default: guessed "
    text += "for each); repeatable"
    parser.add_argument("--measures", action="append", default=[], metavar="[FILE=]KIND", help=text)
    parser.add_argument("--peak", metavar="V", help='voltage of the drive where it was not recorded, such as "30 V"')
    text = "frequency of the drive where its voltage was not recorded (default: found in the motion)"
    parser.add_argument("--frequency", metavar="F", help=text)
    parser.add_argument("--mass", metavar="M", help='mass of the end-effector, such as "86 g"')
    parser.add_argument("--title", help="title of the study (default: the folder's name)")
