"""Notes on records that the fit does not explain: samples that stand out, records that contradict each other."""

from collections.abc import Iterable, Sequence

import numpy as np

from ...core import display_unit
from ...metrics import counts_without_noise, describe_hold, drift_per_cycle, resolution_of, slip_delay
from ...study import Diagnosis, FittedRecord, Record
from ..beyond_noise import (
    SIGNIFICANT,
    above_floor,
    could_be_noise,
    exceeds_floor,
    exceeds_given_noise,
    freedom_of,
    largest_by_chance,
    neighbours_correlate,
    outliers_explain,
    repeats,
    rest_scatter,
    stays_below_given_noise,
)
from ..diagnosis import contradicting
from ..validation import MissedRecord


def in_display_unit(number: float, unit: str) -> str:
    """A number in SI as text, in its usual unit."""
    name, factor = display_unit(unit)
    return f"{number * factor:.4g} {name}".rstrip()


def listed(texts: Iterable[str]) -> str:
    """Texts joined as a sentence has them: one, two and three."""
    texts = list(texts)
    return " and ".join([", ".join(texts[:-1]), texts[-1]]) if len(texts) > 1 else "".join(texts)


def quoted(records: Sequence[FittedRecord]) -> str:
    """The names of records, quoted and joined."""
    return listed(f'"{record.name}"' for record in records)


def about_better_optimum(when: str, chi2: float, path: str, number: float) -> str:
    """A note on a point below the optimum, with the `number` [SI] of one parameter there."""
    return f"{when} a better optimum was found (chi-square {chi2:.6g}): start the fit from {path} = {number:.6g} in SI."


def about_outliers(records: Sequence[FittedRecord], enlarged: str, is_robust: bool) -> list[str]:
    """Samples of the `records` that stand out, and where they are all that the model does not explain.

    **Arguments:** the sentence on how errors are `enlarged`; whether the loss is robust.
    """
    figures = []
    for record in records:
        if count := record.outliers.size:
            sizes = np.abs(record.measured - record.predicted)[record.outliers]
            times = listed(f"{t:.6g}" for t in record.time[record.outliers][np.argsort(-sizes)][:3])
            largest = "the largest " if count > 3 else ""
            size = record.display.text(float(sizes.max()))
            figures.append(f"{count} in {quoted([record])} by up to {size}, {largest}at t = {times} s")
    if not figures:
        return []
    note = f"Samples stand out of the residuals: {listed(figures)}. "
    if alone := [record for record in records if outliers_explain(record)]:
        figures = listed(
            f"{above_floor(r):.2g} times the noise between neighbouring samples in {quoted([r])}"
            if r.noise_estimated
            else f"chi-square per sample {r.rest_chi2:.3g}, with them {r.reduced_chi2:.3g}, in {quoted([r])}"
            for r in alone
        )
        note += f"They are most likely glitches: without them all is down to the noise ({figures}). "
        note += f"{enlarged} " if any(record.role == "fit" and not record.noise_estimated for record in alone) else ""
    else:
        note += "They may be glitches. "
    if is_robust:
        return [f"{note}Under this loss they pull little; exclude in the study leaves them out."]
    return [f"{note}Leave them out (exclude in the study) or fit with --loss huber, under which they pull little."]


_LINEAR = 100.0
"""Standard errors up to which a linear step is quoted: it is exact where parameters hardly move."""


def about_agreement(diagnosis: Diagnosis | None, method: str = "joint") -> list[str]:
    """Records, or all of one direction or kind, that ask for other parameters than the rest."""
    found = [] if diagnosis is None else contradicting(diagnosis.agreement)
    if not found:
        return []
    worst = max(found, key=lambda agreement: agreement.sigmas)
    path, shift = worst.largest()
    far = f"{abs(shift):.2g} standard errors" if abs(shift) < _LINEAR else f"over {_LINEAR:.0f} standard errors"
    path += "" if method == "joint" else " of a joint fit"
    names = listed(f'"{name}"' for name in worst.records)
    alone = len(worst.records) == 1
    others = "the other records" if alone else f"those of another {worst.what}"
    others_too = {name for agreement in found for name in agreement.records} - set(worst.records)
    also = f" So do {listed(chr(34) + name + chr(34) for name in sorted(others_too))}, less." if others_too else ""
    return [
        f"{names} {'contradicts' if alone else 'contradict'} {others} ({worst.sigmas:.3g} standard deviations beyond "
        f"chance): without {'it' if alone else 'them'} {path} would be {far} "
        f"{'larger' if shift > 0 else 'smaller'}.{also} These parameters do not explain all: look for a wrong "
        "voltage, direction, unit or sign, a surface that differs, a law that lacks something, or a better optimum "
        "elsewhere (--starts 50)."
    ]


