"""`pdssjax identify`: estimates an actuator's parameters from the records of a study."""

import argparse
import contextlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..core import MOST_STARTS, InputError, members
from .console import note, progress, say
from .numbers import add_check, add_solver, with_solver
from .option_values import SEED, whole
from .results import NOT_WRITTEN, add_out, keep_results, reserved

if TYPE_CHECKING:
    from ..inference import Intervals, Method
    from ..study import Estimate, Study


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
    for name, kinds in _INTERVALS_WITH.items():
        if getattr(options, name) not in (None, False) and options.intervals not in kinds:
            raise InputError(
                f"option --{name}: found with --intervals {options.intervals}, expected {' or '.join(kinds)}."
            )
    with reserved(options, *(_SIDE_BY_SIDE if options.method == "both" else ())):
        return _identify(options)


def _identify(options: argparse.Namespace) -> int:
    from ..core import prepare_jax
    from ..files import EXAMPLE, holds_draws, starting_at_estimate, write_comparison
    from ..report.text import format_comparison

    prepare_jax(dedicated=True)
    import pdssjax

    from ..inference import check_intervals, has_intervals

    if options.method != "both":
        check_intervals(options.intervals, options.method)
    study = with_solver(pdssjax.load_study(options.study or EXAMPLE / "study.toml"), options)
    if options.estimate is not None:
        study = starting_at_estimate(study, options.estimate)
    methods: list[Method] = _methods_for(study) if options.method == "both" else [options.method]
    estimates: list[Estimate] = []
    written = True
    for method in methods:
        folder: Path = options.out / method if len(methods) > 1 else options.out
        intervals = options.intervals if has_intervals(method, options.intervals) else "linear"
        loss: str = options.loss if method == "joint" or len(methods) == 1 else "squares"
        # A run that was broken off in an earlier one of several ways has drawn nothing of those after it.
        resume = options.resume and (not estimates or holds_draws(folder))
        further = _further_arguments(options, intervals, folder, resume)
        found = _fit(study, method, intervals, loss, further, folder)
        estimates.append(_with_notes(found, options, intervals, loss))
        written &= _report_and_keep(estimates[-1], folder)
    if len(methods) > 1:
        say(format_comparison(*estimates))
        written &= keep_results(lambda place: write_comparison(estimates, place), options.out)
    if written:
        say(f"Results are in {options.out}")
    # Of several ways the first is the best: the others need not explain what is compared.
    failed = [e for n, e in enumerate(estimates) if not (e.converged if n else e.success)]
    for estimate in failed:
        why = estimate.message
        if estimate.converged:
            why = f"{estimate.why_unexplained}. The law lacks something, or the optimum is wrong: see the notes"
        note(f"warning: the {estimate.method} fit {estimate.verdict}: {why}")
    return NOT_WRITTEN if not written else 3 if failed else 0


_SIDE_BY_SIDE: "list[Method]" = ["joint", "sequential", "peaks"]
"""What --method both compares."""


def _with_notes(estimate: "Estimate", options: argparse.Namespace, intervals: "Intervals", loss: str) -> "Estimate":
    """The estimate with the command, and notes where it lacks the intervals or the loss of the `options`."""
    import dataclasses

    notes, method = [], f"the {estimate.method} method has"
    if options.intervals != intervals:
        notes.append(f"No {options.intervals}: {method} none, and its intervals are {intervals}.")
    if options.loss != loss:
        notes.append(f"No {options.loss}: {method} no robust loss, and glitches pull it as they do least squares.")
    made = dataclasses.replace(estimate.provenance, command=options.command_line)
    return dataclasses.replace(estimate, notes=(*estimate.notes, *notes), provenance=made)


def _methods_for(study: "Study") -> "list[Method]":
    """The methods that can fit a study; if peaks cannot be read from its records, print why."""
    from ..inference import check_method, pick_peaks

    check_method(study, "sequential")
    try:
        pick_peaks(study)
    except InputError as error:
        note(f"without peaks: {error}")
        return _SIDE_BY_SIDE[:2]
    return _SIDE_BY_SIDE


