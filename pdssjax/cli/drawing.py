"""The options of intervals by drawing, and what they ask for."""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import InputError
from .option_values import SEED, whole

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from typing import TypedDict

    from ..inference import Drawing, Intervals

    class More(TypedDict, total=False):
        """Arguments of `pdssjax.identify` that most runs do without."""

        drawing: Drawing
        starts: int
        executor: Executor
        effort: str
        check_with: str


DRAWN = "bootstrap", "posterior"


_BELONGS_TO = {
    "replicates": ("bootstrap",),
    "resample": ("bootstrap",),
    "draws": ("posterior",),
    "sampler": ("posterior",),
    "seed": DRAWN,
    "resume": DRAWN,
}
"""The kinds of intervals that have each option."""


def add_drawing(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("of --intervals bootstrap and posterior")
    group.add_argument("--replicates", type=whole(2), metavar="N", help="fits of the bootstrap (default 1000)")
    group.add_argument("--draws", type=whole(2), metavar="N", help="of each of the posterior's 4 chains (default 1000)")
    text = (
        "how the posterior is drawn: randomize-then-optimize (default), or, as a second opinion that takes several "
        "times as long, the No-U-Turn sampler of NumPyro"
    )
    group.add_argument("--sampler", choices=["rto", "nuts"], help=text)
    text = "of the random numbers (default 0); the same seed gives the same draws"
    group.add_argument("--seed", type=SEED, metavar="N", help=text)
    text = "the bootstrap draws white noise (default), or whole cycles of the residuals where a drive repeats"
    group.add_argument("--resample", choices=["noise", "cycles"], help=text)
    text = "go on with the draws that DIR holds of a run that was broken off, or with more of them"
    group.add_argument("--resume", action="store_true", help=text)


def check_drawing(options: argparse.Namespace) -> None:
    """**Raises** `InputError` where options ask for what the kind of intervals does not have."""
    for name, kinds in _BELONGS_TO.items():
        if getattr(options, name) not in (None, False) and options.intervals not in kinds:
            raise InputError(
                f"option --{name}: found with --intervals {options.intervals}, expected {' or '.join(kinds)}."
            )


def more_of(options: argparse.Namespace, intervals: "Intervals", folder: Path, resume: bool) -> "More":
    """Keyword arguments of `identify` by the options: draws kept in `folder`, starts, cores, effort, check.

    **Arguments:** whether to `resume` what `folder` holds.

    **Raises:** `InputError` where there is nothing to resume.
    """
    from concurrent.futures import ThreadPoolExecutor

    from ..files import DrawsFile
    from ..inference import Drawing

    more: More = {}
    file = DrawsFile(folder, resume and intervals in DRAWN)
    if not resume:
        file.forget()
    if intervals in DRAWN:
        count = options.replicates if intervals == "bootstrap" else options.draws
        more["drawing"] = Drawing(count, options.seed or 0, options.resample or "noise", file, options.sampler or "rto")
    if options.starts:
        more["starts"] = options.starts
    if more or intervals == "profile":
        more["executor"] = ThreadPoolExecutor(os.cpu_count())
    if options.effort != "usual":
        more["effort"] = options.effort
    if options.check_with:
        more["check_with"] = options.check_with
    return more