_NOISE = 0.9
"""Least ratio of the scatter of neighbouring residuals to their rms for all of a residual to count as noise."""


def about_peaks(read: Sequence[FittedRecord]) -> list[str]:
    """Residuals, in the records it was `read` from, of a stack that was read off peaks."""
    known = [record for record in read if record.simulated]
    if not known:
        return []
    figures = listed(f"{record.rmse / record.noise:.3g} times in {quoted([record])}" for record in known)
    return [
        f"The stack was read off peaks, not fitted: what it leaves of its own records, over their noise, is {figures}. "
        'The method "sequential" fits all their samples, and the errors that it leaves are smaller by far.'
    ]


def about_rests(records: Sequence[Record]) -> list[str]:
    """Fitted records whose voltage begins off zero without a conditioning in the study."""
    figures = [f'{r.rest_voltage:.4g} V in "{r.name}"' for r in records if r.rest_voltage is not None]
    if not figures:
        return []
    return [
        f"The voltage begins at {listed(figures)}, and the study does not say what was before: the actuator is taken "
        'to have rested there. If the voltage set in with the record, write conditioning = "0 s" in its [[record]]; '
        'if cycles ran before, conditioning = { cycles = 3, period = "1 s" }.'
    ]


def about_records(
    records: Sequence[FittedRecord], factor: float, is_robust: bool, missed: Sequence[MissedRecord] = ()
) -> list[str]:
    """Records that the fit does not explain.

    **Arguments:** the `factor` by which variances exceed those of the noise given; whether the loss is robust, so that
    standard errors do not depend on the noise given; the records that were not fitted and are `missed`.
    """
    known = [record for record in records if record.simulated]
    notes = about_outliers(known, _enlarged(factor, is_robust), is_robust)
    fitted = [record for record in known if record.role == "fit"]
    excess = [record for record in fitted if exceeds_given_noise(record)]
    noisy = [record for record in excess if rest_scatter(record) > _NOISE * record.rest_rmse]
    if noisy:
        notes.append(
            f"The noise given is too small for {quoted(noisy)}: neighbouring residuals alone scatter by "
            f"{listed(r.display.text(rest_scatter(r)) for r in noisy)}, where "
            f"{listed(r.display.text(r.noise) for r in noisy)} is given. Correct it, or leave it out. "
            f"{_enlarged(factor, is_robust)}"
        )
    if misfits := [record for record in excess if record not in noisy]:
        figures = (
            f'"{r.name}" ({r.rest_chi2:.3g}; by chance up to {largest_by_chance(freedom_of(r)):.3g})' for r in misfits
        )
        notes.append(
            f"The model does not explain all of {listed(figures)}: chi-square per sample against the noise given is "
            f"in brackets. {_enlarged(factor, is_robust)} Look at the residuals in the plots for what is missing: "
            "another law, a fall time, hysteresis, a wrong drive."
        )
    if over := [record for record in fitted if record.noise_estimated and exceeds_floor(record)]:
        figures = (f"{above_floor(r):.2g} times in {quoted([r])}" for r in over)
        notes.append(
            "No noise is given, so it was taken from the residuals; but these are larger than the noise seen between "
            f"neighbouring samples, {listed(figures)}: the model does not explain all that was measured there, or the "
            "fit is in a wrong optimum. Look at the residuals in the plots, try other starts, or give the noise."
        )
    less = [record for record in fitted if stays_below_given_noise(record)]
    if less and not is_robust:
        figures = (f"{quoted([r])} ({r.display.text(r.rmse)} where {r.display.text(r.noise)} is given)" for r in less)
        notes.append(
            f"The residuals are smaller than the noise given in {listed(figures)}: the standard errors are larger "
            "than they need be. Give the noise as it is, or leave it out."
        )
    notes += [f"Found in {quoted([record])} {held}." for record in fitted if (held := describe_hold(record.measured))]
    if counted := [record for record in fitted if record.samples >= 8 and counts_without_noise(record.measured)]:
        figures = listed(f"of {r.display.text(resolution_of(r.measured) or 0.0)} in {quoted([r])}" for r in counted)
        notes.append(
            f"The sensor counts in steps, {figures}, and no noise is seen between them: what is left is rounding, "
            "which follows the motion and does not average out as noise does. The true errors may be larger than the "
            "white standard errors."
        )
    if repeating := [(record, record.lack_of_fit) for record in fitted if record.lack_of_fit and repeats(record)]:
        figures = listed(
            f"{r.display.text(f.misfit)} beside noise of {r.display.text(f.noise)} in {quoted([r])}"
            for r, f in repeating
        )
        notes.append(
            f"A part of the residuals repeats every cycle, {figures}: that is the model's misfit and not noise, and "
            "more cycles do not average it away. The true errors are larger than the white standard errors."
        )
    notes += _about_slips([r for r in fitted if any(r is other for other in (*misfits, *over)) or repeats(r)])
    notes += _about_missed(missed) + _about_correlation(fitted) + _about_walking(fitted)
    if failed := [record for record in records if not record.simulated]:
        notes.append(
            f"The simulation could not finish for {quoted(failed)}. Look at parameters that are extreme, such as a "
            "very high bandwidth or stiffness."
        )
    return notes


