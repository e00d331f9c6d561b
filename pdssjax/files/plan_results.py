"""Writes a plan: in words, figure, page and JSON; its records as a study; voltages for the generator; templates.

`plan.toml` has the plan's records, each with its `sampling`, so that `pdssjax record` makes them on the virtual rig and
`pdssjax identify` fits them once they are measured.  `plan-together.toml` has the records so far besides.
"""

import math
from collections.abc import Mapping, Sequence
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
from .results_folder import staging_folder, write_text
from .study_copy import move_files

MEASURED = "measured"
"""Folder beside a plan's study in which its records are to be put."""

REHEARSAL, IDENTIFIED = "rehearsal", "identified"
"""Folder of what the virtual rig made of a plan, and of what was identified there."""

TomlTable: TypeAlias = Any
"""A table of tomlkit, which keeps comments and order."""


def write_plan(plan: Plan, source: Path, design: Document, folder: Path) -> None:
    """Put a `plan` into `folder`, in place of older results.

    **Arguments:** `source` is the file of the study that it is made for, and `design` the table of its limits.

    **Raises:** `InputError` where the study's file is gone.
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
    """The study of a plan's records as the text of a file in `folder`; `together` with the records so far."""
    try:
        document: TomlTable = tomlkit.parse(source.read_text(encoding="utf-8-sig"))
    except OSError as error:
        raise InputError(f"{source}: cannot be read ({error.strerror}), expected the study of the plan.") from None
    document["title"] = f"{plan.study.title}, planned records"
    parameters = document["parameters"]
    for path, parameter in plan.with_rig.parameters.items():
        number = plan.knowledge.values.get(path, parameter.number)
        if path not in parameters:
            parameters[path] = tomlkit.inline_table()
        # What was measured apart stays as it is.
        if number is not None and "standard_error" not in parameters[path]:
            parameters[path]["start" if parameter.free else "value"] = float(f"{number:.9g}")
    so_far = document.pop("record", []) if together else []
    for key in ("record", "design"):
        document.pop(key, None)
    limits = {key: _inline(value) if isinstance(value, dict) else value for key, value in design.items()}
    document.add("design", tomlkit.item(limits))
    records = tomlkit.aot()
    for record in so_far:
        move_files(record, source.parent, folder)
        records.append(record)
    taken = {str(record.get("name", "")) for record in so_far}
    for stem, planned in zip(file_stems(record.name for record in plan.records), plan.records, strict=True):
        records.append(_record(plan.study, planned, stem, taken))
    document.add("record", records)
    head = f"# Made by pdssjax design for {source.name}: put what is measured into {MEASURED}/.\n"
    return head + tomlkit.dumps(document)


def _record(study: Study, planned: PlannedRecord, stem: str, taken: set[str]) -> TomlTable:
    """The [[record]] table of a planned record."""
    experiment, made = planned.experiment, planned.record(study)
    table = tomlkit.table()
    names = (planned.name, *(f"{planned.name} ({n})" for n in range(2, 100)))
    table["name"] = next(name for name in names if name not in taken)
    table["file"] = f"{MEASURED}/{stem}.csv"
    table["columns"] = _inline({quantity: name for quantity, (name, _) in made.columns.items()})
    table["measures"] = experiment.kind
    display = made.measurement.display
    table["noise"] = f"{planned.noise.deviation * display.scale:.6g} {display.unit}"
    if experiment.conditions:
        table["conditions"] = sorted(experiment.conditions)
    table["sampling"] = _sampling(planned)
    if experiment.drive is not None:
        table["drive"] = _inline(_drive(study, planned))
    return table


def _sampling(planned: PlannedRecord) -> TomlTable:
    """The windows; each ends half an interval after its last sample, so that no rounding takes or adds one."""
    more, motion = dict[str, str](), planned.experiment.motion
    if motion is not None:
        more = {"amplitude": f"{1e6 * motion[0]:.9g} um", "frequency": f"{motion[1]:.9g} Hz"}
    windows = [
        {
            "start": f"{window.start:.10g} s",
            "end": f"{window.start + (window.samples - 0.5) * window.interval:.10g} s",
            "interval": f"{window.interval:.9g} s",
            **more,
        }
        for window in planned.schedule.list_windows(planned.experiment.period)
    ]
    if len(windows) == 1:
        return _inline(windows[0])
    listed = tomlkit.array()
    listed.extend([_inline(window) for window in windows])
    return listed.multiline(True)


