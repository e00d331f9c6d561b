"""`pdssjax characterise`: step efficiency, speed and output force from records alone."""

import argparse
from pathlib import Path
from typing import Any

from ..core import InputError
from .console import note, say
from .option_values import read_number, read_pairs
from .results import add_out, keep_results, reserving, say_where


def _read_options(options: argparse.Namespace) -> dict[str, Any]:
    """The arguments of `pdssjax.characterise` for all files."""
    frequency = window = None
    if options.frequency is not None:
        frequency = read_number(options.frequency, "Hz", "option --frequency", above=0.0)
    slip_duration = read_number(options.slip_duration, "s", "option --slip-duration", least=0.0)
    if options.window:
        start, end = (read_number(end, "s", "option --window") for end in options.window)
        window = (start, end)
        if start >= end:
            raise InputError(f"option --window: found {start:g} s to {end:g} s, expected an end after its start.")
    units = read_pairs(options.unit, "--unit", ("time", "displacement", "force"), "displacement=um")
    how = {name: getattr(options, name) for name in ("time", "displacement", "force")}
    how |= {"units": units, "frequency": frequency, "window": window, "slip_duration": slip_duration}
    return how | {"decimal": options.decimal or ""}


@reserving
def characterise(options: argparse.Namespace) -> int:
    from ..core import prepare_jax

    how = _read_options(options)
    prepare_jax(dedicated=True)
    from ..files import characterise, write_characterisations
    from ..report.text import format_characterisation

    found, status = [], 0
    for file in options.files:
        try:
            found.append(characterise(file, **how))
        except InputError as error:
            # The other files are characterised all the same.
            note(f"error: {error}")
            status = 2
    keeps = bool(options.out and found)
    written = keeps and keep_results(lambda place: write_characterisations(found, place), options.out)
    say("\n".join(map(format_characterisation, found)), end="")
    return (say_where(written, f"\nResults are in {options.out}") if keeps else 0) or status


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=characterise)
    text = "record (CSV, MATLAB, TDMS, HDF5, oscilloscope)"
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help=text)
    parser.add_argument("--time", metavar="COL", help='column of the times (default: the one named "time...")')
    measured = parser.add_mutually_exclusive_group()
    text = "column of the displacements (default: the one whose name ends in a length)"
    measured.add_argument("--displacement", metavar="COL", help=text)
    measured.add_argument("--force", metavar="COL", help="column of a blocked actuator's force")
    text = "unit of time, displacement or force, where the column's name does not end in it; repeatable"
    parser.add_argument("--unit", action="append", default=[], metavar="QUANTITY=UNIT", help=text)
    parser.add_argument("--frequency", metavar="F", help='frequency of the drive, such as "5 Hz" (default: found)')
    text = 'part of the record to use, such as "0.2 s" "1.8 s"'
    parser.add_argument("--window", nargs=2, metavar=("START", "END"), help=text)
    parser.add_argument("--decimal", choices=[",", "."], help="decimal sign of text files (default: found in each)")
    text = "how long a slip takes, which does not count as sticking (default 0)"
    parser.add_argument("--slip-duration", default="0", metavar="T", help=text)
    add_out(parser, required=False)
