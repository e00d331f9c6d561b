"""The options of intervals by drawing, and what they ask for."""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import InputError

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from typing import TypedDict

    from ..inference import Drawing, Intervals

    class More(TypedDict, total=False):
        """Arguments of `pdssjax.identify` that most runs do without."""

        drawing: Drawing
        starts: int
        executor: Executor


DRAWN = "bootstrap", "posterior"


def add_drawing(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("of --intervals bootstrap and posterior")
    group.add_argument("--replicates", type=int, metavar="N", help="fits of the bootstrap (default 1000)")
    group.add_argument("--draws", type=int, metavar="N", help="of each of the posterior's 4 chains (default 1000)")
    text = "of the random numbers (default 0); the same seed gives the same draws"
    group.add_argument("--seed", type=int, default=0, metavar="N", help=text)
    text = "the bootstrap draws white noise (default), or whole cycles of the residuals where a drive repeats"
    group.add_argument("--resample", choices=["noise", "cycles"], default="noise", help=text)
    text = "go on with the draws that DIR holds of a run that was broken off, or with more of them"
    group.add_argument("--resume", action="store_true", help=text)


def check_drawing(options: argparse.Namespace) -> None:
    """**Raises** `InputError` where options ask for what the kind of intervals does not have."""
    for name, kind in (("replicates", "bootstrap"), ("draws", "posterior")):
        count = getattr(options, name)
        if count is not None and options.intervals != kind:
            raise InputError(f"option --{name}: found with --intervals {options.intervals}, expected {kind}.")
        if count is not None and count < 2:
            raise InputError(f"option --{name}: found {count}, expected at least 2.")
    if options.seed < 0:
        raise InputError(f"option --seed: found {options.seed}, expected 0 or more.")
    if options.starts < 0:
        raise InputError(f"option --starts: found {options.starts}, expected 0 or more.")
    if options.resume and options.intervals not in DRAWN:
        raise InputError(f"option --resume: found with --intervals {options.intervals}, expected {' or '.join(DRAWN)}.")


def more_of(options: argparse.Namespace, intervals: "Intervals", folder: Path) -> "More":
    """What is drawn and kept in `folder`, and how many starts are compared, on all cores."""
    from concurrent.futures import ThreadPoolExecutor

    from ..files import DrawsFile
    from ..inference import Drawing

    more: More = {}
    file = DrawsFile(folder, options.resume and intervals in DRAWN)
    if not options.resume:
        file.forget()
    if intervals in DRAWN:
        count = options.replicates if intervals == "bootstrap" else options.draws
        more["drawing"] = Drawing(count=count, seed=options.seed, resampled=options.resample, store=file)
    if options.starts:
        more["starts"] = options.starts
    if more:
        more["executor"] = ThreadPoolExecutor(os.cpu_count())
    return more
