"""Writes a plan: as text, figure, page and JSON; its records as a study; voltages for the generator; templates.

`plan.toml` has the plan's records, each with its `sampling`, so that `pdssjax record` makes them on the virtual rig and
`pdssjax identify` fits them once they are measured.  `plan-together.toml` also has the records so far.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import tomlkit

from ..core import Document, InputError, choices, quantities
from ..design import Plan, PlannedRecord, Rehearsal
from ..report.text import format_design
from ..study import Study
from .estimate_results import read_estimate, write_estimate
from .json_text import json_text
from .record_results import file_stems, write_columns, write_csv
from .results_folder import read_text, staging_folder, write_text
from .study_copy import move_files

MEASURED = "measured"
"""Folder beside a plan's study for its records."""

REHEARSAL, IDENTIFIED = "rehearsal", "identified"
"""Folder of a rehearsal on the virtual rig, and of the identification in it."""

TomlTable: TypeAlias = Any
"""A table of tomlkit, which keeps comments and order."""


def write_plan(plan: Plan, source: Path, design: Document, folder: Path) -> None:
    """Put a `plan` into `folder`, in place of older results.

    **Arguments:** `source` is the study file of the plan, and `design` the table of its limits.

    **Raises:** `InputError` where the study file is gone.
    """
    from ..report.figures import design_figure, save_figure
    from ..report.page import plan_page, write_page

    with staging_folder(folder) as staging:
        write_text(staging / "plan.json", json_text(plan.document()))
        write_text(staging / "plan.txt", format_design(plan))
        save_figure(design_figure(plan), staging / "plan.png")
        write_page(staging / "plan.html", plan_page(plan))
        write_text(staging / "plan.toml", plan_study(plan, source, design, folder, together=False))
        if any(np.any(record.measured) for record in plan.study.records):
            write_text(staging / "plan-together.toml", plan_study(plan, source, design, folder, together=True))
        (staging / "drives").mkdir()
        (staging / "templates").mkdir()
        for stem, planned in zip(file_stems(record.name for record in plan.records), plan.records, strict=True):
            _write_drive(planned, staging / "drives" / f"{stem}.csv")
            _write_template(plan.study, planned, staging / "templates" / f"{stem}.csv")


def plan_study(plan: Plan, source: Path, design: Document, folder: Path, *, together: bool) -> str:
    """The text of a study in `folder` with a plan's records, and `together` also with the records so far."""
    document: TomlTable = tomlkit.parse(read_text(source, "the study of the plan"))
    document["title"] = f"{plan.study.title}, planned records"
    parameters = document["parameters"]
    for path, parameter in plan.with_rig.parameters.items():
        number = plan.knowledge.values.get(path, parameter.number)
        if path not in parameters:
            parameters[path] = tomlkit.inline_table()
        # A parameter that was measured apart keeps its value.
        if number is not None and "standard_error" not in parameters[path]:
            parameters[path]["start" if parameter.free else "value"] = float(f"{number:.9g}")
    records_so_far = document.pop("record", [])
    document.pop("design", None)
    limits = {key: _inline(value) if isinstance(value, dict) else value for key, value in design.items()}
    document.add("design", tomlkit.item(limits))
    records = tomlkit.aot()
    for record in records_so_far if together else []:
        move_files(record, source.parent, folder)
        records.append(record)
    names = {str(record.get("name", "")) for record in records}
    for stem, planned in zip(file_stems(record.name for record in plan.records), plan.records, strict=True):
        records.append(_record(plan.study, planned, stem, names))
    document.add("record", records)
    header = f"# Made by pdssjax design for {source.name}: put the measured records into {MEASURED}/.\n"
    return header + tomlkit.dumps(document)


def _record(study: Study, planned: PlannedRecord, stem: str, used_names: set[str]) -> TomlTable:
    """The [[record]] table of a planned record."""
    experiment, record = planned.experiment, planned.record(study)
    table = tomlkit.table()
    names = (planned.name, *(f"{planned.name} ({n})" for n in range(2, 100)))
    table["name"] = next(name for name in names if name not in used_names)
    table["file"] = f"{MEASURED}/{stem}.csv"
    table["columns"] = _inline({quantity: name for quantity, (name, _) in record.columns.items()})
    table["measures"] = experiment.kind
    display = record.measurement.display
    table["noise"] = f"{planned.noise.deviation * display.scale:.6g} {display.unit}"
    if experiment.conditions:
        table["conditions"] = sorted(experiment.conditions)
    table["sampling"] = _sampling(planned)
    if experiment.drive is not None:
        table["drive"] = _inline(_drive(study, planned))
    return table


