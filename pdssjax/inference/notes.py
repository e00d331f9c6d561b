"""What the user must read after a fit: each fact once, only where it is true, with what to do next."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from ..core import display_unit
from ..study import (
    REACH,
    SHOWN,
    Diagnosis,
    FittedParameter,
    FittedRecord,
    Models,
    Parameter,
    Record,
    Resonance,
    Statistics,
    depends_on,
    hidden_from,
)
from .goodness import (
    EXCESS,
    SIGMAS,
    above_floor,
    exceeds_floor,
    exceeds_given_noise,
    highest_by_chance,
    neighbour_correlation,
    repeats,
    stays_below_given_noise,
)
from .parameter_transform import ParameterTransform

FAR = 10.0
"""Factor by which a parameter must have moved from its start to be worth a word."""

CORRELATED = 0.3
"""Correlation of neighbouring residuals from which they are no noise."""

NOTICEABLE = 2.0
"""Standard errors by which records must move a parameter for their disagreement to be worth a word."""

UNDAMPED = 0.005
"""Damping ratio below which a contact or a platform is not to be believed: it would ring for thirty periods."""


def shown(number: float, unit: str) -> str:
    """A number in SI as people read it, with its unit."""
    name, factor = display_unit(unit)
    return f"{number * factor:.4g} {name}".rstrip()


def listed(texts: Iterable[str]) -> str:
    """One, two and three, as a sentence has them."""
    texts = list(texts)
    return " and ".join([", ".join(texts[:-1]), texts[-1]]) if len(texts) > 1 else "".join(texts)


def about_information(
    null: Sequence[Float[np.ndarray, " p"]], paths: Sequence[str], parameters: Mapping[str, FittedParameter]
) -> list[str]:
    """What the data do not tell, by the directions that leave the residuals alone."""
    notes = []
    for direction in null:
        part = [(path, share) for path, share in zip(paths, direction, strict=True) if share != 0]
        names = listed(path for path, _ in part)
        if len(part) == 1:
            notes.append(_without_information(parameters[names]))
        elif all(abs(share - 1.0) < 1e-3 for _, share in part):
            notes.append(
                f"The data tell {names} only up to a common factor: all of them may be multiplied by the same "
                "number. Fix one, for example the mass, to know the others."
            )
        else:
            notes.append(
                f"The data tell {names} only in combination; what is given is one of many equal solutions. Fix one "
                "of them, or add a record that tells them apart."
            )
    return notes


def _without_information(parameter: FittedParameter) -> str:
    head = f"The data say nothing about {parameter.path}"
    advice = "Fix it, or add a record that shows it."
    if not moved(parameter):
        return f"{head}; its value is where the fit began. {advice}"
    begun, ended = (shown(number, parameter.unit) for number in (_start(parameter), parameter.value))
    return (
        f"{head} at the values found; on the way there it moved from {begun} to {ended}, which means nothing. {advice}"
    )


def moved(parameter: FittedParameter) -> bool:
    """A free parameter is not where it began."""
    return not np.isclose(parameter.value, _start(parameter), rtol=1e-6, atol=0.0)


def _start(parameter: FittedParameter) -> float:
    return parameter.value if parameter.start is None else parameter.start


def about_weak_determination(paths: Sequence[str]) -> list[str]:
    """Parameters whose errors are wider than a factor of ten."""
    if not paths:
        return []
    return [
        f"The data hardly tell {listed(paths)}: one standard error is a factor of ten or more. Fix what is known "
        "otherwise, or add a record that shows it."
    ]


def about_bounds(
    declared: Mapping[str, Parameter],
    found: Float[np.ndarray, " p"],
    scale: ParameterTransform,
    parameters: Mapping[str, FittedParameter],
) -> list[str]:
    """Parameters that ended on a bound, or ran out of reach; `found` on the fit's scale."""
    notes = []
    for side, ends in (("lower", found <= scale.low), ("upper", found >= scale.high)):
        at = [int(i) for i in np.flatnonzero(ends)]
        unreachable = [i for i in at if _out_of_reach(declared[scale.paths[i]], scale, i, side)]
        if unreachable:
            names, it = listed(scale.paths[i] for i in unreachable), "it" if len(unreachable) == 1 else "them"
            what = "zero" if side == "lower" else "one without limit"
            notes.append(
                f"The data cannot tell {names} from {what}: the fit stopped a factor of {REACH:g} from the start, and "
                f"holds {it} there for the errors of the others. Fix {it}, or add a record that shows {it}."
            )
        others = [scale.paths[i] for i in at if i not in unreachable]
        notes += [_at_bound(declared[path], parameters[path].value, side) for path in others]
    return notes


