"""Samples that stand out of the residuals, and what they alone explain."""

from collections.abc import Sequence

import numpy as np

from ...study import FittedRecord
from ..poor_fit import above_floor, outliers_explain
from .words import listed, quoted


def about_outliers(records: Sequence[FittedRecord], enlarged: str, is_robust: bool) -> list[str]:
    """Which samples of the `records` stand out, and where they are all that the model does not explain.

    **Arguments:** what the note says of how errors are `enlarged`; whether the loss is robust.
    """
    found = [record for record in records if record.outliers.size]
    if not found:
        return []
    note = f"Samples stand out of the residuals: {listed(map(_outliers, found))}. "
    if alone := [record for record in found if outliers_explain(record)]:
        figures = listed(_rest(record) for record in alone)
        note += f"They are most likely glitches: without them all is down to the noise ({figures}). "
        note += f"{enlarged} " if any(record.role == "fit" and not record.noise_estimated for record in alone) else ""
    else:
        note += "They may be glitches. "
    if is_robust:
        return [f"{note}Under this loss they pull little; exclude in the study leaves them out."]
    return [f"{note}Leave them out (exclude in the study) or fit with --loss huber, under which they pull little."]


def _rest(record: FittedRecord) -> str:
    if record.noise_estimated:
        return f"{above_floor(record):.2g} times the noise between neighbouring samples in {quoted([record])}"
    return f"chi-square per sample {record.rest_chi2:.3g}, with them {record.reduced_chi2:.3g}, in {quoted([record])}"


def _outliers(record: FittedRecord) -> str:
    off = np.abs(record.measured - record.predicted)[record.outliers]
    times = listed(f"{t:.6g}" for t in record.time[record.outliers][np.argsort(-off)][:3])
    count = record.outliers.size
    return (
        f"{count} in {quoted([record])} by up to {record.display.text(float(off.max()))}, "
        f"{'the largest ' if count > 3 else ''}at t = {times} s"
    )
