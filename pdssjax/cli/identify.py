"""`pdssjax identify`: estimates an actuator's parameters from the records of a study."""

import argparse
import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import MOST_STARTS, InputError, members
from .console import note, progress, say
from .numbers import add_check, add_solver, with_solver
from .option_values import SEED, whole
from .results import NOT_WRITTEN, add_out, keep_results, reserved

if TYPE_CHECKING:
    from concurrent.futures import Executor
    from typing import TypedDict

    from ..inference import Drawing, Intervals, Method
    from ..study import Estimate, Study

    class FurtherArguments(TypedDict, total=False):
        """Arguments of `pdssjax.identify` that most runs do without."""

        drawing: Drawing
        starts: int
        executor: Executor
        effort: str
        check_with: str


DRAWN = "bootstrap", "posterior"


_INTERVALS_WITH = {
    "replicates": ("bootstrap",),
    "resample": ("bootstrap",),
    "draws": ("posterior",),
    "sampler": ("posterior",),
    "seed": DRAWN,
    "resume": DRAWN,
}
"""The kinds of intervals that have each option."""


def identify(options: argparse.Namespace) -> int:
    _check_drawing(options)
    with reserved(options, *(_SIDE_BY_SIDE if options.method == "both" else ())):
        return _identify(options)


def _identify(options: argparse.Namespace) -> int:
    from ..core import prepare_jax
    from ..files import EXAMPLE, holds_draws, starting_at_estimate

    prepare_jax(dedicated=True)
    import pdssjax

    from ..inference import check_intervals, has_intervals

    if options.method != "both":
        check_intervals(options.intervals, options.method)
    study = with_solver(pdssjax.load_study(options.study or EXAMPLE / "study.toml"), options)
    if options.estimate is not None:
        study = starting_at_estimate(study, options.estimate)
    methods = _methods_for(study) if options.method == "both" else [options.method]
    folders: dict[Method, Path] = {
        method: options.out / method if len(methods) > 1 else options.out for method in methods
    }
    estimates: dict[Method, Estimate] = {}
    written = True
    for method, folder in folders.items():
        intervals = options.intervals if has_intervals(method, options.intervals) else "linear"
        loss: str = options.loss if method == "joint" or len(methods) == 1 else "squares"
        # A run that was broken off in an earlier one of several ways has drawn nothing of those after it.
        resume = options.resume and (not estimates or holds_draws(folder))
        further = _further_arguments(options, intervals, folder, resume)
        found = _fit(study, method, intervals, loss, further, folder)
        estimates[method] = _with_notes(found, options, intervals, loss)
        written &= _report_and_keep(estimates[method], folder)
    if len(methods) > 1:
        written &= _report_side_by_side(list(estimates.values()), options.out)
    if written:
        say(f"Results are in {options.out}")
    # Of several ways the first is the best: the others need not explain what is compared.
    failed = [e for n, e in enumerate(estimates.values()) if not (e.converged if n else e.success)]
    for estimate in failed:
        note(f"warning: the {estimate.method} fit {estimate.verdict}: {_why(estimate)}")
    return NOT_WRITTEN if not written else 3 if failed else 0


def _why(estimate: "Estimate") -> str:
    if not estimate.converged:
        return estimate.message
    return f"{estimate.why_unexplained}. The law lacks something, or the optimum is wrong: see the notes"


_SIDE_BY_SIDE: "list[Method]" = ["joint", "sequential", "peaks"]
"""What --method both compares."""


def _with_notes(estimate: "Estimate", options: argparse.Namespace, intervals: "Intervals", loss: str) -> "Estimate":
    """The estimate with the command, and notes where it lacks the intervals or the loss of the `options`."""
    import dataclasses

    notes = []
    if options.intervals != intervals:
        notes.append(
            f"No {options.intervals}: the {estimate.method} method has none, and its intervals are {intervals}."
        )
    if options.loss != loss:
        notes.append(
            f"No {options.loss}: the {estimate.method} method has no robust loss, and glitches pull it as they do "
            "least squares."
        )
    made = dataclasses.replace(estimate.provenance, command=options.command_line)
    return dataclasses.replace(estimate, notes=(*estimate.notes, *notes), provenance=made)


def _methods_for(study: "Study") -> "list[Method]":
    """The methods that can fit a study; if peaks cannot be read from its records, print why.

    **Raises:** `InputError` where they allow no two of them.
    """
    from ..inference import check_method, pick_peaks

    check_method(study, "sequential")
    try:
        pick_peaks(study)
    except InputError as error:
        note(f"without peaks: {error}")
        return _SIDE_BY_SIDE[:2]
    return _SIDE_BY_SIDE


def _report_side_by_side(estimates: "list[Estimate]", folder: Path) -> bool:
    """Print the fits side by side and write the comparison; whether `folder` took it."""
    from ..files import write_comparison
    from ..report.text import format_comparison

    say(format_comparison(*estimates))
    return keep_results(lambda place: write_comparison(estimates, place), folder)


