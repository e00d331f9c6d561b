"""Reads a record from a study's [[record]] table and its file, and selects its samples."""

import itertools
import warnings
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..core import InputError, InputWarning, choices, member, members, to_si
from ..drive.base import AbstractDrive
from ..metrics import decimated, fresh_samples
from ..study import MARK, STEP_TIME, AbstractMeasurement, Record, check_increasing, check_meets_drive, split_path
from .drive_table import conditioned, read_drive, rest_before
from .record_columns import Columns, Layout, read_columns, record_layout
from .toml_table import Table


def _select_samples(
    table: Table, file: Path, layout: Layout, read: Columns
) -> dict[str, Float[np.ndarray, " samples"]]:
    """The samples of a record among those `read`, by quantity [SI], checked."""
    keep, segments = _not_excluded(table, read)
    if "held" in table.entries:
        measured = read.data[list(layout.si_units)[-1]]
        expected = f"a whole number from 2 on, and at most half of the {measured.size} samples"
        keep &= fresh_samples(measured, table.whole("held", expected, least=2, most=measured.size // 2))
    columns = read.select(keep)
    columns.check_numbers()
    clock = columns.channels["time"].name if "time" in columns.channels else "time"
    check_increasing(file, clock, columns.data["time"], columns.places, columns.reader.place)
    data = _decimate(table, columns, segments[keep])
    for quantity in list(layout.si_units)[1:]:
        columns.check_moves(quantity, data[quantity])
    return data


def _decimate(table: Table, columns: Columns, segments: np.ndarray) -> dict[str, np.ndarray]:
    """The columns, low-passed and thinned by the record's `decimate`, but not across excluded samples."""
    if "decimate" not in table.entries:
        return columns.data
    time = columns.data["time"]
    expected = f"a whole number from 2 on, and no more than the {time.size} samples"
    by = table.whole("decimate", expected, least=2, most=time.size)
    steps = np.diff(time)[np.diff(segments) == 0]
    if steps.size == 0 or np.ptp(steps) > 0.02 * np.median(steps):
        raise InputError(
            f"{table.at('decimate')}: found samples {np.min(steps, initial=np.inf):g} s to "
            f"{np.max(steps, initial=0.0):g} s apart, expected even ones."
        )
    samples = np.column_stack(list(columns.data.values()))
    thinned = np.concatenate([decimated(samples[segments == number], by) for number in np.unique(segments)])
    if len(thinned) < 2:
        raise InputError(
            f"{table.at('decimate')}: found {time.size} samples, expected more than the {32 * by} of the filter."
        )
    return dict(zip(columns.data, thinned.T, strict=True))


def _not_excluded(table: Table, read: Columns) -> tuple[np.ndarray, np.ndarray]:
    """Whether `exclude` keeps each sample, by the file's clock, and the segment of the sample between its pairs."""
    time = read.data["time"]
    # A sample whose time is no number counts at the time before.
    known = np.maximum.accumulate(np.where(np.isfinite(time), np.arange(time.size), 0))
    time = time[known]
    keep, segments = np.ones(time.shape, bool), np.zeros(time.shape, int)
    excluded = table.get("exclude", list, "a list of pairs of times", [])
    for index, pair in enumerate(excluded, start=1):
        start, end = _interval(pair, f"{table.at('exclude')}: pair {index}")
        keep &= (time < start) | (time > end)
        segments += time > end
    if not keep.any():
        raise InputError(
            f'{table.where}: found no sample left by "window" and "exclude", '
            f"expected some of the record's {read.begin:g} s to {read.end:g} s."
        )
    return keep, segments


def _interval(given: object, where: str) -> tuple[float, float]:
    if not isinstance(given, list) or len(given) != 2:
        raise InputError(f'{where}: found {given}, expected a pair of times such as ["3 s", "5 s"].')
    start, end = (to_si(time, "s", where) for time in given)
    if start >= end:
        raise InputError(f"{where}: found {start:g} s to {end:g} s, expected an end after its start.")
    return start, end


_FAMILY = "study.measurement"

_MOST_SAMPLES = 1e7
"""Most samples of a record to be made: some gigabytes with their prediction."""

RECORD_KEYS = [
    *("name", "file", "columns", "channel", "time", "units", "scale", "decimal", "measures", "role", "noise"),
    *("offset", "window", "exclude", "held", "decimate", "start", "drive", "resolution", "sampling", "conditions"),
    "conditioning",
]
"""Keys of every record, for any measurement."""


def read_record(table: Table, parameters: Table, folder: Path, virtual: bool, settles: bool = True) -> Record:
    """The record that a [[record]] `table` describes; its file is relative to `folder`.

    The study's `parameters` complete its drive.  For a `virtual` rig the record is still to be made: where the table
    has `sampling`, nothing is read, and the measured samples are zero.  Where the stack `settles`, a rest before the
    record may be long.

    **Raises:** `InputError` if the table or the file is at fault, or if the record's clock cannot meet its drive.
    Warns with `InputWarning` if the times seem to have another unit or end before the first period.
    """
    kinds = {kind: member(_FAMILY, kind) for kind in members(_FAMILY)}
    table.only([*RECORD_KEYS, *dict.fromkeys(key for kind in kinds.values() for key in choices(kind))])
    file = folder / table.text("file", "the path of a file")
    name = table.text("name", "a name", file.stem)
    kind = kinds[table.option("measures", kinds)]
    table.only([*RECORD_KEYS, *choices(kind)])
    words = {key: table.option(key, options, next(iter(options))) for key, options in choices(kind).items()}
    measurement: AbstractMeasurement = kind(**words)
    unit = measurement.unit
    drive, overrides, conditions = None, frozenset(), _conditions(table)
    if measurement.driven:
        described = table.table("drive", 'a table such as { waveform = "step", voltage = "48.2 V" }')
        drive, overrides = read_drive(described, table, folder, _drive_parameters(parameters, conditions))
    elif "drive" in table.entries:
        raise InputError(
            f'{table.at("drive")}: found a drive, expected none: the "{measurement.prescribed}" of a '
            f"{measurement.name} record is prescribed."
        )
    elif "start" in table.entries:
        raise InputError(
            f"{table.at('start')}: found a start, expected none: a {measurement.name} record has no drive."
        )
    layout = record_layout(table, measurement.columns)._replace(needs_clock=measurement.needs_clock)
    drive, earlier = conditioned(table, drive)
    start = table.number("start", "s", 0.0)
    if virtual:
        _check_writable(table, file, layout)
    if virtual and "sampling" in table.entries:
        data = _plan_samples(table, measurement)
        begin, has_clock = float(data["time"][0]), True
    else:
        if "sampling" in table.entries and not file.exists():
            raise InputError(
                f"{file}: there is no such file, expected the record that `pdssjax record STUDY` makes of a sampling."
            )
        window = _interval(table.entries["window"], table.at("window")) if "window" in table.entries else None
        read = read_columns(file, layout, window)
        data, begin, has_clock = _select_samples(table, file, layout, read), read.begin, read.has_clock
    where = f'{file}: record "{name}"'
    check_meets_drive(where, begin, data["time"], drive, start)
    length = float(data["time"][-1] - data["time"][0])
    drive, rested, rest_voltage = rest_before(table, parameters, drive, begin - start, length, settles)
    start -= earlier + rested
    data["time"] = data["time"] - start
    if "sampling" not in table.entries:  # planned times cannot have a wrong unit
        _check_duration(where, data["time"], drive)
    noise = _positive(table, "noise", unit)
    _check_noise(table, noise, data[measurement.quantity], measurement)
    return Record(
        name=name,
        file=file,
        role=table.option("role", ["fit", "validate"], "fit"),
        measurement=measurement,
        drive=drive,
        overrides=overrides,
        time=data["time"],
        measured=data[measurement.quantity],
        noise=noise,
        offset=None if table.entries.get("offset", "free") == "free" else table.number("offset", unit),
        motion=None if measurement.prescribed is None else data[measurement.prescribed],
        resolution=_positive(table, "resolution", unit) or 0.0,
        columns={q: (str(name), layout.units.get(q, "")) for q, name in layout.columns.items()},
        conditions=conditions,
        start=start,
        rest_voltage=rest_voltage,
        has_clock=has_clock,
    )


def _conditions(table: Table) -> frozenset[str]:
    """The conditions of the record, as in "friction.f_ss_a@wet"."""
    expected = 'a list of names such as ["wet"]'
    names = table.get("conditions", list, expected, [])
    for name in names:
        if not isinstance(name, str) or not name or MARK in name:
            raise InputError(f"{table.at('conditions')}: found {name!r}, expected {expected}, without {MARK}.")
    return frozenset(names)


def _drive_parameters(parameters: Table, conditions: frozenset[str]) -> Table:
    """The parameters of drives, by path, that hold under these `conditions`."""
    split = {path: split_path(path) for path in parameters.entries if path.startswith("drive.")}
    usual = {base: parameters.entries[path] for path, (base, condition) in split.items() if not condition}
    here = {base: parameters.entries[path] for path, (base, condition) in split.items() if condition in conditions}
    return Table(usual | here, parameters.where)


def _check_writable(table: Table, file: Path, layout: Layout) -> None:
    """**Raises** `InputError` where a record to be made cannot be written as a CSV file with named columns."""
    if file.suffix.lower() not in (".csv", ".txt", ".tsv", ".dat", ""):
        raise InputError(
            f'{table.at("file")}: found "{file.name}" for a record to be made, expected a name that ends in .csv.'
        )
    named = all(isinstance(name, str) for name in layout.columns.values()) and "time" in layout.columns
    if not named or layout.scales or {"held", "decimate"} & set(table.entries):
        raise InputError(
            f"{table.at('columns')}: found a record to be made whose columns are numbered, scaled, held or decimated, "
            'expected their names, as in columns = { time = "time_s", displacement = "displacement_um" }.'
        )


def _plan_samples(table: Table, measurement: AbstractMeasurement) -> dict[str, np.ndarray]:
    """Sample times, and a prescribed motion, by the record's `sampling`."""
    example = 'a table such as { start = "0.2 s", end = "2 s", interval = "1 ms" }, or a list of such tables'
    given = table.entries["sampling"]
    windows = given if isinstance(given, list) else [table.get("sampling", dict, example)]
    plans = [Table(window, f"{table.where}: sampling") for window in windows if isinstance(window, dict)]
    if not windows or len(plans) < len(windows):
        raise InputError(f"{table.at('sampling')}: found {windows}, expected {example}.")
    times = [_window(plan, measurement) for plan in plans]
    for earlier, later in itertools.pairwise(times):
        if later[0] <= earlier[-1]:
            raise InputError(
                f"{table.at('sampling')}: found a window from {later[0]:g} s on after one up to {earlier[-1]:g} s, "
                "expected windows in the order of time that do not overlap."
            )
    time = np.concatenate(times)
    numbers = {key: plans[0].number(key, unit) for key, unit in measurement.plan.items()}
    return {"time": time, **measurement.planned(time - time[0], numbers), measurement.quantity: np.zeros(time.shape)}


def _window(plan: Table, measurement: AbstractMeasurement) -> np.ndarray:
    """The sample times [s] of one table of a `sampling`."""
    plan.only(["start", "end", "interval", *measurement.plan])
    start, end, interval = plan.number("start", "s", 0.0), plan.number("end", "s"), plan.number("interval", "s")
    if not 0.0 < interval < end - start:
        raise InputError(
            f"{plan.at('interval')}: found {interval:g} s for samples from {start:g} s to {end:g} s, "
            "expected an interval above 0 that fits in between."
        )
    if (end - start) / interval > _MOST_SAMPLES:
        raise InputError(
            f"{plan.at('interval')}: found {interval:g} s for samples from {start:g} s to {end:g} s, which are "
            f"{(end - start) / interval:.3g}, expected {_MOST_SAMPLES:g} at most."
        )
    return start + interval * np.arange(int((end - start) / interval * (1 + 1e-12)) + 1)


def _positive(table: Table, key: str, unit: str) -> float | None:
    value = table.number(key, unit, None)
    if value is not None and value <= 0:
        quantity = "a standard deviation" if key == "noise" else "a step"
        raise InputError(f"{table.at(key)}: found {value:g} {unit}, expected {quantity} above 0.")
    return value


def _check_noise(table: Table, noise: float | None, measured: np.ndarray, measurement: AbstractMeasurement) -> None:
    """Warn of a noise larger than the motion, most likely of another unit."""
    extent = float(np.ptp(measured))
    if noise is not None and 0 < extent < noise:
        text = measurement.display.text
        warnings.warn(
            f"{table.at('noise')}: found {text(noise)} for a record that moves over {text(extent)} in all, "
            "expected less: is its unit right?",
            InputWarning,
            stacklevel=3,
        )


def _check_duration(where: str, time: np.ndarray, drive: AbstractDrive | None) -> None:
    if drive is None or not drive.declared():  # a sampled drive has no duration to compare
        return
    frequency = drive.cycle_frequency()
    period = STEP_TIME if frequency is None else 1.0 / frequency
    interval = float(np.median(np.diff(time)))
    length = float(time[-1] - time[0])
    # A clock wrong by a thousand gives too few samples a period or too many periods.
    if interval >= period / 2 or length >= 1000 * period:
        warnings.warn(
            f"{where}: the times seem to have another unit, such as milliseconds: found samples {interval:g} s "
            f"apart over {length:g} s, expected many in {period:g} s. [record.units] or the column's name gives the "
            "unit.",
            InputWarning,
            stacklevel=2,
        )
    elif frequency is not None and length + interval < period * (1 - 1e-6):
        warnings.warn(
            f"{where}: found {length:g} s of samples, expected at least one period of the drive, {period:g} s.",
            InputWarning,
            stacklevel=2,
        )
