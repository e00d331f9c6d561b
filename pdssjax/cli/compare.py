"""`pdssjax compare`: fits the records of a study under several models, and finds the simplest that predicts as well."""

import argparse
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import InputError
from .console import note, progress, say
from .results import NOTHING_FOUND, add_out, keep_results, reserving, say_where

if TYPE_CHECKING:
    from ..selection import Comparison
    from ..study import Study


@reserving
def compare(options: argparse.Namespace) -> int:
    from ..core import prepare_jax

    prepare_jax(dedicated=True)
    import pdssjax

    from ..files import write_selection
    from ..report.text import format_selection

    found = _fit_candidates(pdssjax.load_study(options.study), options)
    say(format_selection(found), end="")
    command = shlex.join(["pdssjax", *sys.argv[1:]])
    written = keep_results(lambda place: write_selection(found, place, [command]), options.out)
    if status := say_where(written, f"Results are in {options.out}; comparison.html is for a colleague"):
        return status
    if found.chosen:
        return 0
    note("error: no model has a fit that could be compared")
    return NOTHING_FOUND


def _fit_candidates(study: "Study", options: argparse.Namespace) -> "Comparison":
    """Compare the models; if that is interrupted, the finished candidates stay in the folder."""
    from ..files import CandidateFolder
    from ..selection import compare_models

    store = CandidateFolder(options.out, options.resume)
    try:
        with progress() as tell:
            return compare_models(
                study,
                friction=_names(options.friction),
                piezo=_names(options.piezo),
                feedback=[False, True] if options.feedback else None,
                effort=options.effort,
                store=store,
                progress=tell,
            )
    except KeyboardInterrupt:
        if store.place.is_dir():
            note(f"the models that were done are in {store.place}; the same command with --resume goes on")
        raise


def _names(text: str | None) -> list[str] | None:
    """Names with commas between them; None where the option is left out."""
    if text is None:
        return None
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise InputError(f'found "{text}", expected names with commas between them, such as "dahl,lugre".')
    return names


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=compare)
    parser.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML)")
    text = 'friction laws beside the study\'s own, with commas between them, or "all" (the default where no other '
    text += 'option asks for models); "anisotropic-lugre:force" is a law with that reading of its state'
    parser.add_argument("--friction", metavar="NAMES", help=text)
    text = 'models of stack and platform beside the study\'s own, or "all"'
    parser.add_argument("--piezo", metavar="NAMES", help=text)
    text = "compare models with and without friction acting back on the platform"
    parser.add_argument("--feedback", choices=["both"], help=text)
    text = "effort of each fit, as in identify (default: quick)"
    parser.add_argument("--effort", choices=["quick", "usual", "thorough"], default="quick", help=text)
    text = "continue an interrupted comparison with the models already fitted in DIR"
    parser.add_argument("--resume", action="store_true", help=text)
    add_out(parser)
