"""`pdssjax simulate`: predicts every record of a study."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from .console import note, progress, say
from .numbers import add_numbers, study_of
from .results import NOTHING_FOUND, add_out, keep_results, reserving, say_where

if TYPE_CHECKING:
    from ..study import FittedRecord


@reserving
def simulate(options: argparse.Namespace) -> int:
    from ..core import prepare_jax
    from ..files import write_predictions
    from ..report.text import format_numbers, format_records

    prepare_jax(dedicated=True)
    import numpy as np

    from ..study import compare, failure_cause, numbers_used

    study = study_of(options)
    used = numbers_used(study)
    with progress() as tell:
        tell("simulating")
        records: list[FittedRecord] = []
        for record, predicted in zip(study.records, map(np.asarray, study.predict()), strict=True):
            # The record's own zero: given, or the best fit to the data.
            offset = float(np.mean(record.measured - predicted)) if record.offset is None else record.offset
            noise = math.nan if record.noise is None else record.noise
            records.append(compare(record, predicted, noise=noise, offset=offset))
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


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.set_defaults(run=simulate)
    parser.add_argument("study", type=Path, metavar="STUDY", help="study file (TOML)")
    add_numbers(parser)
    add_out(parser)