def _about_slips(unexplained: Sequence[FittedRecord]) -> list[str]:
    """Records in which a delay of the slips explains most of the residuals within them."""
    figures = []
    for record in unexplained:
        walks = record.measures == "effector" and record.frequency is not None
        found = slip_delay(record.time, record.predicted, record.rest) if walks else None
        if found is None or abs(found.delay) < SIGNIFICANT * found.standard_error or found.explained_share < 0.5:
            continue
        when = "later" if found.delay > 0 else "earlier"
        figures.append(
            f"in {quoted([record])} {1e3 * abs(found.delay):.2g} ms {when}, {100 * found.explained_share:.0f} % of "
            "what is left in them"
        )
    if not figures:
        return []
    return [
        f"Slips come at other times than the model's: {listed(figures)}. Look at when the drive starts (start, "
        "sensor.delay), at the fall time and at the friction force."
    ]


def _about_missed(missed: Sequence[MissedRecord]) -> list[str]:
    notes = []
    if refuting := [record for record, unknown in missed if not unknown]:
        notes.append(
            f"{_not_predicted(refuting)}, more than the parameters' errors explain. The model or the optimum found "
            "does not carry over to them: fit them too, and see whether all agree."
        )
    if unknown := [path for record in missed for path in record.unknown]:
        notes.append(
            f"{_not_predicted([r for r, paths in missed if paths])}. They have parameters of their own that no "
            f"fitted record knows, {listed(dict.fromkeys(unknown))}: these were not fitted, and may be all that is "
            "wrong. Fit such a record, or a part of it (window), to see."
        )
    return notes


def _not_predicted(records: Sequence[FittedRecord]) -> str:
    figures = (
        f"{np.sqrt(r.rest_chi2):.2g} times the noise given in {quoted([r])}"
        if exceeds_given_noise(r)
        else f"{above_floor(r):.2g} times the noise seen between neighbouring samples in {quoted([r])}"
        for r in records
    )
    return f"Records that were not fitted are not predicted down to their noise: the residuals are {listed(figures)}"


def _about_correlation(fitted: Sequence[FittedRecord]) -> list[str]:
    coloured, misfits, notes = [], [], []
    for record in filter(neighbours_correlate, fitted):
        (coloured if could_be_noise(record) else misfits).append(record)
    if misfits:
        notes.append(f"Neighbouring residuals are correlated, as the model's errors are, in {quoted(misfits)}.")
    if coloured:
        notes.append(
            f"Neighbouring residuals are correlated in {quoted(coloured)}, and as large along all of the record: "
            "coloured noise, as of a filter in the sensor."
        )
    if notes:
        notes[-1] += " The true errors are larger than the white standard errors."
    return notes


def _about_walking(fitted: Sequence[FittedRecord]) -> list[str]:
    """Fitted records none of which walks or shows a force, so that none may show sliding friction."""
    moving = [r for r in fitted if r.measures == "effector" and r.frequency]
    if not moving or any(r.measures in ("friction", "force") for r in fitted):
        return []
    steps = []
    for record in moving:
        drift = drift_per_cycle(record.time, record.measured, record.frequency or 0.0)
        if drift is None or abs(drift.net) > max(0.01 * drift.stroke, 3.0 * drift.standard_error):
            return []
        text = record.display.text
        steps.append(f"{text(drift.net)} +/- {text(drift.standard_error)} a cycle in {quoted([record])}")
    return [
        f"No record that was fitted walks: the end-effector comes back ({listed(steps)}). Either it never slips, and "
        "then nothing tells at which force it would, or every slip takes back the whole stroke. Add a record of "
        "a higher voltage or with a steeper fast flank."
    ]


def _enlarged(factor: float, is_robust: bool) -> str:
    if is_robust:
        return "Standard errors do not depend on the noise given: under a robust loss they come from the residuals."
    if factor > 1.0:
        return f"Standard errors from records with given noise are multiplied by {np.sqrt(factor):.3g}."
    return (
        "Over all records with given noise chi-square is not too large, so standard errors are not enlarged; they are "
        "too small if this record is right."
    )
