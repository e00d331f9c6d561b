"""Which records to make next: candidates, their information, exchange, and refinement of what is continuous.

All experiments within the limits are predicted and differentiated on dense grids at a few draws of the parameters; the
information of any sampling is interpolated from these (`survey`).  The best selection (`exchange`) is refined: windows
by a local search, voltage, frequency and duty by L-BFGS-B (`refinement`).  What a plan promises is then computed at its
own samples, nothing interpolated.
"""

import dataclasses
import functools
import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.special import ndtri

from ..core import InputError, check_kind, check_whole, nearest, require_float64, sobol_points
from ..drive.sawtooth import Sawtooth
from ..inference import transform_of
from ..study import Estimate, Study
from .criteria import CRITERIA, AbstractCriterion, Combinations, Determinant, Discrimination, Prediction, Trace
from .exchange import Candidates, Search, best_selection, promising
from .experiments import CompleteLimits, Experiment, Limits, Resources, completed_limits, possible_experiments
from .information import check_seen, inverse_of, least_squares_errors, unseen_combinations
from .plan import Errors, Knowledge, Plan, PlannedRecord, knowledge_of, prior_information, slopes_of
from .refinement import Pair, Refinement, refined
from .sampling import Schedule, contact_schedules, possible_schedules
from .survey import Point, Simulation, Survey

DRAWS = 4
"""Sets of parameters over which a plan is judged, unless asked otherwise."""

KEPT = 300
"""Candidates that are compared under all draws: the best under the first."""

_CYCLES = 8
"""After which the speed of a walk is that of all later cycles."""

_WIDEST = 1.0
"""Standard deviation, on the fit's scale, beyond which draws do not scatter: a factor of e."""


class Aim(NamedTuple):
    """The aim of a plan: its criterion, and the parameters or predictions that matter."""

    criterion: str = "d"
    """Name of the criterion, one of `CRITERIA`."""
    parameters: tuple[str, ...] = ()
    """Paths, of the criterion "parameter"."""
    speed_at: tuple[float, float] | None = None
    """Voltage [V] and frequency [Hz] at which the mean speed is to be predicted, of "prediction"."""
    rival: Study | None = None
    """The study with another law, fitted to the same records: all its numbers are known.  Of "discrimination"."""
    rival_knowledge: Knowledge | None = None
    """Prior knowledge of the rival's parameters by its fit; None: nothing."""


