"""Samples of a file that are no numbers: filled for guesses, and excluded from the record of a new study."""

import dataclasses

import numpy as np

from .record_columns import Columns

_FEW = 0.05
"""Part of a record's samples that may be no numbers, and are excluded."""


def filled(columns: Columns, motion: str) -> tuple[Columns, tuple[tuple[float, float], ...]]:
    """The columns with samples that are no numbers filled from beside them, where they are few, and when those were."""
    time = columns.data["time"]
    wrong = ~np.all([np.isfinite(column) for column in columns.data.values()], axis=0)
    if not wrong.any() or not np.all(np.isfinite(time)) or np.mean(wrong) > _FEW:
        return columns, ()
    known, data = np.flatnonzero(~wrong), dict(columns.data)
    for quantity in set(data) - {"time"}:
        # A motion keeps the steps in which its sensor counts.
        last = known[np.maximum(np.searchsorted(known, np.arange(time.size), "right") - 1, 0)]
        held = data[quantity][last]
        between = np.interp(time, time[known], data[quantity][known])
        data[quantity] = np.where(wrong, held if quantity == motion else between, data[quantity])
    edges = np.flatnonzero(np.diff(np.concatenate([[False], wrong, [False]]).astype(int)))
    beside = 0.25 * float(np.median(np.diff(time)))
    gaps = zip(edges[::2], edges[1::2] - 1, strict=True)
    return dataclasses.replace(columns, data=data), tuple(
        (float(time[a]) - beside, float(time[b]) + beside) for a, b in gaps
    )
