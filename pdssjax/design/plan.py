"""A plan: the next records, their sample times, and the expected errors."""

import dataclasses
from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
from jaxtyping import Float

from ..core import Document, Figure, equal_by_value, presenter
from ..inference import transform_of
from ..study import MARK, Estimate, Parameter, Record, Study
from .criteria import AbstractCriterion
from .experiments import Experiment, Limits, Resources, condition_name
from .information import Noise
from .sampling import Schedule

FORMAT = "pdssjax-plan/1"
"""The format of the file in which a plan is kept."""

Errors: TypeAlias = dict[str, float]
"""Standard errors [SI] by path; NaN where nothing determines the parameter."""


@equal_by_value
@dataclasses.dataclass(frozen=True)
class Knowledge:
    """Prior knowledge of a study's parameters, before the next records."""

    values: Mapping[str, float]
    """By path [SI]."""
    names: tuple[str, ...] = ()
    """Free parameters that the records so far determine."""
    covariance: Float[np.ndarray, "p p"] = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    """Covariance of `names` [SI], by the recommended error model."""
    misfit: Mapping[str, float] = dataclasses.field(default_factory=dict)
    """Factor by which the residuals exceed the noise, for each kind of record; 1 where they do not."""
    open: tuple[str, ...] = ()
    """Parameters whose profiles are flat, or open on one side."""
    source: str = "the study's values and starts"
    """Where it comes from, in words."""


def knowledge_of(estimate: Estimate) -> Knowledge:
    """Prior knowledge from an estimate: values, covariance by the recommended error model, misfit, open intervals."""
    believed = estimate.covariance
    if estimate.error_advice is not None and estimate.error_advice.model in estimate.covariances:
        believed = estimate.covariances[estimate.error_advice.model]
    known = np.flatnonzero(np.isfinite(np.diag(believed)))
    records = [(record.measures, record.reduced_chi2) for record in estimate.records if record.role == "fit"]
    return Knowledge(
        values={path: parameter.value for path, parameter in estimate.parameters.items()},
        names=tuple(estimate.names[i] for i in known),
        covariance=believed[np.ix_(known, known)],
        misfit=misfit_by_kind(records),
        open=tuple(path for path, p in estimate.parameters.items() if p.verdicts and "flat" in p.verdicts),
        source=f'the estimate "{estimate.title}"',
    )


def misfit_by_kind(records: list[tuple[str, float]]) -> dict[str, float]:
    """The root of the largest chi-square per degree of freedom, for each kind of record; 1 at least."""
    found: dict[str, float] = {}
    for kind, excess in records:
        if np.isfinite(excess):
            found[kind] = max(found.get(kind, 1.0), float(np.sqrt(excess)))
    return found


def slopes_of(study: Study, knowledge: Knowledge) -> dict[str, float]:
    """By path of a free parameter, its change [SI] by one on the fit's scale, at the numbers known."""
    transform = transform_of(study.parameters, knowledge.values)
    slopes = transform.slope(transform.encode(knowledge.values))
    return {path: float(slope) for path, slope in zip(transform.paths, slopes, strict=True)}


def prior_information(study: Study, knowledge: Knowledge, paths: tuple[str, ...]) -> Float[np.ndarray, "p p"]:
    """The information known before on the free parameters `paths`, on the fit's scale.

    It is the inverse of the estimate's covariance; without an estimate what the study says was measured apart.
    """
    information = np.zeros((len(paths), len(paths)))
    slope = slopes_of(study, knowledge)
    if knowledge.names:
        rows = [(i, paths.index(name)) for i, name in enumerate(knowledge.names) if name in paths]
        inside, places = [i for i, _ in rows], [place for _, place in rows]
        scale = np.array([slope[paths[place]] for place in places])
        covariance = knowledge.covariance[np.ix_(inside, inside)] / np.outer(scale, scale)
        size = np.sqrt(np.diag(covariance))
        inverse = np.linalg.pinv(covariance / np.outer(size, size), rcond=1e-12, hermitian=True)
        information[np.ix_(places, places)] = inverse / np.outer(size, size)
        return information
    for place, path in enumerate(paths):
        prior = study.parameters[path].measured_apart
        if prior is not None:
            information[place, place] = (slope[path] / prior[1]) ** 2
    return information