def design_experiment(
    study: Study,
    budget: Resources,
    *,
    knowledge: Estimate | Knowledge | None = None,
    limits: Limits | None = None,
    aim: Aim | None = None,
    count_known: bool = True,
    draws: int = DRAWS,
    seed: int = 0,
    refine: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Plan:
    """Find the next records of a study: kinds, drives and where a limited number of samples goes.

        study = pdssjax.load_study("my-rig/study.toml")
        plan = pdssjax.design_experiment(study, pdssjax.Resources(samples=2000, records=4), knowledge=estimate)
        plan.after["friction.sigma1_a"]

    **Arguments:**

    - `study`: its models, and its parameters with values or starts where `knowledge` has none.
    - `budget`: samples and records, and seconds and cost if they are limited.
    - `knowledge`: an estimate, whose covariance counts as information that is there already, and whose misfit enlarges
      the noise; None: values, starts and errors that the study gives.
    - `limits`: what rig, sensor and recorder can do; what is left out is as in the study's records.
    - `aim`: the criterion; None: parameters whose profiles are open, if the estimate has some, else "d".
    - `count_known`: whether what is known already counts; if not, the plan stands on its own.
    - `draws`: sets of parameters whose mean counts, of the estimate's covariance or the ranges that the study gives.
    - `seed`: of these draws.
    - `refine`: whether windows, voltages, frequencies and duties are refined after the exchange.
    - `progress`: takes lines of text.

    **Returns:** the `Plan`, whose `after` are the expected standard errors.

    **Raises:** `InputError` for limits that contradict each other, where no experiment can be simulated, and where no
    experiment within the limits determines a combination of parameters that the aim needs.
    """
    require_float64("design_experiment")
    check_kind("study", study, Study, "load_study")
    check_kind("budget", budget, Resources)
    check_whole("draws", draws, 1, 1000)
    begun, report = time.perf_counter(), progress or (lambda message: None)
    known = knowledge_of(knowledge) if isinstance(knowledge, Estimate) else knowledge
    known = known or Knowledge({})
    study, known = _with_numbers(study, known)
    # Without an aim: the parameters whose intervals are open by the estimate's profiles.
    aim = _checked_aim(study, aim or (Aim("parameter", known.open) if known.open else Aim()))
    limits = completed_limits(study, limits or Limits(), known.misfit)
    _check_budget(study, budget, limits)
    planning = _Planning(study, known, aim, limits, budget, count_known, draws, seed, report)
    return dataclasses.replace(planning.plan(refine), seconds=time.perf_counter() - begun)


def _with_numbers(study: Study, known: Knowledge) -> tuple[Study, Knowledge]:
    """The study with the numbers that are known, what is free still free; and these numbers, of all parameters."""
    legal = study.legal()
    for path in known.values:
        if path not in legal:
            raise InputError(f'knowledge: found the unknown parameter "{path}"; {nearest(path, legal)}')
    parameters = {
        path: dataclasses.replace(p, **{"start" if p.free else "value": float(known.values[path])})
        if path in known.values and (p.free or p.value is not None)
        else p
        for path, p in study.parameters.items()
    }
    study = dataclasses.replace(study, parameters=parameters)
    if not any(p.free for p in parameters.values()):
        raise InputError(f"{study.path or study.title}: parameters: found none that is free, expected at least one.")
    return study, dataclasses.replace(known, values=dict(study.values()))


def _checked_aim(study: Study, aim: Aim) -> Aim:
    if aim.criterion not in CRITERIA:
        raise InputError(f'criterion: found "{aim.criterion}"; {nearest(aim.criterion, CRITERIA)}')
    free = [path for path, parameter in study.parameters.items() if parameter.free]
    for path in aim.parameters:
        if path not in free:
            raise InputError(f'parameter: found "{path}", which is not free in the study; {nearest(path, free)}')
    needs = {
        "parameter": (aim.parameters, "paths of parameters"),
        "prediction": (aim.speed_at, "speed_at"),
        "discrimination": (aim.rival, "a rival study"),
    }
    given, expected = needs.get(aim.criterion, (True, ""))
    if not given:
        raise InputError(f'criterion: found "{aim.criterion}" alone, expected {expected} with it.')
    return aim


def _check_budget(study: Study, budget: Resources, limits: CompleteLimits) -> None:
    where = f"{study.path or study.title}: design: budget"
    if budget.records < 1 or budget.samples < 8 * budget.records:
        raise InputError(
            f"{where}: found {budget.samples} samples for {budget.records} records, expected at least one record and "
            "8 samples for each."
        )
    if not (budget.seconds > 0 and budget.cost >= limits.record_cost):
        raise InputError(
            f"{where}: found {budget.seconds:g} s and a cost of {budget.cost:g}, expected more than 0 s and at "
            f"least the {limits.record_cost:g} that a record costs."
        )


@dataclasses.dataclass(frozen=True, eq=False)
class _Planning:
    """The arguments of `design_experiment`, complete and checked, and what follows from them."""

    study: Study
    knowledge: Knowledge
    aim: Aim
    limits: CompleteLimits
    budget: Resources
    count_known: bool
    draws: int
    seed: int
    report: Callable[[str], None]

    def plan(self, refine: bool) -> Plan:
        """The best records found."""
        if not self.experiments:
            raise InputError(f"{self.where}: found no experiment within the limits, expected wider ones.")
        survey, points = self.survey, self.points
        self._simulate(self.experiments, points[:1], "simulating and differentiating")
        usable = [e for e in self.experiments if survey.is_simulated(e) and self._in_range(e)]
        if not usable:
            raise InputError(f"{self.where}: found no experiment that can be simulated, expected wider limits.")
        self.report("computing what each sampling tells")
        pairs = [(e, s) for e in usable for s in self._schedules(e)]
        pairs = [pair for pair in pairs if np.all(self.resources_of(*pair) <= self.budget.amounts)]
        if not pairs:
            raise InputError(f"{self.where}: found no record that the budget pays, expected more of it.")
        prior = self._prior()
        first = self._candidates(pairs, [0])
        notes = self._undetermined(prior + first.information.sum(axis=0)[0])
        if skipped := len(self.experiments) - len(usable):
            notes.append(
                f"{skipped} experiments were left out: they could not be simulated, or exceed the range of the sensor."
            )
        self.report(f"choosing among {len(pairs)} records")
        search = Search(self._criterion(points[:1]), prior[None], self.budget.amounts)
        kept = [pairs[i] for i in promising(first, search, KEPT)]
        self._simulate(list(dict.fromkeys(e for e, _ in kept)), points, "simulating under other parameters")
        self.report(f"choosing among {len(kept)} records under {len(points)} sets of parameters")
        everywhere = np.repeat(prior[None], len(points), axis=0)
        search = Search(self._criterion(points), everywhere, self.budget.amounts)
        plan = [kept[i] for i in best_selection(self._candidates(kept, range(len(points))), search)]
        if refine:
            plan = refined(Refinement(survey, search, points, self.resources_of, self.report), plan)
        self.report("computing what the plan promises")
        return self._finished(search, plan, len(pairs), notes)

    @property
    def where(self) -> str:
        """The beginning of messages."""
        return f"{self.study.path or self.study.title}: design"

    @functools.cached_property
    def experiments(self) -> list[Experiment]:
        """The experiments that the limits allow, before any is simulated."""
        return possible_experiments(self.study, self.limits)

    @functools.cached_property
    def speed_experiment(self) -> Experiment | None:
        """The effector under the sawtooth whose speed is to be predicted; None where no speed is."""
        if self.aim.speed_at is None:
            return None
        drives = [r.drive for r in self.study.records if r.drive is not None and r.drive.flanks() is not None]
        drive = (drives or [Sawtooth()])[0].with_peak_voltage()
        voltage, frequency = self.aim.speed_at
        return Experiment("effector", drive.with_numbers({"voltage": voltage, "frequency": frequency}), None, ())

    @functools.cached_property
    def survey(self) -> Survey:
        """Predictions and derivatives of these experiments and of the one whose speed is predicted."""
        speed = [] if self.speed_experiment is None else [self.speed_experiment]
        return Survey(self.study, self.aim.rival, self.limits, [*self.experiments, *speed])

    @functools.cached_property
    def points(self) -> list[Point]:
        """The parameters at which plans are judged: those known, then draws of what is not known of them."""
        transform = self.survey.own.problem.residual.transform
        centre = transform.encode(self.knowledge.values)
        rival = None
        if self.survey.rival is not None and self.aim.rival is not None:
            rival = self.survey.rival.problem.residual.transform.encode(self.aim.rival.values())
        spread = self._spread()
        if self.draws == 1 or not spread.any():
            return [Point(centre, rival)]
        cube = sobol_points(self.draws - 1, centre.size, self.seed)
        deviations = ndtri(np.clip(cube, 0.02, 0.98)) @ spread.T
        drawn = np.clip(centre + deviations, transform.low, transform.high)
        return [Point(centre, rival), *(Point(row, rival) for row in drawn)]

    def _spread(self) -> Float[np.ndarray, "p p"]:
        """A root of the covariance of what is not known, on the fit's scale.

        It is that of the estimate, or of independent errors: those measured apart, or a third of the ranges that the
        study gives.  Nothing scatters by more than `_WIDEST`.
        """
        paths = self.survey.own.paths
        transform = transform_of(self.study.parameters, self.knowledge.values)
        information = prior_information(self.study, self.knowledge, paths)
        if self.knowledge.names:
            values, vectors = np.linalg.eigh(information)
            size = np.minimum(1.0 / np.sqrt(np.maximum(values, 1e-300)), _WIDEST)
            return vectors * np.where(values > 0.0, size, 0.0)
        sizes = np.zeros(len(paths))
        for i, path in enumerate(paths):
            parameter = self.study.parameters[path]
            if information[i, i] > 0.0:
                sizes[i] = information[i, i] ** -0.5
            elif parameter.low is not None and parameter.high is not None:
                sizes[i] = (transform.high[i] - transform.low[i]) / 6.0
        return np.diag(np.minimum(sizes, _WIDEST))

    def _simulate(self, experiments: Sequence[Experiment], points: Sequence[Point], what: str) -> None:
        progress = lambda done, count: self.report(f"{what}: {done} of {count}")
        self.survey.simulate(experiments, dict(enumerate(points)), progress)

    def _in_range(self, experiment: Experiment) -> bool:
        """Whether the sensor can see all of an experiment's motion; of a walk, of the cycles that are simulated."""
        most = self.limits.range.get(experiment.kind)
        return most is None or self.survey.extent(experiment, self.points[0]) <= most

    def _schedules(self, experiment: Experiment) -> list[Schedule]:
        limits, most = self.limits, self.budget.samples
        share = most / self.budget.records
        if experiment.motion is not None:
            assert experiment.period is not None
            return contact_schedules(experiment.period, share, most, limits.interval, limits.duration)
        starts = experiment.corners()[:3]
        return possible_schedules(experiment.period, starts, share, most, limits.interval, limits.duration)

    def resources_of(self, experiment: Experiment, schedule: Schedule) -> Float[np.ndarray, "4"]:
        """Amounts that a record takes of the budget: samples, records, seconds and cost."""
        seconds = max(float(schedule.times(experiment.period)[-1]), 0.0)
        cost = self.limits.record_cost + self.limits.second_cost * seconds
        return np.array([schedule.count, 1.0, seconds, cost])

    def _candidates(self, pairs: Sequence[Pair], numbers: Sequence[int]) -> Candidates:
        information = np.array([self.survey.information(*pair, numbers) for pair in pairs])
        return Candidates(information, np.array([self.resources_of(*pair) for pair in pairs]))

    def _prior(self) -> Float[np.ndarray, "q q"]:
        """The information known before, of the study and of its rival."""
        survey, rival = self.survey, self.aim.rival
        out = np.zeros((survey.size, survey.size))
        if self.count_known:
            own = len(survey.own.paths)
            out[:own, :own] = prior_information(self.study, self.knowledge, survey.own.paths)
            if survey.rival is not None and rival is not None:
                known, others = self.aim.rival_knowledge or Knowledge(dict(rival.values())), survey.rival.paths
                here = slice(own, own + len(others))
                out[here, here] = prior_information(rival, known, others)
        return out

    def _criterion(self, points: Sequence[Point]) -> AbstractCriterion:
        aim, paths = self.aim, self.survey.own.paths
        if aim.criterion == "d":
            return Determinant()
        if aim.criterion == "a":
            return Trace()
        if aim.criterion == "discrimination":
            return Discrimination(len(paths))
        if aim.criterion == "parameter":
            rows = np.eye(len(paths))[[paths.index(path) for path in aim.parameters]]
            return Combinations(np.repeat(rows[None], len(points), axis=0), ", ".join(aim.parameters))
        assert aim.speed_at is not None and self.speed_experiment is not None
        speed, period = f"speed at {aim.speed_at[0]:g} V and {aim.speed_at[1]:g} Hz", 1.0 / aim.speed_at[1]
        times = np.array([(_CYCLES - 1) * period, _CYCLES * period])
        simulations = [Simulation(self.speed_experiment, times, point.free) for point in points]
        responses = self.survey.own.responses(simulations)
        steps = [float(np.diff(response.predicted)[0]) for response in responses]
        if not all(np.isfinite(step) and step != 0.0 for step in steps):
            raise InputError(f"{self.where}: found no {speed}: it is zero there, or cannot be simulated.")
        rows = [np.diff(response.jacobian, axis=0) / step for response, step in zip(responses, steps, strict=True)]
        return Prediction(np.array(rows), f"the {speed}")

    def _undetermined(self, information: Float[np.ndarray, "q q"]) -> list[str]:
        """Notes on what all candidates and all that is known leave undetermined; **raises** where the aim needs it."""
        if self.aim.criterion == "discrimination":
            return []
        paths = self.survey.own.paths
        unseen = unseen_combinations(information[: len(paths), : len(paths)], paths)
        every, needed = self.aim.criterion in ("d", "a"), set(self.aim.parameters)
        check_seen([u for u in unseen if every or needed & set(u.exponents)], self.where)
        return [f"No experiment within the limits changes with {combination.words}." for combination in unseen]

    def _finished(self, search: Search, plan: Sequence[Pair], candidates: int, notes: list[str]) -> Plan:
        """The `Plan` of the chosen records, its promised errors computed at their own samples."""
        survey, paths = self.survey, self.survey.own.paths
        plan = sorted(plan, key=lambda pair: self.limits.kinds.index(pair[0].kind))
        plan = [(experiment.rounded(), schedule.rounded()) for experiment, schedule in plan]
        information = survey.exact_information(plan, self.points)
        together = information.sum(axis=0)
        value, own = float(search.criterion(search.prior + together)), len(paths)
        prior, mine = search.prior[0][:own, :own], together[0][:own, :own]
        if alone := unseen_combinations(mine, paths):
            named = "; ".join(combination.words for combination in alone)
            notes = [
                *notes,
                f"The records of the plan alone do not tell {named}: fit them together with what is known.",
            ]
        records = tuple(
            PlannedRecord(
                f"{number} {experiment.name}",
                experiment,
                schedule,
                survey.noise(experiment.kind),
                _contribution(search, together, information[number - 1], value),
            )
            for number, (experiment, schedule) in enumerate(plan, start=1)
        )
        known_before = not isinstance(search.criterion, Discrimination) and np.all(
            np.diagonal(search.prior, axis1=1, axis2=2) > 0
        )
        after, by_itself = self._errors(prior + mine), self._errors(mine)
        identified = self._errors_of_identify(plan, [np.zeros_like(prior), prior])
        return Plan(
            study=self.study,
            knowledge=self.knowledge,
            criterion=search.criterion,
            limits=self.limits,
            budget=self.budget,
            records=records,
            before=self._errors(prior),
            alone=by_itself,
            after=after,
            alone_identify=identified[0] or by_itself,
            after_identify=identified[1] or after,
            value=value,
            value_before=float(search.criterion(search.prior)) if known_before else float("nan"),
            notes=tuple(notes),
            candidates=candidates,
            draws=len(self.points),
            seconds=0.0,
            rival="" if self.aim.rival is None else str(self.aim.rival.models.chosen["friction"]),
        )

    def _errors(self, information: Float[np.ndarray, "p p"]) -> Errors:
        """Standard errors [SI] by path, from an information matrix; NaN for parameters that it leaves undetermined."""
        paths = self.survey.own.paths
        lost = {path for combination in unseen_combinations(information, paths) for path in combination.exponents}
        kept = [i for i, path in enumerate(paths) if path not in lost]
        found = self._in_si([paths[i] for i in kept], np.diag(inverse_of(information[np.ix_(kept, kept)])))
        return dict.fromkeys(paths, float("nan")) | found

    def _in_si(self, paths: Sequence[str], variances: Float[np.ndarray, " p"]) -> Errors:
        slope = slopes_of(self.study, self.knowledge)
        return {p: float(slope[p] * np.sqrt(max(v, 0.0))) for p, v in zip(paths, variances, strict=True)}

    def _errors_of_identify(
        self, plan: Sequence[Pair], priors: Sequence[Float[np.ndarray, "p p"]]
    ) -> list[Errors | None]:
        """Standard errors [SI] of ordinary least squares with each of the `priors`.

        None where the noise is white, which makes them those of the plan, or where not all parameters are determined.
        """
        survey, paths = self.survey, self.survey.own.paths
        if not any(survey.noise(experiment.kind).correlation_time for experiment, _ in plan):
            return [None for _ in priors]
        exact = survey.exact_columns(plan, self.points[:1])
        records = [(columns[:, : len(paths)], times, survey.noise(e.kind)) for e, times, columns in exact]
        information = sum(columns.T @ (columns - columns.mean(axis=0)) for columns, _, _ in records)
        errors = lambda prior: self._in_si(paths, np.diag(least_squares_errors(records, prior)))
        return [None if unseen_combinations(prior + information, paths) else errors(prior) for prior in priors]


def _contribution(
    search: Search,
    together: Float[np.ndarray, "draws q q"],
    own: Float[np.ndarray, "draws q q"],
    value: float,
) -> float:
    """Factor by which the error grows without a record; infinite where the others do not determine it.

    Of a discrimination, the share of the criterion that would be lost.
    """
    if isinstance(search.criterion, Discrimination):
        return 1.0 - float(search.criterion(search.base + together - own)) / value if value else 0.0
    without = search.prior + together - own
    if any(unseen_combinations(each, [""] * each.shape[0]) for each in without):
        return float("inf")
    return float(np.exp(search.criterion(without) - value))