def _sampling(planned: PlannedRecord) -> TomlTable:
    """The windows; each ends half an interval after its last sample, so that rounding does not change their number."""
    amplitude, motion = dict[str, str](), planned.experiment.motion
    if motion is not None:
        amplitude = {"amplitude": f"{1e6 * motion[0]:.9g} um", "frequency": f"{motion[1]:.9g} Hz"}
    windows = [
        {
            "start": f"{window.start:.10g} s",
            "end": f"{window.start + (window.samples - 0.5) * window.interval:.10g} s",
            "interval": f"{window.interval:.9g} s",
            **amplitude,
        }
        for window in planned.schedule.list_windows(planned.experiment.period)
    ]
    if len(windows) == 1:
        return _inline(windows[0])
    listed = tomlkit.array()
    listed.extend([_inline(window) for window in windows])
    return listed.multiline(True)


def _drive(study: Study, planned: PlannedRecord) -> Document:
    """The drive as in a study: words, and with units the numbers that differ from the study's."""
    drive, experiment = planned.experiment.drive, planned.experiment
    assert drive is not None
    table: Document = {"waveform": experiment.group[1]}
    default = {field: next(iter(words)) for field, words in choices(type(drive)).items()}
    table |= {field: word for field, word in experiment.words.items() if word != default[field] or field == "direction"}
    overrides = planned.record(study).overrides
    for field, declared in quantities(type(drive)).items():
        number = float(drive.numbers()[field])
        if field in overrides and (not declared.optional or number != declared.nominal):
            table[field] = f"{number:.9g} {declared.unit}" if declared.unit else number
    return table


def _inline(entries: Mapping[str, object]) -> TomlTable:
    table = tomlkit.inline_table()
    table.update(entries)
    return table


def _write_drive(planned: PlannedRecord, file: Path) -> None:
    """The voltage, or the prescribed motion, of a record from its start to its last sample."""
    experiment, end = planned.experiment, max(float(planned.times[-1]), 1e-6)
    period = experiment.period
    step = min(planned.schedule.interval, (period or end) / 1000.0)
    time = np.linspace(0.0, end, min(20_000, math.ceil(end / step) + 1))
    if experiment.motion is not None:
        amplitude, frequency = experiment.motion
        name, values = "motion_um", 1e6 * amplitude * np.sin(2.0 * np.pi * frequency * (time - planned.times[0]))
    else:
        assert experiment.drive is not None
        # Two lines at a corner, the first just before it, since the voltage may jump there.
        corners = np.zeros(1)
        if period is not None:
            begins = period * np.arange(math.ceil(end / period) + 1)
            corners = np.ravel(begins[:, None] + np.array(experiment.corners()))
            corners = corners[corners <= end]
        time = np.unique(np.concatenate([time, corners, np.maximum(corners - 1e-7, 0.0)]))
        name, values = "voltage_V", np.asarray(experiment.drive.at(time))  # pyright: ignore[reportArgumentType]
    write_columns(file, {"time_s": time, name: values}, ("%.8f", "%.6g"))


def _write_template(study: Study, planned: PlannedRecord, file: Path) -> None:
    """Write the columns of a record with its times; the measured quantity stays empty."""
    record = planned.record(study)
    lines = [",".join(name for name, _ in record.columns.values())]
    motion = [""] * record.time.size if record.motion is None else [f",{1e6 * x:.9g}" for x in record.motion]
    lines += [f"{t:.10g}{m}," for t, m in zip(record.time, motion, strict=True)]
    write_text(file, "\n".join(lines) + "\n")


def write_rehearsal(rehearsal: Rehearsal, plan: Plan, source: Path, design: Document, folder: Path) -> None:
    """Put the rehearsal of a plan on the virtual rig into `folder`: records, their study, and the identification.

    The folder is like that of a measured plan: `pdssjax design` goes on from it.
    """
    with staging_folder(folder, ("plan.toml", MEASURED)) as staging:
        write_text(staging / "plan.toml", plan_study(plan, source, design, folder, together=False))
        own = rehearsal.recordings[-len(plan.records) :]
        for stem, recording in zip(file_stems(record.name for record in plan.records), own, strict=True):
            write_csv(recording, staging / "plan.toml", staging / MEASURED / f"{stem}.csv")
    write_estimate(rehearsal.estimate, folder / IDENTIFIED)


def plan_folder(folder: Path) -> tuple[Path, Path | None]:
    """The study, and if any the estimate, in the `folder` of a plan or of an identification.

    **Raises:** `InputError` where it holds neither, or the study of the identification is gone.
    """
    studies = ("plan-together.toml", "plan.toml")
    study = next((folder / name for name in studies if (folder / name).is_file()), None)
    places = (folder / IDENTIFIED / "estimate.json", folder / "estimate.json")
    estimate = next((place for place in places if place.is_file()), None)
    if study is not None:
        return study, estimate
    if estimate is None:
        raise InputError(f"{folder}: found no plan.toml and no estimate.json, expected a study file or results.")
    provenance = read_estimate(estimate).get("provenance")
    path = provenance.get("study") if isinstance(provenance, dict) else None
    if not (isinstance(path, str) and Path(path).is_file()):
        raise InputError(
            f"{estimate}: found no study at {path or 'a path that it names'}, expected the study file, with "
            f"--estimate {estimate}."
        )
    return Path(path), estimate
