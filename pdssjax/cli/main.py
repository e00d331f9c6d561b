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
from typing import NoReturn

from ..core import InputError, InputWarning
from . import channels, characterise, example, explore, identify, models, new, record, schema, simulate, sweep
from .console import announce_warnings
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


class _Version(argparse.Action):
    """Prints the version; what tells it is imported only then."""

    def __call__(self, parser: argparse.ArgumentParser, *rest: object) -> None:
        from importlib.metadata import version

        print(f"pdssjax {version('pdssjax')}")
        parser.exit()


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="pdssjax",
        description="Models and identifies piezoelectric stick-slip actuators.",
        epilog="Exit status: 0 it worked; 2 the input is at fault; 3 a fit did not converge, its best result is "
        "written; 4 results could not be written where asked; 130 or 143 interrupted or terminated, a fit leaves its "
        "best point so far in estimate.json.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    subcommands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in (identify, new, simulate, explore, channels, characterise, record, sweep, models, schema, example):
        command.add_parser(subcommands)
    return parser
