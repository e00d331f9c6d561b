"""All notes of one fit, in the order in which they are read."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ...study import Estimate, Study
from ..least_squares import START_FAILED, Fit
from ..parameter_transform import ParameterTransform
from ..sensor_signs import about_signs
from ..steady_sines import Inseparable
from ..told_ranges import told_ranges
from ..validation import Missed
from .about_diagnosis import about_agreement
from .about_models import about_models, about_resonances
from .about_parameters import (
    about_bounds,
    about_distance,
    about_information,
    about_measured_apart,
    about_sines,
    about_starts,
    about_weak_determination,
)
from .about_records import about_peaks, about_records, about_rests


class ErrorFacts(NamedTuple):
    """What is known of a fit's errors."""

    null: Sequence[Float[np.ndarray, " p"]]
    """Directions without information."""
    weakly_determined: Bool[np.ndarray, " p"]
    """Which free parameters hardly have any."""
    factor: float
    """By which variances exceed those of the noise given; where the stack was read off peaks, of the records fitted
    after it."""
    by_peaks: bool
    """The stack was read off peaks."""
    is_robust: bool
    """The loss is robust, so that errors do not depend on the noise given."""
    missed: Sequence[Missed] = ()
    """Records that were not fitted and are not predicted."""
    mixed: Inseparable | None = None
    """What steady sines do not tell apart; None where nothing is so."""


def notes_of(
    estimate: Estimate, study: Study, fit: Fit, transform: ParameterTransform, facts: ErrorFacts
) -> tuple[str, ...]:
    """What the user must read of an `estimate`."""
    if fit.message == START_FAILED:
        return ()
    parameters, null = estimate.parameters, facts.null
    unknown = {path for v in null for path, share in zip(transform.paths, v, strict=True) if share}
    unsure = [path for path, is_weak in zip(transform.paths, facts.weakly_determined, strict=True) if is_weak]
    mixed = facts.mixed.paths if facts.mixed is not None else ()
    silent = {*unknown, *unsure, *mixed, *(path for path in transform.paths if parameters[path].at_bound)}
    values = {path: parameter.value for path, parameter in parameters.items()}
    return (
        *about_starts(study.parameters, parameters),
        *about_information(null, transform.paths, parameters),
        *about_weak_determination(unsure),
        *about_sines(facts.mixed),
        *about_bounds(study.parameters, fit.free, transform, parameters, told_ranges(study)),
        *about_distance([parameters[path] for path in transform.paths if path not in silent], transform),
        *about_measured_apart(parameters.values()),
        *about_models(study.models, values),
        *about_resonances(study.models, values, [p for p in transform.paths if p not in unknown], study.records),
        *about_signs([record for record in study.records if record.role == "fit"]),
        *about_rests([record for record in study.records if record.role == "fit"]),
        *_about_fitted(estimate, study, facts),
        *about_agreement(estimate.diagnosis, estimate.method),
    )


def _about_fitted(estimate: Estimate, study: Study, facts: ErrorFacts) -> list[str]:
    """Of the records; those that a stack was read off are not judged by the fit that held it."""
    if not facts.by_peaks:
        return about_records(estimate.records, facts.factor, facts.is_robust, facts.missed)
    read = [record.role == "fit" and record.measurement.platform_alone for record in study.records]
    judged = [found for found, is_read in zip(estimate.records, read, strict=True) if not is_read]
    peaks = [found for found, is_read in zip(estimate.records, read, strict=True) if is_read]
    return [*about_records(judged, facts.factor, facts.is_robust, facts.missed), *about_peaks(peaks)]