def _drive(study: Study, planned: PlannedRecord) -> Document:
    """The drive as a study has it: numbers that are not the study's, with units, and words."""
    drive, experiment = planned.experiment.drive, planned.experiment
    assert drive is not None
    out: Document = {"waveform": experiment.group[1]}
    first = {field: next(iter(words)) for field, words in choices(type(drive)).items()}
    out |= {field: word for field, word in experiment.words.items() if word != first[field] or field == "direction"}
    overrides = planned.record(study).overrides
    for field, declared in quantities(type(drive)).items():
        number = float(drive.numbers()[field])
        if field in overrides and (not declared.optional or number != declared.nominal):
            out[field] = f"{number:.9g} {declared.unit}".strip() if declared.unit else number
    return out


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
        # A jump is two lines: what is just before a corner is the voltage there, too.
        corners = np.zeros(1)
        if period is not None:
            begins = period * np.arange(math.ceil(end / period) + 1)
            corners = np.ravel(begins[:, None] + np.array(experiment.corners()))
            corners = corners[corners <= end]
        time = np.unique(np.concatenate([time, corners, np.maximum(corners - 1e-7, 0.0)]))
        name, values = "voltage_V", np.asarray(experiment.drive.at(time))  # pyright: ignore[reportArgumentType]
    write_columns(file, {"time_s": time, name: values}, ("%.8f", "%.6g"))


def _write_template(study: Study, planned: PlannedRecord, file: Path) -> None:
    """The columns of a record, the times filled in, what is to be measured empty."""
    record = planned.record(study)
    names = [name for name, _ in record.columns.values()]
    lines = [",".join(names)]
    motion = [""] * record.time.size if record.motion is None else [f",{1e6 * x:.9g}" for x in record.motion]
    lines += [f"{t:.10g}{m}," for t, m in zip(record.time, motion, strict=True)]
    write_text(file, "\n".join(lines) + "\n")


def write_rehearsal(rehearsal: Rehearsal, plan: Plan, source: Path, design: Document, folder: Path) -> None:
    """Put what the virtual rig made of a plan into `folder`: the records, their study, and the identification.

    The folder is that of a plan that was carried out: `pdssjax design` goes on from it.
    """
    with staging_folder(folder, ("plan.toml", MEASURED)) as staging:
        write_text(staging / "plan.toml", plan_study(plan, source, design, folder, together=False))
        own = rehearsal.recordings[-len(plan.records) :]
        for stem, recording in zip(file_stems(record.name for record in plan.records), own, strict=True):
            write_csv(recording, staging / "plan.toml", staging / MEASURED / f"{stem}.csv")
    write_estimate(rehearsal.estimate, folder / IDENTIFIED)


def plan_folder(folder: Path) -> tuple[Path, Path | None]:
    """The study and the estimate of a folder: of a plan that was made or carried out, or of an identification.

    **Raises:** `InputError` where it holds neither, or the study of the identification is not where it was.
    """
    studies: Sequence[str] = ("plan-together.toml", "plan.toml")
    study = next((folder / name for name in studies if (folder / name).is_file()), None)
    places = (folder / IDENTIFIED / "estimate.json", folder / "estimate.json")
    estimate = next((place for place in places if place.is_file()), None)
    if study is not None:
        return study, estimate
    if estimate is None:
        raise InputError(f"{folder}: found no plan.toml and no estimate.json, expected a study file or results.")
    made_of = read_estimate(estimate).get("provenance")
    named = made_of.get("study") if isinstance(made_of, dict) else None
    if not (isinstance(named, str) and Path(named).is_file()):
        raise InputError(
            f"{estimate}: found no study at {named or 'a place that it names'}, expected the study file, with "
            f"--estimate {estimate}."
        )
    return Path(named), estimate
