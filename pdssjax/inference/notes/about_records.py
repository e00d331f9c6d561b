"""Which records the fit does not explain, and how."""

from collections.abc import Sequence

import numpy as np

from ...metrics import counts_without_noise, drift_per_cycle, held_in_words, resolution_of, slip_delay
from ...study import FittedRecord, Record
from ..poor_fit import (
    SIGMAS,
    above_floor,
    exceeds_floor,
    exceeds_given_noise,
    largest_by_chance,
    leaves_unresolved,
    neighbour_correlation,
    repeats,
    rest_scatter,
    stays_below_given_noise,
)
from ..validation import Missed
from .about_outliers import about_outliers
from .words import listed, quoted

CORRELATED = 0.3
"""Correlation of neighbouring residuals from which they are no noise."""

_NOISE = 0.9
"""Share of the residuals that neighbours must scatter for all of them to be noise."""

_OF_TIMING = 0.5
"""Share of what is left in slips that their delay explains, from which it is told."""

_NO_WALK = 0.01
"""Net step over stroke below which a motion is no walk."""


def about_peaks(read: Sequence[FittedRecord]) -> list[str]:
    """How well a stack that was read off peaks follows the records it was `read` from."""
    known = [record for record in read if record.simulated]
    if not known:
        return []
    figures = listed(f"{record.rmse / record.noise:.3g} times in {quoted([record])}" for record in known)
    return [
        f"The stack was read off peaks, not fitted: what it leaves of its own records, over their noise, is {figures}. "
        'The method "sequential" fits all their samples, and the errors that it leaves are smaller by far.'
    ]


def about_rests(records: Sequence[Record]) -> list[str]:
    """Which of the fitted records begin off zero, where nothing says what was before."""
    figures = [f'{r.rest_voltage:.4g} V in "{r.name}"' for r in records if r.rest_voltage is not None]
    if not figures:
        return []
    return [
        f"The voltage begins at {listed(figures)}, and the study does not say what was before: the actuator is taken "
        'to have rested there. If the voltage set in with the record, write conditioning = "0 s" in its [[record]]; '
        'if cycles ran before, conditioning = { cycles = 3, period = "1 s" }.'
    ]


def about_records(
    records: Sequence[FittedRecord], factor: float, is_robust: bool, missed: Sequence[Missed] = ()
) -> list[str]:
    """Which records the fit does not explain.

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
        figures = (f'"{r.name}" ({r.rest_chi2:.3g}; by chance up to {largest_by_chance(r):.3g})' for r in misfits)
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
    return (
        notes
        + _about_held(fitted)
        + _about_counts(fitted)
        + _about_repeating(fitted)
        + _about_slips([r for r in fitted if any(r is other for other in (*misfits, *over)) or repeats(r)])
        + _about_missed(missed)
        + _about_correlation(fitted)
        + _about_walking(fitted)
        + _about_failures(records)
    )


def _about_held(fitted: Sequence[FittedRecord]) -> list[str]:
    return [f"Found in {quoted([record])} {held}." for record in fitted if (held := held_in_words(record.measured))]


def _about_counts(fitted: Sequence[FittedRecord]) -> list[str]:
    """Records whose sensor counts in steps that hide their noise."""
    counted = [record for record in fitted if record.samples >= 8 and counts_without_noise(record.measured)]
    if not counted:
        return []
    figures = listed(f"of {r.display.text(resolution_of(r.measured) or 0.0)} in {quoted([r])}" for r in counted)
    return [
        f"The sensor counts in steps, {figures}, and no noise is seen between them: what is left is rounding, which "
        "follows the motion and does not average out as noise does. The true errors may be larger than the white "
        "standard errors."
    ]


def _about_repeating(fitted: Sequence[FittedRecord]) -> list[str]:
    found = [(record, record.lack_of_fit) for record in fitted if record.lack_of_fit and repeats(record)]
    if not found:
        return []
    figures = (
        f"{r.display.text(f.misfit)} beside noise of {r.display.text(f.noise)} in {quoted([r])}" for r, f in found
    )
    return [
        f"A part of the residuals repeats every cycle, {listed(figures)}: that is the model's misfit and not noise, "
        "and more cycles do not average it away. The true errors are larger than the white standard errors."
    ]


def _about_slips(unexplained: Sequence[FittedRecord]) -> list[str]:
    """Where slips that come early or late are most of what is left in them."""
    figures = []
    for record in unexplained:
        walks = record.measures == "effector" and record.frequency is not None
        found = slip_delay(record.time, record.predicted, record.rest) if walks else None
        if found is None or abs(found.delay) < SIGMAS * found.standard_error or found.explains < _OF_TIMING:
            continue
        when = "later" if found.delay > 0 else "earlier"
        figures.append(
            f"in {quoted([record])} {1e3 * abs(found.delay):.2g} ms {when}, {100 * found.explains:.0f} % of what is "
            "left in them"
        )
    if not figures:
        return []
    return [
        f"Slips come at other times than the model's: {listed(figures)}. Look at when the drive starts (start, "
        "sensor.delay), at the fall time and at the friction force."
    ]


def _about_missed(missed: Sequence[Missed]) -> list[str]:
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
    correlated = [r for r in fitted if neighbour_correlation(r) > CORRELATED and not leaves_unresolved(r)]
    if not correlated:
        return []
    return [
        f"Neighbouring residuals are correlated, as the model's errors are and noise is not, in {quoted(correlated)}. "
        "The true errors are larger than the white standard errors."
    ]


def _about_walking(fitted: Sequence[FittedRecord]) -> list[str]:
    """Where no record walks, and none shows a force, what friction does when it slides may be in none."""
    moving = [r for r in fitted if r.measures == "effector" and r.frequency]
    if not moving or any(r.measures in ("friction", "force") for r in fitted):
        return []
    told = []
    for record in moving:
        drift = drift_per_cycle(record.time, record.measured, record.frequency or 0.0)
        if drift is None or abs(drift.net) > max(_NO_WALK * drift.stroke, 3.0 * drift.standard_error):
            return []
        text = record.display.text
        told.append(f"{text(drift.net)} +/- {text(drift.standard_error)} a cycle in {quoted([record])}")
    return [
        f"No record that was fitted walks: the end-effector comes back ({listed(told)}). Either it never slips, and "
        "then nothing tells at which force it would, or every slip takes back the whole stroke. Add a record of "
        "a higher voltage or with a steeper fast flank."
    ]


def _about_failures(records: Sequence[FittedRecord]) -> list[str]:
    failed = [record for record in records if not record.simulated]
    if not failed:
        return []
    return [
        f"The simulation could not finish for {quoted(failed)}. Look at parameters that are extreme, such as a very "
        "high bandwidth or stiffness."
    ]


def _enlarged(factor: float, is_robust: bool) -> str:
    if is_robust:
        return "Standard errors do not depend on the noise given: under a robust loss they come from the residuals."
    if factor > 1.0:
        return f"Errors are enlarged by {np.sqrt(factor):.3g} for it, as far as they come from noise that was given."
    return "All records together hide it: the errors are not enlarged for it."
