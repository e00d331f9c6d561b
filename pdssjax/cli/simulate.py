"""`pdssjax simulate`: predicts every record of a study."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .console import note, progress, say
from .numbers import add_numbers, study_of
from .results import NOTHING_FOUND, add_out, keep_results, reserving, say_where

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ..study import FittedRecord, Record


@reserving
def simulate(options: argparse.Namespace) -> int:
    from ..core import prepare_jax
    from ..files import write_predictions
    from ..report.text import format_numbers, format_records

    prepare_jax(dedicated=True)
    from ..study import failure_cause, numbers_used

    study = study_of(options)
    used = numbers_used(study)
    with progress() as tell:
        tell("simulating")
        records = [_compare_record(*pair) for pair in zip(study.records, study.predict(), strict=True)]
        cause = ""
        if not all(record.simulated for record in records):
            tell("looking for the parameter to blame")
            cause = failure_cause(study.predictor, study.records, study.values(), study.accuracy)
    with progress() as tell:
        tell("writing predictions and plots")
        written = keep_results(lambda place: write_predictions(records, used, place), options.out)
    say(format_numbers(used))
    say(format_records(records))
    if cause:
        note(f"warning: {options.study}: {cause}.")
    status = say_where(written, f"Results are in {options.out}")
    return status or (0 if any(record.simulated for record in records) else NOTHING_FOUND)


def _compare_record(record: "Record", predicted: "ArrayLike") -> "FittedRecord":
    """A record beside its simulation, which gets the record's own zero: given, or the best fit to the data."""
    import numpy as np

    from ..study import compare

    motion = np.asarray(predicted)
    offset = float(np.mean(record.measured - motion)) if record.offset is None else record.offset
    noise = float("nan") if record.noise is None else record.noise
    return compare(record, motion, noise=noise, offset=offset)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `simulate`."""
    parser.set_defaults(run=simulate)
    parser.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML)")
    add_numbers(parser)
    add_out(parser)
