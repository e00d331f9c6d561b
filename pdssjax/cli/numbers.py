"""The numbers of a study's parameters: the options that give them, and the study with them."""

import argparse
import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from ..integration import SOLVERS
from .console import progress

if TYPE_CHECKING:
    from ..study import Study


def add_numbers(parser: argparse.ArgumentParser) -> None:
    text = "take the parameters' numbers from an estimate.json in place of the study's values and starts"
    parser.add_argument("--estimate", type=Path, metavar="FILE", help=text)
    text = "guess roughly from the records what has no number then; without it a missing number is an error"
    parser.add_argument("--guess", action="store_true", help=text)
    add_solver(parser)


def add_solver(parser: argparse.ArgumentParser) -> None:
    text = "solver of every simulation (default: the study's, or taylor); all but taylor are diffrax's"
    parser.add_argument("--solver", choices=SOLVERS, help=text)


def add_check(parser: argparse.ArgumentParser) -> None:
    text = "fit again from the optimum by this integrator, and report what every parameter differs by"
    parser.add_argument("--check-with", choices=SOLVERS, metavar="SOLVER", help=text)


def with_solver(study: "Study", options: argparse.Namespace) -> "Study":
    """`study`, integrated by the solver of `--solver` if there is one."""
    return study if options.solver is None else dataclasses.replace(study, solver=options.solver)


def study_of(options: argparse.Namespace, virtual: bool = False) -> "Study":
    """The study of a command, with the numbers of `--estimate`, and those of `--guess` for what then is missing."""
    import pdssjax

    return with_numbers(with_solver(pdssjax.load_study(options.study, virtual), options), options)


def with_numbers(study: "Study", options: argparse.Namespace) -> "Study":
    """`study` with the numbers of `--estimate`, and those of `--guess` for what then is missing, as fixed values."""
    import pdssjax

    if options.estimate is not None:
        from ..files import with_estimate

        study = with_estimate(study, options.estimate)
    if options.guess and (missing := study.missing()):
        with progress() as tell:
            tell("guessing from the records")
            guess = pdssjax.initial_guess(study)
        study = study.with_values({path: guess[path] for path in missing}, "guess from the records")
    return study