def _out_of_reach(declared: Parameter, scale: ParameterTransform, i: int, side: str) -> bool:
    """The end is that of a fit's reach: neither the study's nor that of the legal range."""
    given, legal, ends = (
        (declared.low, declared.quantity.low, scale.low)
        if side == "lower"
        else (declared.high, declared.quantity.high, scale.high)
    )
    if given is not None or not scale.logarithmic[i]:
        return False
    return not np.isclose(np.exp(ends[i]), legal, rtol=1e-5)


def _at_bound(declared: Parameter, value: float, side: str) -> str:
    given = declared.low if side == "lower" else declared.high
    key = "min" if side == "lower" else "max"
    head = f"{declared.path} is at its {side} bound, {shown(value, declared.unit)}"
    if given is not None:
        return (
            f"{head}, the {key} that the study gives, and held there for the errors of the others. Move the bound, "
            "unless there is a reason for it: the best fit lies beyond."
        )
    return f"{head}, the end of its legal range, and held there for the errors of the others. Fix it there."


def about_distance(parameters: Iterable[FittedParameter], scale: ParameterTransform) -> list[str]:
    """Parameters that ended far from where they began."""
    notes = []
    for parameter in parameters:
        i, begun = scale.paths.index(parameter.path), _start(parameter)
        if scale.logarithmic[i]:
            ratio = parameter.value / begun
            if not 1.0 / FAR <= ratio <= FAR:
                how = f"a factor of {max(ratio, 1.0 / ratio):.3g}"
                notes.append((parameter, how))
        elif abs(parameter.value - begun) > FAR * scale.unit[i]:
            notes.append((parameter, f"{abs(parameter.value - begun) / scale.unit[i]:.3g} times the size of its start"))
    if not notes:
        return []
    parts = [f"{p.path}, from {shown(_start(p), p.unit)} to {shown(p.value, p.unit)}, by {how}" for p, how in notes]
    return [
        f"Far from where the fit began: {'; '.join(parts)}. If that is not what is known of the rig, another optimum "
        "may be the true one: give a start near what is known, or min and max, and fit again."
    ]


def about_agreement(diagnosis: Diagnosis | None) -> list[str]:
    """Records, or all of one direction or kind, that ask for other parameters than the rest."""
    found = [] if diagnosis is None else [i for i in diagnosis.agreement if i.sigmas > SIGMAS]
    found = [i for i in found if abs(i.largest()[1]) > NOTICEABLE]
    if not found:
        return []
    worst = max(found, key=lambda agreement: agreement.sigmas)
    path, shift = worst.largest()
    names = listed(f'"{name}"' for name in worst.records)
    alone = len(worst.records) == 1
    others = "the other records" if alone else f"those of another {worst.what}"
    others_too = {name for agreement in found for name in agreement.records} - set(worst.records)
    also = f" So do {listed(chr(34) + name + chr(34) for name in sorted(others_too))}, less." if others_too else ""
    return [
        f"{names} {'contradicts' if alone else 'contradict'} {others} ({worst.sigmas:.3g} standard deviations beyond "
        f"chance): without {'it' if alone else 'them'} {path} would be {abs(shift):.2g} standard errors "
        f"{'larger' if shift > 0 else 'smaller'}.{also} No one set of parameters explains all: look for a wrong "
        "voltage, direction, unit or sign, a surface that differs, or a law that lacks something."
    ]


def about_remedy(diagnosis: Diagnosis | None) -> list[str]:
    """The one parameter that, known from elsewhere, would make others much better known."""
    remedy = None if diagnosis is None else diagnosis.remedy
    if remedy is None:
        return []
    gains = (
        f"{path} from {100 * before:.2g} to {100 * after:.2g} %" for path, (before, after) in remedy.errors.items()
    )
    return [
        f"If {remedy.path} were known from elsewhere, errors would fall: {listed(gains)}. Measure it by itself and "
        "fix it, or add a record that shows it."
    ]


