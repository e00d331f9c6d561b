"""Writes a record as the study describes its CSV file."""

from pathlib import Path

import numpy as np

from ..core import column_unit, factor
from ..study import Record, Recording


def column_scales(record: Record, study: Path) -> dict[str, float]:
    """By quantity, what one of the unit of its column is in SI.

    **Raises:** `InputError`, which names the file `study`, where the name of a column does not tell its unit.
    """
    si_units, where = record.measurement.columns, f'{study}: record "{record.name}"'
    return {
        quantity: factor(unit or column_unit(name), si_units[quantity], f'{where}: column "{name}"')
        for quantity, (name, unit) in record.columns.items()
    }


def write_csv(recording: Recording, study: Path, file: Path) -> None:
    """The record as the file `study` describes its file: columns by their names and units.

    **Raises:** `InputError` as `column_scales` does.
    """
    record = recording.record
    scales = column_scales(record, study)
    measurement = record.measurement
    data = {"time": record.time + record.start, measurement.quantity: record.measured}
    if measurement.prescribed is not None:
        data[measurement.prescribed] = record.motion
    names, columns, formats = [], [], []
    for quantity, (name, _) in record.columns.items():
        columns.append(np.asarray(data[quantity]) / scales[quantity])
        names.append(name)
        # A clock that began long ago needs all digits to tell its samples apart.
        formats.append("%.15g" if quantity == "time" else "%.9g")
    file.parent.mkdir(parents=True, exist_ok=True)
    header = ",".join(names)
    np.savetxt(file, np.column_stack(columns), fmt=formats, delimiter=",", header=header, comments="", encoding="utf-8")