def _fit(
    study: "Study", method: "Method", intervals: "Intervals", loss: str, further: dict[str, Any], folder: Path
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


def _further_arguments(
    options: argparse.Namespace, intervals: "Intervals", folder: Path, resume: bool
) -> dict[str, Any]:
    """Arguments of `pdssjax.identify` that most runs do without; draws are kept in `folder`, whose may be `resume`d."""
    from concurrent.futures import ThreadPoolExecutor

    from ..files import DrawsFile
    from ..inference import Drawing

    further: dict[str, Any] = {key: getattr(options, key) for key in ("starts", "check_with") if getattr(options, key)}
    if options.effort != "usual":
        further["effort"] = options.effort
    file = DrawsFile(folder, resume and intervals in DRAWN)
    if not resume:
        file.forget()
    if intervals in DRAWN:
        count = options.replicates if intervals == "bootstrap" else options.draws
        resample, sampler = options.resample or "noise", options.sampler or "rto"
        further["drawing"] = Drawing(count, options.seed or 0, resample, file, sampler)
    if options.starts or intervals in (*DRAWN, "profile"):
        further["executor"] = ThreadPoolExecutor(os.cpu_count())
    return further


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=identify)
    text = "study file (TOML; default: the packaged example)"
    parser.add_argument("study", nargs="?", type=Path, metavar="STUDY", help=text)
    text = "start from the numbers of an estimate.json, such as that of a fit that was broken off"
    parser.add_argument("--estimate", type=Path, metavar="FILE", help=text)
    text = "all parameters at once (default); the piezo first, by least squares or, as in the thesis, from the peaks "
    text += "of its step responses; or both: joint and sequential side by side, and peaks where the records show them"
    parser.add_argument("--method", choices=["joint", "sequential", "peaks", "both"], default="joint", help=text)
    parser.add_argument(
        "--intervals",
        choices=["linear", "profile", "bootstrap", "posterior"],
        default="linear",
        help="95 %% intervals: symmetric ones from the standard errors (default); of the joint fit also by profile "
        "likelihood, which hold where chi-square is no parabola and say which end is open, of its posterior, or of a "
        "bootstrap",
    )
    text = "loss of the joint fit: the sum of squares (default), or a robust one, under which glitches pull little, "
    text += "and which has linear intervals only"
    parser.add_argument("--loss", choices=members("inference.losses"), default="squares", help=text)
    text = "how many starts a doubtful fit is compared with, how many evaluations that may take, and after how many "
    text += "slow steps a fit ends (default: usual)"
    parser.add_argument("--effort", choices=["quick", "usual", "thorough"], default="usual", help=text)
    text = "fit from N more starts, spread over their ranges, on all cores, and compare where they end"
    parser.add_argument("--starts", type=whole(0, MOST_STARTS), default=0, metavar="N", help=text)
    add_solver(parser)
    add_check(parser)
    add_out(parser)
    group = parser.add_argument_group("of --intervals bootstrap and posterior")
    group.add_argument("--replicates", type=whole(2), metavar="N", help="fits of the bootstrap (default 1000)")
    text = "draws of each of the posterior's 4 chains (default 1000)"
    group.add_argument("--draws", type=whole(2), metavar="N", help=text)
    text = (
        "how the posterior is drawn: randomize-then-optimize (default), or, as a second opinion that takes several "
        "times as long, the No-U-Turn sampler of NumPyro"
    )
    group.add_argument("--sampler", choices=["rto", "nuts"], help=text)
    text = "seed of the random numbers (default 0); the same seed gives the same draws"
    group.add_argument("--seed", type=SEED, metavar="N", help=text)
    text = "the bootstrap draws white noise (default), or whole cycles of the residuals where a drive repeats"
    group.add_argument("--resample", choices=["noise", "cycles"], help=text)
    text = "go on with the draws that DIR holds of a run that was broken off, or with more of them"
    group.add_argument("--resume", action="store_true", help=text)
