"""The command `pdssjax`: its options, and its exit status.

0 when it worked, 2 when the input is at fault, 3 when a fit did not converge (its best result
is written all the same), 4 when results could not be written to the folder asked for (the last
lines say where they are instead).  Broken off, 130 (Ctrl-C), 143 (SIGTERM) or 129 (SIGHUP); a
fit then leaves the best point so far in its folder, marked.
"""

import argparse
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from . import commands
from .commands import EXAMPLE as EXAMPLE
from .console import announce_warnings
from .errors import InputError, InputWarning
from .signals import exit_status, requests_to_end


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit status; `arguments` default to the process's own."""
    with warnings.catch_warnings(), requests_to_end() as received:
        warnings.simplefilter("always", InputWarning)
        warnings.showwarning = announce_warnings(warnings.showwarning)
        try:
            options = _parser().parse_args(arguments)
            return options.run(options)
        except (InputError, OSError) as error:
            print(f"pdssjax: error: {error}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print("pdssjax: interrupted", file=sys.stderr)
            return exit_status(received)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message} (see {self.prog} --help)")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="pdssjax",
        description="Models and identifies piezoelectric stick-slip actuators.",
        epilog="Exit status: 0 it worked; 2 the input is at fault; 3 a fit did not converge, its best result is "
        "written; 4 results could not be written where asked; 130 or 143 interrupted or terminated, a fit leaves its "
        "best point so far in estimate.json.",
    )
    subcommands = parser.add_subparsers(required=True, metavar="COMMAND")

    text = "estimate an actuator's parameters, with uncertainties, from the records of a study"
    identify = subcommands.add_parser("identify", help=text, description=text)
    identify.set_defaults(run=commands.identify)
    identify.add_argument(
        "study",
        nargs="?",
        type=Path,
        default=EXAMPLE / "study.toml",
        metavar="STUDY",
        help="study file (TOML); left out: the packaged example",
    )
    identify.add_argument(
        "--method",
        choices=["joint", "sequential", "both"],
        default="joint",
        help="all parameters at once (default), the piezo first as in the thesis, or both side by side",
    )
    _add_out(identify)

    text = "predict every record of a study, at its values and starts or at those of an estimate"
    simulate = subcommands.add_parser("simulate", help=text, description=text)
    simulate.set_defaults(run=commands.simulate)
    simulate.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML)")
    _add_numbers(simulate)
    _add_out(simulate)

    text = "tell from records alone how well an actuator walks or pushes (thesis, chapter 3)"
    characterise = subcommands.add_parser("characterise", help=text, description=text)
    characterise.set_defaults(run=commands.characterise)
    characterise.add_argument("files", nargs="+", type=Path, metavar="FILE", help="record (CSV)")
    characterise.add_argument("--time", metavar="COL", help='column of the times; left out: the one named "time..."')
    measured = characterise.add_mutually_exclusive_group()
    text = "column of the displacements; left out: the one whose name ends in a length"
    measured.add_argument("--displacement", metavar="COL", help=text)
    measured.add_argument("--force", metavar="COL", help="column of a blocked actuator's force")
    text = "unit of time, displacement or force, where the column's name does not end in it; repeatable"
    characterise.add_argument("--unit", action="append", default=[], metavar="QUANTITY=UNIT", help=text)
    characterise.add_argument("--frequency", metavar="F", help='of the drive, such as "5 Hz"; left out: found')
    text = 'part of the record to use, such as "0.2 s" "1.8 s"'
    characterise.add_argument("--window", nargs=2, metavar=("START", "END"), help=text)
    text = "how long a slip takes, which does not count as sticking (default 0)"
    characterise.add_argument("--slip-duration", default="0", metavar="T", help=text)
    _add_out(characterise, required=False)

    text = "make the records of a study on a virtual rig, with noise, zeros and rounding, from a seed"
    record = subcommands.add_parser("record", help=text, description=text)
    record.set_defaults(run=commands.record)
    record.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML) whose parameters all have numbers")
    _add_numbers(record)
    record.add_argument("--seed", type=int, default=0, help="another seed, other noise (default 0)")
    _add_out(record)

    text = "net step, speed and step efficiency over a grid of drive quantities and parameters"
    sweep = subcommands.add_parser("sweep", help=text, description=text)
    sweep.set_defaults(run=commands.sweep)
    sweep.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML)")
    _add_numbers(sweep)
    sweep.add_argument(
        "--voltage", metavar="FROM:TO:COUNT", help='axis of the drive, such as 20:80:40 or "20 V:80 V:40"'
    )
    sweep.add_argument("--frequency", metavar="FROM:TO:COUNT", help="axis of the drive; 2:50:25:log for equal ratios")
    sweep.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="PATH=FROM:TO:COUNT",
        help='any other axis, such as "drive.fall_time=0 ms:2 ms:20"; may be repeated',
    )
    sweep.add_argument("--record", metavar="NAME", help="the effector record whose drive to vary (default: the first)")
    sweep.add_argument("--cycles", type=int, default=4, help="the cycle that is measured (default 4)")
    sweep.add_argument("--store", choices=["netcdf", "zarr"], default="netcdf", help="format (default netcdf)")
    _add_out(sweep)

    text = "list the drives, piezos, friction laws and parts of a rig that a study may name, or explain one"
    models = subcommands.add_parser("models", help=text, description=text)
    models.set_defaults(run=commands.models)
    models.add_argument(
        "name", nargs="?", metavar="NAME", help='one of them, such as "lugre": equations and parameters'
    )

    text = "copy the packaged study, as a start for your own"
    example = subcommands.add_parser("example", help=text, description=text)
    example.set_defaults(run=commands.example)
    example.add_argument("folder", type=Path, metavar="DIR", help="new or empty folder")
    return parser


def _add_numbers(parser: argparse.ArgumentParser) -> None:
    text = "take the parameters' numbers from an estimate.json in place of the study's values and starts"
    parser.add_argument("--estimate", type=Path, metavar="FILE", help=text)
    text = "guess from the records what then has no number: rough, where a fit may begin; without it that is an error"
    parser.add_argument("--guess", action="store_true", help=text)


def _add_out(parser: argparse.ArgumentParser, required: bool = True) -> None:
    parser.add_argument("--out", type=Path, required=required, metavar="DIR", help="folder for the results")
    parser.add_argument("--overwrite", action="store_true", help="replace results that DIR already holds")