def about_models(models: Models, values: Mapping[str, float]) -> list[str]:
    """Conditions that tie parameters together, and are broken by what was found."""
    broken = models.actuator(values).piezo.broken_conditions()
    return [
        f"The parameters found break a condition of the model: {text}. Set min and max so that it holds, or fix "
        "one of them, and fit again."
        for text in broken
    ]


def about_resonances(
    models: Models, values: dict[str, float], paths: Sequence[str], records: Sequence[Record]
) -> list[str]:
    """Modes that no record is sampled finely enough for, and modes without damping; of free `paths` only."""
    notes = []
    for mode, involved in depends_on(models, values, paths).items():
        seen = [record for record in records if mode.acts_on(record.measurement)]
        if not involved or not seen:
            continue
        if aliased := hidden_from(mode, records):
            notes.append(_alias(mode, involved, aliased))
        if 0.0 < mode.damping_ratio < UNDAMPED:
            notes.append(
                f"The {mode.what} is found to ring at {mode.frequency:.4g} Hz with a damping ratio of "
                f"{mode.damping_ratio:.2g}, for {0.16 / mode.damping_ratio:.0f} periods: that is not to be believed "
                f"of a real one. Look at {listed(involved)}: another start, or min and max, may lead to another "
                "optimum."
            )
    return list(dict.fromkeys(notes))


def _alias(mode: Resonance, involved: Sequence[str], records: Sequence[Record]) -> str:
    rates = [1.0 / float(np.percentile(np.diff(record.time), 10.0)) for record in records]
    names = listed(f'"{record.name}" ({rate:.4g} Hz)' for record, rate in zip(records, rates, strict=True))
    highest_rate, enough = max(rates), float(f"{mode.frequency / SHOWN:.2g}")
    image = abs(mode.frequency - round(mode.frequency / highest_rate) * highest_rate)
    return (
        f"The {mode.what} is found to ring at {mode.frequency:.4g} Hz (damping ratio {mode.damping_ratio:.2g}), above "
        f"the {SHOWN * highest_rate:.4g} Hz that samples at {highest_rate:.4g} Hz show; no record that it acts on is "
        f"sampled more finely: {names}. It may be an alias, since its samples are like those of {image:.4g} Hz. Do not "
        f"trust {listed(involved)} before a record sampled at {enough:g} Hz or more has confirmed "
        f"{'them' if len(involved) > 1 else 'it'}."
    )


def about_peaks(read: Sequence[FittedRecord]) -> list[str]:
    """How well a stack that was read off peaks follows the records it was `read` from."""
    known = [record for record in read if record.simulated]
    if not known:
        return []
    figures = listed(f"{record.rmse / record.noise:.3g} times in {_quoted([record])}" for record in known)
    return [
        f"The stack was read off peaks, not fitted: what it leaves of its own records, over their noise, is {figures}. "
        'The method "sequential" fits all their samples, and the errors that it leaves are smaller by far.'
    ]


def about_records(records: Sequence[FittedRecord], statistics: Statistics) -> list[str]:
    """Which records the fit does not explain."""
    notes = []
    known = [record for record in records if record.simulated]
    fitted = [record for record in known if record.role == "fit"]
    excess = [record for record in fitted if exceeds_given_noise(record)]
    noisy = [record for record in excess if record.noise_floor > 0.9 * record.rmse]
    if noisy:
        notes.append(
            f"The noise given is too small for {_quoted(noisy)}: neighbouring samples alone scatter by "
            f"{listed(r.display.text(r.noise_floor) for r in noisy)}, where "
            f"{listed(r.display.text(r.noise) for r in noisy)} is given. Correct it, or leave it out. "
            f"{_enlarged(statistics)}"
        )
    if misfits := [record for record in excess if record not in noisy]:
        figures = (f'"{r.name}" ({r.reduced_chi2:.3g}; by chance up to {_chance(r):.3g})' for r in misfits)
        notes.append(
            f"The model does not explain all of {listed(figures)}: chi-square per sample against the noise given is "
            f"in brackets. {_enlarged(statistics)} Look at the residuals in the plots for what is missing: another "
            "law, a fall time, hysteresis, a wrong drive."
        )
    if over := [record for record in fitted if record.noise_estimated and exceeds_floor(record)]:
        figures = (f"{above_floor(r):.2g} times in {_quoted([r])}" for r in over)
        notes.append(
            "No noise is given, so it was taken from the residuals; but these are larger than the noise seen between "
            f"neighbouring samples, {listed(figures)}: the model does not explain all that was measured there, or the "
            "fit is in a wrong optimum. Look at the residuals in the plots, try other starts, or give the noise."
        )
    if less := [record for record in fitted if stays_below_given_noise(record)]:
        figures = (f"{_quoted([r])} ({r.display.text(r.rmse)} where {r.display.text(r.noise)} is given)" for r in less)
        notes.append(
            f"The residuals are smaller than the noise given in {listed(figures)}: the standard errors are larger "
            "than they need be. Give the noise as it is, or leave it out."
        )
    return (
        notes
        + _about_repeating(fitted)
        + _about_outliers(fitted)
        + _about_validation(known)
        + _about_correlation(fitted)
        + _about_failures(records)
    )


