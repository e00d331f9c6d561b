"""All notes of one fit, in the order in which they are read, and those on its parameters."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ...core import display_unit
from ...piezo.base import DeterminableRange
from ...study import (
    REACH,
    SHOWN,
    Estimate,
    FittedParameter,
    Models,
    Parameter,
    Record,
    Study,
    depends_on,
    hidden_from,
)
from ..evidence import Evidence
from ..least_squares import START_FAILED
from ..parameter_transform import ParameterTransform
from ..problem import determinable_ranges
from ..record_checks import about_signs
from ..steady_sines import InseparableParameters
from ..validation import MissedRecord
from .about_records import about_agreement, about_peaks, about_records, about_rests, in_display_unit, listed

UNDAMPED = 0.005
"""Damping ratio below which a resonance of a contact or a platform is implausible: it would ring for thirty periods."""


def about_models(models: Models, values: Mapping[str, float]) -> list[str]:
    """Conditions between parameters that the values found break."""
    return [
        f"The parameters found break a condition of the model: {text}. Set min and max so that it holds, or fix "
        "one of them, and fit again."
        for text in models.actuator(values).piezo.broken_conditions()
    ]


def about_resonances(
    models: Models, values: dict[str, float], paths: Sequence[str], records: Sequence[Record]
) -> list[str]:
    """Modes that no record is sampled finely enough for, and modes without damping; of free `paths` only."""
    notes = []
    for mode, involved in depends_on(models, values, paths).items():
        if not involved or not any(mode.acts_on(record.measurement) for record in records):
            continue
        if aliased := hidden_from(mode, records):
            rates = [1.0 / float(np.percentile(np.diff(record.time), 10.0)) for record in aliased]
            names = listed(f'"{record.name}" ({rate:.4g} Hz)' for record, rate in zip(aliased, rates, strict=True))
            highest_rate, enough = max(rates), float(f"{mode.frequency / SHOWN:.2g}")
            image = abs(mode.frequency - round(mode.frequency / highest_rate) * highest_rate)
            note = (
                f"The {mode.what} is found to ring at {mode.frequency:.4g} Hz (damping ratio {mode.damping_ratio:.2g}),"
                f" above the {SHOWN * highest_rate:.4g} Hz that samples at {highest_rate:.4g} Hz show; no record that "
                f"it acts on is sampled more finely: {names}. It may be an alias, since its samples are like those of "
                f"{image:.4g} Hz. Do not trust {listed(involved)} before a record sampled at {enough:g} Hz or more has "
                f"confirmed {'them' if len(involved) > 1 else 'it'}."
            )
            if mode.what == "platform":
                note += " A stage this slow needs no resonance: fix it, or choose static dynamics."
            notes.append(note)
        if 0.0 < mode.damping_ratio < UNDAMPED:
            notes.append(
                f"The {mode.what} is found to ring at {mode.frequency:.4g} Hz with a damping ratio of "
                f"{mode.damping_ratio:.2g}, for {0.16 / mode.damping_ratio:.0f} periods: that is not to be believed "
                f"of a real one. Look at {listed(involved)}: another start, or min and max, may lead to another "
                "optimum."
            )
    return list(dict.fromkeys(notes))


FAR = 10.0
"""Factor by which a parameter must have moved from its start to be worth a note."""

CONTRADICTED = 3.0
"""Pull of a number measured apart that is worth a note: by chance one in 370 has it."""


def about_starts(declared: Mapping[str, Parameter], parameters: Mapping[str, FittedParameter]) -> list[str]:
    """Sources of the starts that were given from elsewhere than the study."""
    free = [path for path, parameter in parameters.items() if parameter.free]
    # A poor fit may have begun from other starts.
    given = [declared[path].source for path in free if declared[path].start == parameters[path].start]
    return [
        f"Of the {len(free)} free parameters {given.count(source)} started at the numbers of: {source}."
        for source in dict.fromkeys(given)
        if source
    ]


def about_information(
    null: Sequence[Float[np.ndarray, " p"]], paths: Sequence[str], parameters: Mapping[str, FittedParameter]
) -> list[str]:
    """Notes on combinations of parameters that leave the residuals unchanged."""
    notes = []
    for direction in null:
        part = [(path, share) for path, share in zip(paths, direction, strict=True) if share != 0]
        names = listed(path for path, _ in part)
        if len(part) == 1:
            parameter = parameters[names]
            note = f"The data say nothing about {names}; its value is where the fit began."
            if moved(parameter):
                numbers = _start(parameter), parameter.value
                start, end = (in_display_unit(number, parameter.unit) for number in numbers)
                note = (
                    f"The data say nothing about {names} at the values found; on the way there it moved from {start} "
                    f"to {end}, which means nothing."
                )
            notes.append(f"{note} Fix it, or add a record that shows it.")
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


def moved(parameter: FittedParameter) -> bool:
    """Whether a free parameter is not where it began."""
    return not np.isclose(parameter.value, _start(parameter), rtol=1e-6, atol=0.0)


def _start(parameter: FittedParameter) -> float:
    return parameter.value if parameter.start is None else parameter.start


def about_sines(found: InseparableParameters | None) -> list[str]:
    """Parameters that records of steady sines do not tell apart."""
    if found is None:
        return []
    records, names = listed(f'"{name}"' for name in found.records), listed([*found.paths, *found.beside])
    at = listed(f"{frequency:.4g} Hz" for frequency in found.frequencies)
    errors = "it has no error" if len(found.paths) == 1 else "they have no errors"
    known, unknown = 2 * len(found.frequencies), len(found.paths) + len(found.beside)
    return [
        f"The records cannot tell {names} apart: a steady sine tells a gain and a phase, {known} numbers "
        f"of {records} (at {at}), where these are {unknown}. What the fit has of {listed(found.paths)} "
        f"rests on the shape of the loops alone, as the law of the stack has it, and {errors}. Hold what is known "
        "otherwise (value in the study), or add a step or a sine of another frequency."
    ]


def about_bounds(
    declared: Mapping[str, Parameter],
    found: Float[np.ndarray, " p"],
    scale: ParameterTransform,
    parameters: Mapping[str, FittedParameter],
    ranges: Mapping[str, DeterminableRange],
) -> list[str]:
    """Parameters that ended on a bound, or ran out of reach; `found` on the fit's scale.

    **Arguments:** the `ranges` in which records determine some of them, where these bound the fit.
    """
    links = {link.child: link for link in scale.ties.links} if scale.ties is not None else {}
    notes = []
    for side, ends in (("lower", found <= scale.low), ("upper", found >= scale.high)):
        constraints, unreachable, others = [], [], []
        for i, path in [(int(i), scale.paths[i]) for i in np.flatnonzero(ends)]:
            p, link = declared[path], links.get(path)
            given, legal, end = (
                (p.low, p.quantity.low, scale.low) if side == "lower" else (p.high, p.quantity.high, scale.high)
            )
            if link is not None and link.is_upper == (side == "upper"):
                constraints.append(link.constraint)
            # At the end of a fit's reach: neither the study's bound, nor that of the records or the legal range.
            elif (
                path not in ranges
                and given is None
                and scale.logarithmic[i]
                and not np.isclose(np.exp(end[i]), legal, rtol=1e-5)
            ):
                unreachable.append(path)
            else:
                others.append(path)
        notes += [
            f"{constraint.lesser if side == 'upper' else constraint.greater} is at the constraint {constraint.text} "
            f'("{constraint.name}" in [constraints]), and held there for the errors of the others. Leave the '
            "constraint out, unless there is a reason for it: the best fit lies beyond."
            for constraint in constraints
        ]
        if unreachable:
            names, it = listed(unreachable), "it" if len(unreachable) == 1 else "them"
            what = "zero" if side == "lower" else "one without limit"
            notes.append(
                f"The data cannot tell {names} from {what}: the fit stopped a factor of {REACH:g} from the start, and "
                f"holds {it} there for the errors of the others. Fix {it}, or add a record that shows {it}."
            )
        notes += [_at_bound(declared[path], parameters[path].value, side, ranges.get(path)) for path in others]
    return notes


def _at_bound(declared: Parameter, value: float, side: str, determinable: DeterminableRange | None) -> str:
    given = declared.low if side == "lower" else declared.high
    key = "min" if side == "lower" else "max"
    head = f"{declared.path} is at its {side} bound, {in_display_unit(value, declared.unit)}"
    if given is not None:
        return (
            f"{head}, the {key} that the study gives, and held there for the errors of the others. Move the bound, "
            "unless there is a reason for it: the best fit lies beyond."
        )
    if determinable is not None:
        why = determinable.why_low if side == "lower" else determinable.why_high
        return (
            f"{head}, {why}, and held there for the errors of the others: the records do not tell what lies beyond. "
            f"Fewer elements may do, or a record that shows it; {key} in the study lets the fit go on."
        )
    return f"{head}, the end of its legal range, and held there for the errors of the others. Fix it there."


def about_distance(parameters: Iterable[FittedParameter], scale: ParameterTransform) -> list[str]:
    """Parameters that ended far from their starts; those measured apart have a pull instead."""
    parts = []
    for p in parameters:
        i, begun = scale.paths.index(p.path), _start(p)
        if scale.logarithmic[i]:
            distance, what = max(p.value / begun, begun / p.value), "a factor of {:.3g}"
        else:
            distance, what = abs(p.value - begun) / scale.unit[i], "{:.3g} times the size of its start"
        if p.measured_apart is None and distance > FAR:
            ends = f"from {in_display_unit(begun, p.unit)} to {in_display_unit(p.value, p.unit)}"
            parts.append(f"{p.path}, {ends}, by {what.format(distance)}")
    if not parts:
        return []
    return [
        f"Far from where the fit began: {'; '.join(parts)}. If that is not what is known of the rig, another optimum "
        "may be the true one: give a start near what is known, or min and max, and fit again."
    ]


def about_measured_apart(parameters: Iterable[FittedParameter]) -> list[str]:
    """Parameters whose numbers measured apart the records contradict."""
    notes = []
    for parameter in parameters:
        if parameter.measured_apart is None or not abs(parameter.measured_apart.pull) > CONTRADICTED:
            continue
        number, error, pull = parameter.measured_apart
        unit = display_unit(parameter.unit)[0]
        prior = f"{parameter.with_error(number, error)} {unit}".rstrip()
        ended = f"{parameter.with_error(parameter.value, error).partition(' ')[0]} {unit}".rstrip()
        notes.append(
            f"The records contradict {parameter.path} as it was measured apart, {prior}: it ended at {ended}, "
            f"a pull of {pull:+.2g} (the difference in standard deviations "
            "that it has by chance). One of them is wrong, or the model is."
        )
    return notes


def notes_of(
    estimate: Estimate,
    study: Study,
    evidence: Evidence,
    null: Sequence[Float[np.ndarray, " p"]],
    weakly_determined: Bool[np.ndarray, " p"],
    factor: float,
    missed: Sequence[MissedRecord],
    inseparable: InseparableParameters | None,
) -> tuple[str, ...]:
    """All notes on an `estimate` that the user must read.

    **Arguments:**

    - `null`: directions without information.
    - `weakly_determined`: which free parameters have hardly any information.
    - `factor`: ratio of variances to those of the noise given; where the stack was read off peaks, of the records
      fitted after it.
    - `missed`: records that were not fitted and are not predicted.
    - `inseparable`: parameters that steady sines cannot separate; None where there are none.
    """
    problem, fit = evidence.problem, evidence.fit
    if fit.message == START_FAILED:
        return ()
    transform, parameters = problem.residual.transform, estimate.parameters
    unknown = {path for v in null for path, share in zip(transform.paths, v, strict=True) if share}
    unsure = [path for path, is_weak in zip(transform.paths, weakly_determined, strict=True) if is_weak]
    weak = [
        f"The data hardly tell {listed(unsure)}: one standard error is a factor of ten or more. Fix what is known "
        "otherwise, or add a record that shows it."
    ]
    at_bound = (path for path in transform.paths if parameters[path].at_bound)
    silent = {*unknown, *unsure, *at_bound, *(inseparable.paths if inseparable is not None else ())}
    values = {path: parameter.value for path, parameter in parameters.items()}
    fitted = [record for record in study.records if record.role == "fit"]
    # Records that a stack was read off are not judged by the fit that held it.
    read = [estimate.method == "peaks" and r.role == "fit" and r.measurement.platform_alone for r in study.records]
    judged = [found for found, is_read in zip(estimate.records, read, strict=True) if not is_read]
    peaks = [found for found, is_read in zip(estimate.records, read, strict=True) if is_read]
    return (
        *about_starts(study.parameters, parameters),
        *about_information(null, transform.paths, parameters),
        *(weak if unsure else ()),
        *about_sines(inseparable),
        *about_bounds(study.bounded_parameters, fit.free, transform, parameters, determinable_ranges(study)),
        *about_distance([parameters[path] for path in transform.paths if path not in silent], transform),
        *about_measured_apart(parameters.values()),
        *about_models(study.models, values),
        *about_resonances(study.models, values, [p for p in transform.paths if p not in unknown], study.records),
        *about_signs(fitted),
        *about_rests(fitted),
        *about_records(judged, factor, problem.residual.loss.is_robust, missed),
        *about_peaks(peaks),
        *about_agreement(estimate.diagnosis, estimate.method),
    )
