"""`pdssjax channels`: lists what is inside files of instruments."""

import argparse
from pathlib import Path

from ..core import InputError
from .console import note, say


def channels(options: argparse.Namespace) -> int:
    from ..files import list_channels
    from ..report.text import format_channels

    status = 0
    for file in options.files:
        try:
            say(format_channels(str(file), *list_channels(file, options.decimal or "")), end="")
        except InputError as error:
            note(f"error: {error}")
            status = 2
    return status


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=channels)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="file of an instrument")
    parser.add_argument("--decimal", choices=[",", "."], help="decimal sign of a text file (default: found in it)")