def _about_repeating(fitted: Sequence[FittedRecord]) -> list[str]:
    found = [(record, record.lack_of_fit) for record in fitted if record.lack_of_fit and repeats(record)]
    if not found:
        return []
    figures = (
        f"{r.display.text(f.misfit)} beside noise of {r.display.text(f.noise)} in {_quoted([r])}" for r, f in found
    )
    return [
        f"A part of the residuals repeats every cycle, {listed(figures)}: that is the model's misfit and not noise, "
        "and more cycles do not average it away. The true errors are larger than the white standard errors."
    ]


def _about_outliers(fitted: Sequence[FittedRecord]) -> list[str]:
    found = [record for record in fitted if record.outliers.size]
    if not found:
        return []
    return [
        f"Samples stand out of the residuals: {listed(map(_outliers, found))}. If they are glitches, leave them out "
        "(exclude in the study) or fit with --loss huber, under which they pull little."
    ]


def _outliers(record: FittedRecord) -> str:
    off = np.abs(record.measured - record.predicted)[record.outliers]
    times = listed(f"{t:.6g}" for t in record.time[record.outliers][np.argsort(-off)][:3])
    count = record.outliers.size
    return (
        f"{count} in {_quoted([record])} by up to {record.display.text(float(off.max()))}, "
        f"{'the largest ' if count > 3 else ''}at t = {times} s"
    )


def _about_validation(records: Sequence[FittedRecord]) -> list[str]:
    others = [record for record in records if record.role != "fit"]
    figures = [
        f"{np.sqrt(r.reduced_chi2):.2g} times the noise given in {_quoted([r])}"
        for r in others
        if exceeds_given_noise(r)
    ]
    figures += [
        f"{above_floor(r):.2g} times the noise seen between neighbouring samples in {_quoted([r])}"
        for r in others
        if r.noise_estimated and exceeds_floor(r)
    ]
    if not figures:
        return []
    return [
        f"Records that were not fitted are not predicted down to their noise: the residuals are {listed(figures)}. "
        "The model or the optimum found does not carry over to them: fit them too, and see whether all agree."
    ]


def _about_correlation(fitted: Sequence[FittedRecord]) -> list[str]:
    correlated = [record for record in fitted if neighbour_correlation(record) > CORRELATED]
    if not correlated:
        return []
    return [
        f"Neighbouring residuals are correlated, as the model's errors are and noise is not, in {_quoted(correlated)}. "
        "The true errors are larger than the white standard errors."
    ]


def _about_failures(records: Sequence[FittedRecord]) -> list[str]:
    failed = [record for record in records if not record.simulated]
    if not failed:
        return []
    return [
        f"The simulation could not finish for {_quoted(failed)}. Look at parameters that are extreme, such as a very "
        "high bandwidth or stiffness."
    ]


def _enlarged(statistics: Statistics) -> str:
    if statistics.reduced_chi2 > 1.0:
        return f"All errors are enlarged by {np.sqrt(statistics.reduced_chi2):.3g} for it."
    return f"The total, {statistics.reduced_chi2:.2g}, hides it: the errors are not enlarged for it."


def _quoted(records: Sequence[FittedRecord]) -> str:
    return listed(f'"{record.name}"' for record in records)


def _chance(record: FittedRecord) -> float:
    return max(EXCESS, highest_by_chance(record.samples))
