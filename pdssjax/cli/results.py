"""Where the results of a command go: the option, the attempt to write them, and the exit status."""

import argparse
import contextlib
import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import InputError
from .console import note, say

if TYPE_CHECKING:
    from ..study import Estimate


def add_out(parser: argparse.ArgumentParser, required: bool = True) -> None:
    parser.add_argument("--out", type=Path, required=required, metavar="DIR", help="folder for the results")
    parser.add_argument("--overwrite", action="store_true", help="replace results that DIR already holds")


@contextlib.contextmanager
def reserved(options: argparse.Namespace, *below: str) -> Iterator[None]:
    """Reserve the folder of `--out`, and what is `below` it, for this command; without `--out` reserve nothing."""
    from ..files import reserved_folder

    replaces = options.overwrite or getattr(options, "resume", False)
    with contextlib.ExitStack() as folders:
        if options.out is not None:
            for folder in (options.out, *(options.out / name for name in below)):
                folders.enter_context(reserved_folder(folder, replaces))
        yield


def reserving(command: Callable[[argparse.Namespace], int]) -> Callable[[argparse.Namespace], int]:
    """`command` with the folder of its `--out` `reserved`."""

    @functools.wraps(command)
    def run(options: argparse.Namespace) -> int:
        with reserved(options):
            return command(options)

    return run


NOTHING_FOUND = 3
"""Exit status where no point of a sweep, or no record of a simulation, could be computed."""

NOT_WRITTEN = 4
"""Exit status where results could not be written to the folder asked for."""


def keep_results(write: Callable[[Path], None], folder: Path, estimate: "Estimate | None" = None) -> bool:
    """`write` results to `folder`, or where that fails to one for temporary files, or print the `estimate`.

    Whether `folder` took them.
    """
    from ..files import estimate_text, write_aside

    try:
        write(folder)
        return True
    except OSError as error:
        note(f"error: {folder}: cannot be written to ({error.strerror or error})")
    except InputError as error:
        note(f"error: {error}")
    try:
        note(f"the results are in {write_aside(write)} instead")
    except OSError as error:
        instead = "the results are lost" if estimate is None else "the estimate is printed here"
        note(f"nor is there room for temporary files ({error.strerror or error}); {instead}")
        if estimate is not None:
            say(estimate_text(estimate))
    return False


def say_where(written: bool, where: str) -> int:
    """The exit status; says `where` the results are if they were `written` there."""
    if written:
        say(where)
    return 0 if written else NOT_WRITTEN
