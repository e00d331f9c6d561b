"""`pdssjax design`: which records to make next, and where their samples go."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import InputError
from .console import progress, say
from .numbers import add_solver, with_solver
from .option_values import SEED, read_number, read_pairs, whole
from .results import add_out, keep_results, reserved, say_where

if TYPE_CHECKING:
    from ..design import Aim, Knowledge
    from ..files import DesignTable
    from ..study import Study


def design(options: argparse.Namespace) -> int:
    from ..files import REHEARSAL

    with reserved(options, *([REHEARSAL] if options.rehearse else [])):
        return _design(options)


def _design(options: argparse.Namespace) -> int:
    from ..core import prepare_jax
    from ..files import (
        BUDGET_KEYS,
        REHEARSAL,
        load_study,
        plan_folder,
        read_design,
        read_knowledge,
        write_plan,
        write_rehearsal,
    )
    from ..report.text import format_design, format_rehearsal

    source, estimate = options.study, options.estimate
    if source.is_dir():
        source, found = plan_folder(source)
        estimate = estimate or found
    budget = read_pairs(options.budget, "--budget", BUDGET_KEYS, "samples=2000")
    table = read_design(source, options.limit, budget)
    prepare_jax(dedicated=True)
    from ..design import design_experiment, rehearse

    study = with_solver(load_study(source, virtual=estimate is None), options)
    knowledge = None if estimate is None else read_knowledge(estimate)
    with progress() as tell:
        plan = design_experiment(
            study,
            table.budget,
            knowledge=knowledge,
            limits=table.limits,
            aim=_aim(options, study, knowledge, table, tell),
            count_known=not options.fresh,
            draws=options.draws,
            seed=options.seed,
            progress=tell,
        )
    say(format_design(plan))
    written = keep_results(lambda place: write_plan(plan, source, table.document, place), options.out)
    if written and options.rehearse:
        with progress() as tell:
            rehearsal = rehearse(plan, options.seed, tell)
            tell("writing the rehearsal")
            write = lambda place: write_rehearsal(rehearsal, plan, source, table.document, place)
            keep_results(write, options.out / REHEARSAL)
        say(format_rehearsal(rehearsal))
    where = f"The plan is in {options.out}\nMake its records on the virtual rig with: pdssjax record "
    return say_where(written, f"{where}{options.out / 'plan.toml'} --out ...")


def _aim(
    options: argparse.Namespace,
    study: "Study",
    knowledge: "Knowledge | None",
    table: "DesignTable",
    tell: Callable[[str], None],
) -> "Aim | None":
    """What the options ask for; None where they leave it to the estimate."""
    from ..design import Aim, fitted_rival

    aims = [name for name in ("criterion", "parameter", "speed_at", "against") if getattr(options, name)]
    if len(aims) > 1:
        named = " and ".join(f"--{name.replace('_', '-')}" for name in aims)
        raise InputError(f"options {named}: found both, expected one aim.")
    if options.parameter:
        return Aim("parameter", tuple(part.strip() for part in options.parameter.split(",")))
    if options.speed_at:
        voltage, _, frequency = options.speed_at.partition(",")
        read = lambda text, unit: read_number(text.strip(), unit, "option --speed-at", above=0.0)
        return Aim("prediction", speed_at=(read(voltage, "V"), read(frequency, "Hz")))
    if options.against:
        rival, known = fitted_rival(study, options.against, knowledge, table.limits, tell)
        return Aim("discrimination", rival=rival, rival_knowledge=known)
    return Aim(options.criterion) if options.criterion else None


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=design)
    text = "study file (TOML), or a folder of results: of identify, or of a plan whose records were measured"
    parser.add_argument("study", type=Path, metavar="STUDY", help=text)
    text = "estimate.json from which to plan: its covariance counts as known, and its misfit as noise"
    parser.add_argument("--estimate", type=Path, metavar="FILE", help=text)
    text = "what the records may take together: samples=N records=N, and seconds=S and cost=C if these are limited"
    parser.add_argument("--budget", nargs="+", default=[], metavar="WHAT=N", help=text)
    text = 'a line of the study\'s [design] table, such as \'voltage = ["20 V", "100 V"]\'; may be repeated'
    parser.add_argument("--limit", action="append", default=[], metavar="LINE", help=text)
    text = "make the ellipsoid of all errors (d) or their mean square (a) small; without any aim: parameters whose "
    text += "profiles are open, or d"
    parser.add_argument("--criterion", choices=["d", "a"], help=text)
    text = "plan for the errors of these parameters, with commas between them"
    parser.add_argument("--parameter", metavar="PATHS", help=text)
    text = 'plan for predicting the mean speed at a voltage and frequency, as in "64 V, 80 Hz"'
    parser.add_argument("--speed-at", metavar="V,HZ", help=text)
    text = "plan for telling the study's friction law from this one, which is fitted first"
    parser.add_argument("--against", metavar="LAW", help=text)
    text = "take the estimate's numbers only: the plan is to stand on its own"
    parser.add_argument("--fresh", action="store_true", help=text)
    text = "sets of parameters whose mean counts, drawn from what is not known of them (default 4)"
    parser.add_argument("--draws", type=whole(1, 1000), default=4, help=text)
    text = "carry the plan out on the virtual rig, identify it without starts, and compare promised and had errors"
    parser.add_argument("--rehearse", action="store_true", help=text)
    parser.add_argument("--seed", type=SEED, default=0, help="seed of draws, noise and zeros (default 0)")
    add_solver(parser)
    add_out(parser)
