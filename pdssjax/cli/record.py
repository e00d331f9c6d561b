"""`pdssjax record`: makes the records of a study on a virtual rig."""

import argparse
from pathlib import Path

from .console import progress, say
from .numbers import add_numbers, study_of
from .option_values import SEED
from .results import add_out, keep_results, reserving, say_where


@reserving
def record(options: argparse.Namespace) -> int:
    from ..core import prepare_jax
    from ..files import check_recordings, write_recordings
    from ..report.text import format_numbers, format_records

    prepare_jax(dedicated=True)

    from ..study import compare, make_recordings, numbers_used, truth

    study = study_of(options, virtual=True)
    check_recordings(study.records, options.study)
    used = numbers_used(study)
    with progress() as tell:
        tell("simulating")
        made = make_recordings(study, options.seed)
    compared = [compare(r.record, r.true, noise=r.record.noise or 0.0, offset=r.offset) for r in made]
    went_in = truth(study, made, options.seed)
    with progress() as tell:
        tell("writing records and plots")
        write = lambda place: write_recordings(made, compared, went_in, used, options.study, place)
        written = keep_results(write, options.out)
    say(format_numbers(used))
    say(format_records(compared))
    again = f"pdssjax identify {options.out / 'records' / options.study.name} --out ..."
    return say_where(written, f"Records are in {options.out / 'records'}\nIdentify them with: {again}")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=record)
    parser.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML) whose parameters all have numbers")
    add_numbers(parser)
    parser.add_argument("--seed", type=SEED, default=0, help="seed of noise and zeros (default 0)")
    add_out(parser)