@dataclasses.dataclass(frozen=True, eq=False)
class PlannedRecord:
    """One record of a plan."""

    name: str
    experiment: Experiment
    schedule: Schedule
    noise: Noise
    """The noise that the plan assumes, misfit included."""
    contributes: float
    """Growth factor of the criterion's error without the record; for a discrimination, its share of the evidence."""

    @property
    def times(self) -> Float[np.ndarray, " n"]:
        """Sample times [s] from the start of the drive."""
        return self.schedule.times(self.experiment.period)

    def record(self, study: Study) -> Record:
        """The planned record as a record of a study, still to be made, its zero free."""
        made = self.experiment.record(study, self.name, self.times, self.noise.deviation)
        measurement, columns = made.measurement, {"time": ("time_s", "")}
        if measurement.prescribed is not None:
            columns[measurement.prescribed] = (f"{measurement.prescribed}_{measurement.prescribed_display.unit}", "")
        columns[measurement.quantity] = (f"{measurement.quantity}_{measurement.display.unit}", "")
        return dataclasses.replace(made, columns=columns)

    def document(self) -> Document:
        """The record as plain data, in SI."""
        experiment, schedule = self.experiment, self.schedule
        return {
            "name": self.name,
            "measures": experiment.kind,
            "waveform": experiment.group[1] or None,
            "drive": experiment.shape | experiment.words,
            "motion": None
            if experiment.motion is None
            else dict(zip(("amplitude", "frequency"), experiment.motion, strict=True)),
            "rig": dict(experiment.rig),
            "noise": self.noise.deviation,
            "correlation_time": self.noise.correlation_time,
            "samples": schedule.count,
            "windows": [window._asdict() for window in schedule.list_windows(experiment.period)],
            "contributes": self.contributes,
        }


@dataclasses.dataclass(frozen=True, eq=False)
class Plan:
    """The next records of a study, best by a criterion within a budget."""

    study: Study
    """The study with the numbers that the plan assumes."""
    knowledge: Knowledge
    criterion: AbstractCriterion
    limits: Limits
    budget: Resources
    records: tuple[PlannedRecord, ...]
    before: Errors
    """Standard errors [SI] by what is known before."""
    alone: Errors
    """Standard errors [SI] by the plan's records alone."""
    after: Errors
    """Standard errors [SI] by both."""
    alone_identify: Errors
    """The errors `alone` of a fit that does not whiten coloured noise, as `identify` does; equal where it is white."""
    after_identify: Errors
    """The errors `after` of such a fit."""
    value: float
    """The criterion with the plan, the mean over what is not known."""
    value_before: float
    """The criterion without the plan; NaN where the records so far determine nothing."""
    notes: tuple[str, ...]
    """Sentences the user must read, such as combinations that the plan's records alone do not tell."""
    candidates: int
    """Records, of different sampling too, that were compared."""
    draws: int
    """Sets of parameters over which the criterion is the mean."""
    seconds: float
    """Wall time of the search [s]."""
    rival: str = ""
    """The law that is to be told apart from the study's."""

    @property
    def with_rig(self) -> Study:
        """The study without records, what is set for some of the plan's listed under their conditions."""
        parameters = dict(self.study.parameters)
        legal = self.study.legal()
        for planned in self.records:
            for path, number in planned.experiment.rig:
                if path not in parameters:
                    parameters[path] = Parameter(path, legal[path].unit, legal[path], value=legal[path].nominal)
                here = f"{path}{MARK}{condition_name(path, number)}"
                parameters[here] = Parameter(here, legal[path].unit, legal[path], value=number)
        return dataclasses.replace(self.study, parameters=parameters, records=())

    def as_study(self) -> Study:
        """A study of the planned records, still to be made."""
        rig = self.with_rig
        return dataclasses.replace(rig, records=tuple(planned.record(rig) for planned in self.records))

    @property
    def samples(self) -> int:
        """Number of samples of all records together."""
        return sum(planned.schedule.count for planned in self.records)

    def __repr__(self) -> str:
        kinds = ", ".join(planned.experiment.name for planned in self.records)
        return f"Plan({len(self.records)} records, {self.samples} samples: {kinds})"

    def _repr_html_(self) -> str:
        return presenter().as_html(self)

    def plot(self) -> Figure:
        """A figure of matplotlib: where the samples go, and the expected errors before and after."""
        return presenter().as_figure(self)

    def document(self) -> Document:
        """The plan as plain data, in SI."""
        return {
            "format": FORMAT,
            "title": self.study.title,
            "criterion": self.criterion.name,
            "rival": self.rival or None,
            "value": self.value,
            "value_before": self.value_before,
            "in_words": self.criterion.in_words(self.value),
            "budget": {key: getattr(self.budget, key) for key in ("samples", "records", "seconds", "cost")},
            "samples": self.samples,
            "records": [planned.document() for planned in self.records],
            "standard_errors": {
                path: {
                    "value": self.knowledge.values[path],
                    "unit": self.study.parameters[path].unit,
                    "before": self.before[path],
                    "alone": self.alone[path],
                    "after": self.after[path],
                    "after_identify": self.after_identify[path],
                }
                for path in self.after
            },
            "knowledge": self.knowledge.source,
            "open": self.knowledge.open,
            "notes": self.notes,
            "candidates": self.candidates,
            "draws": self.draws,
            "seconds": self.seconds,
        }
