"""All notes of one fit, in the order in which they are read."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from ...study import Estimate, Study
from ..least_squares import START_FAILED, Fit
from ..parameter_transform import ParameterTransform
from ..sensor_signs import about_signs
from .about_diagnosis import about_agreement
from .about_models import about_models, about_resonances
from .about_parameters import (
    about_bounds,
    about_distance,
    about_information,
    about_measured_apart,
    about_weak_determination,
)
from .about_records import about_peaks, about_records


def notes_of(
    estimate: Estimate,
    study: Study,
    fit: Fit,
    transform: ParameterTransform,
    null: Sequence[Float[np.ndarray, " p"]],
    weakly_determined: Bool[np.ndarray, " p"],
    second_step_factor: float | None,
) -> tuple[str, ...]:
    """What the user must read of an `estimate`.

    **Arguments:** directions without information, `null`, and which free parameters are `weakly_determined`;
    `second_step_factor`, where the stack was read off peaks: the variance factor of the records fitted after it.
    """
    if fit.message == START_FAILED:
        return ()
    parameters = estimate.parameters
    unknown = {path for v in null for path, share in zip(transform.paths, v, strict=True) if share}
    unsure = [path for path, is_weak in zip(transform.paths, weakly_determined, strict=True) if is_weak]
    silent = {*unknown, *unsure, *(path for path in transform.paths if parameters[path].at_bound)}
    values = {path: parameter.value for path, parameter in parameters.items()}
    return (
        *about_information(null, transform.paths, parameters),
        *about_weak_determination(unsure),
        *about_bounds(study.parameters, fit.free, transform, parameters),
        *about_distance([parameters[path] for path in transform.paths if path not in silent], transform),
        *about_measured_apart(study.parameters, parameters),
        *about_models(study.models, values),
        *about_resonances(study.models, values, [p for p in transform.paths if p not in unknown], study.records),
        *about_signs([record for record in study.records if record.role == "fit"]),
        *_about_fitted(estimate, study, second_step_factor),
        *about_agreement(estimate.diagnosis, estimate.method),
    )


def _about_fitted(estimate: Estimate, study: Study, second_step_factor: float | None) -> list[str]:
    """Of the records; those that a stack was read off are not judged by the fit that held it."""
    if second_step_factor is None:
        return about_records(estimate.records, estimate.statistics)
    read = [record.role == "fit" and record.measurement.platform_alone for record in study.records]
    judged = [found for found, is_read in zip(estimate.records, read, strict=True) if not is_read]
    peaks = [found for found, is_read in zip(estimate.records, read, strict=True) if is_read]
    statistics = dataclasses.replace(estimate.statistics, reduced_chi2=second_step_factor)
    return [*about_records(judged, statistics), *about_peaks(peaks)]
