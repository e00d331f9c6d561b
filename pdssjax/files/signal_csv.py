"""Writes a record as the study describes its CSV file."""

from pathlib import Path

import numpy as np

from ..core import column_unit, factor
from ..study import Recording


def write_csv(recording: Recording, file: Path) -> None:
    """The record as the study describes its file: columns by their names and units.

    **Raises:** `InputError` where the name of a column does not tell its unit.
    """
    record = recording.record
    si_units = record.measurement.columns
    data = {"time": record.time + record.start, "motion": record.motion, record.measurement.quantity: record.measured}
    names, columns, formats = [], [], []
    for quantity, (name, unit) in record.columns.items():
        where = f'record "{record.name}": column "{name}"'
        scale = factor(unit or column_unit(name), si_units[quantity], where)
        columns.append(np.asarray(data[quantity]) / scale)
        names.append(name)
        # A clock that began long ago needs all digits to tell its samples apart.
        formats.append("%.15g" if quantity == "time" else "%.9g")
    file.parent.mkdir(parents=True, exist_ok=True)
    header = ",".join(names)
    np.savetxt(file, np.column_stack(columns), fmt=formats, delimiter=",", header=header, comments="", encoding="utf-8")