def _fit(
    study: "Study", method: "Method", intervals: "Intervals", loss: str, further: "FurtherArguments", folder: Path
) -> "Estimate":
    """Identify a study; if the fit is interrupted, write the best point so far to `folder`."""
    import pdssjax

    from ..files import write_essentials
    from ..report.text import format_report

    try:
        with progress() as tell:
            return pdssjax.identify(study, method=method, intervals=intervals, loss=loss, progress=tell, **further)
    except pdssjax.FitInterrupted as interrupt:
        kept = interrupt.estimate
        if kept is None:
            note("interrupted while searching for starts; nothing is written")
        else:
            say(format_report(kept))
            if keep_results(lambda place: write_essentials(kept, place), folder, kept):
                what, file = "estimate" if kept.converged else "best point so far", folder / "estimate.json"
                note(f"the {what} is in {file}")
                if not kept.converged:
                    note(f"a fit with --estimate {file} goes on from there")
            if intervals in DRAWN and kept.converged:
                note("what was drawn is kept; the same command with --resume goes on")
        raise


def _report_and_keep(estimate: "Estimate", folder: Path) -> bool:
    """Print the report of an `estimate` and write all that belongs to it; whether `folder` took it.

    The estimate itself is written before the report is printed, and plots after it.
    """
    from ..files import write_essentials, write_estimate
    from ..report.text import format_report

    try:
        # Where that fails it is tried, and said, again below.
        with contextlib.suppress(OSError, InputError):
            write_essentials(estimate, folder)
        say(format_report(estimate))
        with progress() as tell:
            tell("writing report, predictions and plots")
            return keep_results(lambda place: write_estimate(estimate, place), folder, estimate)
    except KeyboardInterrupt:
        if keep_results(lambda place: write_essentials(estimate, place), folder, estimate):
            note(f"the estimate is in {folder / 'estimate.json'}, without plots")
        raise


def _check_drawing(options: argparse.Namespace) -> None:
    """**Raises** `InputError` where options ask for what the kind of intervals does not have."""
    for name, kinds in _INTERVALS_WITH.items():
        if getattr(options, name) not in (None, False) and options.intervals not in kinds:
            raise InputError(
                f"option --{name}: found with --intervals {options.intervals}, expected {' or '.join(kinds)}."
            )


def _further_arguments(
    options: argparse.Namespace, intervals: "Intervals", folder: Path, resume: bool
) -> "FurtherArguments":
    """Keyword arguments of `identify` by the options: draws kept in `folder`, starts, cores, effort, check.

    **Arguments:** whether to `resume` what `folder` holds.

    **Raises:** `InputError` where there is nothing to resume.
    """
    from concurrent.futures import ThreadPoolExecutor

    from ..files import DrawsFile
    from ..inference import Drawing

    further: FurtherArguments = {}
    file = DrawsFile(folder, resume and intervals in DRAWN)
    if not resume:
        file.forget()
    if intervals in DRAWN:
        count = options.replicates if intervals == "bootstrap" else options.draws
        further["drawing"] = Drawing(
            count, options.seed or 0, options.resample or "noise", file, options.sampler or "rto"
        )
    if options.starts:
        further["starts"] = options.starts
    if further or intervals == "profile":
        further["executor"] = ThreadPoolExecutor(os.cpu_count())
    if options.effort != "usual":
        further["effort"] = options.effort
    if options.check_with:
        further["check_with"] = options.check_with
    return further


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `identify`."""
    parser.set_defaults(run=identify)
    parser.add_argument(
        "study",
        nargs="?",
        type=Path,
        metavar="STUDY",
        help="study file (TOML); left out: the packaged example",
    )
    text = "start from the numbers of an estimate.json, such as that of a fit that was broken off"
    parser.add_argument("--estimate", type=Path, metavar="FILE", help=text)
    parser.add_argument(
        "--method",
        choices=["joint", "sequential", "peaks", "both"],
        default="joint",
        help="all parameters at once (default); the piezo first, by least squares or, as in the thesis, from the peaks "
        "of its step responses; or both: joint and sequential side by side, and peaks where the records show them",
    )
    parser.add_argument(
        "--intervals",
        choices=["linear", "profile", "bootstrap", "posterior"],
        default="linear",
        help="symmetric ones from the standard errors (default); of the joint fit by profile likelihood, which "
        "hold where chi-square is no parabola and say which end is open; or of its posterior; or of a bootstrap",
    )
    parser.add_argument(
        "--loss",
        choices=members("inference.losses"),
        default="squares",
        help="of the joint fit: the sum of squares (default), or a robust one, under which glitches pull little; it "
        "has linear intervals only",
    )
    parser.add_argument(
        "--effort",
        choices=["quick", "usual", "thorough"],
        default="usual",
        help="how many starts a doubtful fit is compared with, how many evaluations that may take, and after how many "
        "slow steps a fit ends (default: usual)",
    )
    text = "fit from N more starts, spread over their ranges, on all cores, and compare where they end"
    parser.add_argument("--starts", type=whole(0, MOST_STARTS), default=0, metavar="N", help=text)
    add_solver(parser)
    add_check(parser)
    _add_drawing_options(parser)
    add_out(parser)


def _add_drawing_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of intervals by drawing."""
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
