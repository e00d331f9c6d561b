"""The packaged example as the benchmark uses it."""

import dataclasses
import functools
import json

from pdssjax import Study, load_study
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.files import EXAMPLE

from .problem import EveryCycle


def example(every_cycle: bool = False) -> Study:
    """The packaged study; with `every_cycle` no sawtooth says that it repeats."""
    study = load_study(EXAMPLE / "study.toml")
    return stepped(study) if every_cycle else study


def stepped(study: Study) -> Study:
    """The study with drives that do not say that they repeat."""
    records = []
    for record in study.records:
        drive = record.drive
        if isinstance(drive, Sawtooth):
            drive = EveryCycle(**{field.name: getattr(drive, field.name) for field in dataclasses.fields(drive)})
        records.append(dataclasses.replace(record, drive=drive))
    return dataclasses.replace(study, records=tuple(records))


def at_truth(study: Study) -> Study:
    """`study` with its parameters started at the truth."""
    return study.with_starts({path: truth()[path] for path in study.parameters})


def sawtooths(every_cycle: bool = False) -> Study:
    """Only the two 5 Hz records that are fitted, the parameters started at the truth."""
    study = at_truth(example(every_cycle))
    used = tuple(r for r in study.records if r.measures == "effector" and r.role == "fit")
    study = dataclasses.replace(study, records=used)
    _ = study.predictor  # made here, where nothing is traced
    return study


@functools.cache
def truth() -> dict[str, float]:
    """The parameters with which the example was made [SI]."""
    found = json.loads((EXAMPLE / "truth.json").read_text(encoding="utf-8"))
    return {path: number["value"] for path, number in found["parameters"].items()}
