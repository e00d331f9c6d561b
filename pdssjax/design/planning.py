"""Which records to make next: candidates, their information, exchange, and refinement of what is continuous.

All experiments within the limits are predicted and differentiated on dense grids at a few draws of the parameters; the
information of any sampling is interpolated from these (`survey`).  The best selection (`exchange`) is refined: windows
by a local search, voltage, frequency and duty by L-BFGS-B (`refinement`).  What a plan promises is then computed at its
own samples, nothing interpolated.
"""

import dataclasses
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
from .exchange import Candidates, Search, chosen, promising
from .experiments import CompleteLimits, Experiment, Limits, Resources, completed_limits, possible_experiments
from .information import check_seen, inverse_of, least_squares_errors, unseen_combinations
from .plan import Errors, Knowledge, Plan, PlannedRecord, knowledge_of, prior_information
from .refinement import Pair, Refinement, refined
from .sampling import Schedule, contact_schedules, possible_schedules
from .sensitivities import Simulation
from .survey import Point, Survey

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
    request = _Request(study, known, aim, limits, budget, count_known, draws, seed, refine, report)
    return dataclasses.replace(_planned(request), seconds=time.perf_counter() - begun)


class _Request(NamedTuple):
    """The arguments of `design_experiment`, complete and checked."""

    study: Study
    knowledge: Knowledge
    aim: Aim
    limits: CompleteLimits
    budget: Resources
    count_known: bool
    draws: int
    seed: int
    refine: bool
    report: Callable[[str], None]

    @property
    def where(self) -> str:
        """Beginning of messages."""
        return f"{self.study.path or self.study.title}: design"


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
    needs = {"parameter": aim.parameters, "prediction": aim.speed_at, "discrimination": aim.rival}
    if not needs.get(aim.criterion, True):
        expected = {"parameter": "paths of parameters", "prediction": "speed_at", "discrimination": "a rival study"}
        raise InputError(f'criterion: found "{aim.criterion}" alone, expected {expected[aim.criterion]} with it.')
    return aim


def _check_budget(study: Study, budget: Resources, limits: CompleteLimits) -> None:
    where = f"{study.path or study.title}: design: budget"
    if budget.records < 1 or budget.samples < 8 * budget.records:
        raise InputError(
            f"{where}: found {budget.samples} samples for {budget.records} records, expected at least one record and "
            "8 samples for each."
        )
    if not (budget.seconds > 0 and budget.cost >= limits.record_cost):
        raise InputError(f"{where}: found {budget.seconds:g} s and a cost of {budget.cost:g}, which pay no record.")


def _planned(request: _Request) -> Plan:
    experiments = possible_experiments(request.study, request.limits)
    if not experiments:
        raise InputError(f"{request.where}: found no experiment within the limits, expected wider ones.")
    walk = [_walk(request)] if request.aim.speed_at is not None else []
    survey = Survey(request.study, request.aim.rival, request.limits, [*experiments, *walk])
    points = _points(request, survey)
    survey.simulate(experiments, {0: points[0]}, _counted(request.report, "simulating and differentiating"))
    usable = [e for e in experiments if survey.is_simulated(e) and _in_range(survey, e, points[0])]
    if not usable:
        raise InputError(f"{request.where}: found no experiment that can be simulated, expected numbers that work.")
    request.report("computing what each sampling tells")
    pairs = [(e, s) for e in usable for s in _schedules(request, e)]
    takes = np.array([_takes(request, *pair) for pair in pairs])
    pairs = [pair for pair, take in zip(pairs, takes, strict=True) if np.all(take <= request.budget.amounts)]
    if not pairs:
        raise InputError(f"{request.where}: found no record that the budget pays, expected more of it.")
    prior = _prior(request, survey)
    first = _candidates(request, survey, pairs, [0])
    notes = _check_determined(request, survey, prior + first.information.sum(axis=0)[0])
    if skipped := len(experiments) - len(usable):
        notes.append(
            f"{skipped} experiments were left out: they could not be simulated, or exceed the range of the sensor."
        )
    search = Search(_criterion(request, survey, points[:1], walk), prior[None], request.budget.amounts)
    request.report(f"choosing among {len(pairs)} records")
    kept = [pairs[i] for i in promising(first, search, KEPT)]
    some = list(dict.fromkeys(experiment for experiment, _ in kept))
    survey.simulate(some, dict(enumerate(points)), _counted(request.report, "simulating under other parameters"))
    search = Search(
        _criterion(request, survey, points, walk), np.repeat(prior[None], len(points), axis=0), request.budget.amounts
    )
    request.report(f"choosing among {len(kept)} records under {len(points)} sets of parameters")
    candidates = _candidates(request, survey, kept, list(range(len(points))))
    plan = [kept[i] for i in chosen(candidates, search)]
    if request.refine:
        plan = refined(Refinement(survey, search, points, lambda *pair: _takes(request, *pair), request.report), plan)
    request.report("computing what the plan promises")
    return _finished(request, survey, search, points, plan, len(pairs), notes)


def _counted(report: Callable[[str], None], what: str) -> Callable[[int, int], None]:
    """Progress of a count as lines of text."""
    return lambda done, count: report(f"{what}: {done} of {count}")


def _in_range(survey: Survey, experiment: Experiment, point: Point) -> bool:
    """Whether the sensor can see all of an experiment's motion; of a walk, of the cycles that are simulated."""
    most = survey.limits.range.get(experiment.kind)
    return most is None or survey.extent(experiment, point) <= most


def _schedules(request: _Request, experiment: Experiment) -> list[Schedule]:
    limits, budget = request.limits, request.budget
    share = budget.samples / budget.records
    if experiment.motion is not None:
        assert experiment.period is not None
        return contact_schedules(experiment.period, share, budget.samples, limits.interval, limits.duration)
    corners = experiment.corners()
    return possible_schedules(experiment.period, corners[:3], share, budget.samples, limits.interval, limits.duration)


def _takes(request: _Request, experiment: Experiment, schedule: Schedule) -> Float[np.ndarray, "4"]:
    """Amounts that a record takes of the budget: samples, records, seconds and cost."""
    seconds = max(float(schedule.times(experiment.period)[-1]), 0.0)
    cost = request.limits.record_cost + request.limits.second_cost * seconds
    return np.array([schedule.count, 1.0, seconds, cost])


def _candidates(request: _Request, survey: Survey, pairs: Sequence[Pair], numbers: list[int]) -> Candidates:
    information = np.array([survey.information(*pair, numbers) for pair in pairs])
    return Candidates(information, np.array([_takes(request, *pair) for pair in pairs]))


def _points(request: _Request, survey: Survey) -> list[Point]:
    """The parameters at which plans are judged: those known, then draws of what is not known of them."""
    transform = survey.own.problem.residual.transform
    centre = transform.encode(request.knowledge.values)
    rival = None
    if survey.rival is not None and request.aim.rival is not None:
        rival = survey.rival.problem.residual.transform.encode(request.aim.rival.values())
    spread = _spread(request, survey.own.paths)
    if request.draws == 1 or not spread.any():
        return [Point(centre, rival)]
    cube = sobol_points(max(2, request.draws), centre.size, request.seed)[: request.draws - 1]
    deviations = ndtri(np.clip(cube, 0.02, 0.98)) @ spread.T
    drawn = np.clip(centre + deviations, transform.low, transform.high)
    return [Point(centre, rival), *(Point(row, rival) for row in drawn)]


def _spread(request: _Request, paths: Sequence[str]) -> Float[np.ndarray, "p p"]:
    """A root of the covariance of what is not known, on the fit's scale.

    It is that of the estimate, or of independent errors: those measured apart, or a third of the ranges that the study
    gives.  Nothing scatters by more than `_WIDEST`.
    """
    study, known = request.study, request.knowledge
    transform = transform_of(study.parameters, known.values)
    information = prior_information(study, known, tuple(paths))
    if known.names:
        values, vectors = np.linalg.eigh(information)
        size = np.minimum(1.0 / np.sqrt(np.maximum(values, 1e-300)), _WIDEST)
        return vectors * np.where(values > 0.0, size, 0.0)
    sizes = np.zeros(len(paths))
    for i, path in enumerate(paths):
        parameter = study.parameters[path]
        if information[i, i] > 0.0:
            sizes[i] = information[i, i] ** -0.5
        elif parameter.low is not None and parameter.high is not None:
            sizes[i] = (transform.high[i] - transform.low[i]) / 6.0
    return np.diag(np.minimum(sizes, _WIDEST))


def _prior(request: _Request, survey: Survey) -> Float[np.ndarray, "q q"]:
    """The information known before, of the study and of its rival."""
    out = np.zeros((survey.size, survey.size))
    if request.count_known:
        own = len(survey.own.paths)
        out[:own, :own] = prior_information(request.study, request.knowledge, survey.own.paths)
        if survey.rival is not None and request.aim.rival is not None:
            rival = request.aim.rival_knowledge or Knowledge(dict(request.aim.rival.values()))
            paths = survey.rival.paths
            out[own : own + len(paths), own : own + len(paths)] = prior_information(request.aim.rival, rival, paths)
    return out


def _criterion(request: _Request, survey: Survey, points: Sequence[Point], walk: list[Experiment]) -> AbstractCriterion:
    aim, paths = request.aim, survey.own.paths
    if aim.criterion == "d":
        return Determinant()
    if aim.criterion == "a":
        return Trace()
    if aim.criterion == "discrimination":
        return Discrimination(len(paths))
    if aim.criterion == "parameter":
        rows = np.array([np.eye(len(paths))[paths.index(path)] for path in aim.parameters])
        named = ", ".join(aim.parameters)
        return Combinations(np.repeat(rows[None], len(points), axis=0), named)
    assert aim.speed_at is not None
    period = 1.0 / aim.speed_at[1]
    times = np.array([(_CYCLES - 1) * period, _CYCLES * period])
    responses = survey.own.responses([Simulation(walk[0], times, point.free) for point in points])
    steps = [float(np.diff(response.predicted)[0]) for response in responses]
    if not all(np.isfinite(step) and step != 0.0 for step in steps):
        raise InputError(f"{request.where}: found no speed at {aim.speed_at[0]:g} V and {aim.speed_at[1]:g} Hz.")
    rows = [np.diff(response.jacobian, axis=0) / step for response, step in zip(responses, steps, strict=True)]
    return Prediction(np.array(rows), f"the speed at {aim.speed_at[0]:g} V and {aim.speed_at[1]:g} Hz")


def _walk(request: _Request) -> Experiment:
    """The effector under the sawtooth whose speed is to be predicted."""
    assert request.aim.speed_at is not None
    voltage, frequency = request.aim.speed_at
    drives = [r.drive for r in request.study.records if r.drive is not None and r.drive.flanks() is not None]
    if not drives:
        drives = [Sawtooth()]
    drive = drives[0].with_peak_voltage().with_numbers({"voltage": voltage, "frequency": frequency})
    return Experiment("effector", drive, None, ())


def _check_determined(request: _Request, survey: Survey, whole: Float[np.ndarray, "q q"]) -> list[str]:
    """Notes on what all candidates and all that is known leave undetermined; **raises** where the aim needs it."""
    paths = survey.own.paths
    own = whole[: len(paths), : len(paths)]
    unseen = unseen_combinations(own, paths)
    if not unseen or request.aim.criterion == "discrimination":
        return []
    if request.aim.criterion in ("d", "a"):
        check_seen(unseen, request.where)
    needed = set(request.aim.parameters)
    check_seen([u for u in unseen if needed & set(u.exponents)], request.where)
    return [f"No experiment within the limits changes with {combination.words}." for combination in unseen]


def _finished(
    request: _Request,
    survey: Survey,
    search: Search,
    points: Sequence[Point],
    plan: Sequence[Pair],
    candidates: int,
    notes: list[str],
) -> Plan:
    """The plan with what it promises, at its own samples."""
    plan = sorted(plan, key=lambda pair: request.limits.kinds.index(pair[0].kind))
    plan = [(experiment.rounded(), schedule.rounded()) for experiment, schedule in plan]
    information = survey.exact_information(plan, points)
    together = information.sum(axis=0)
    value = float(search.criterion(search.prior + together))
    own = len(survey.own.paths)
    prior, mine = search.prior[0][:own, :own], together[0][:own, :own]
    study, paths = request.study, survey.own.paths
    alone = unseen_combinations(mine, paths)
    if alone:
        named = "; ".join(combination.words for combination in alone)
        notes = [*notes, f"The records of the plan alone do not tell {named}: fit them together with what is known."]
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
    errors = lambda matrix: _errors(request, paths, matrix)
    after, by_itself = errors(prior + mine), errors(mine)
    identified = _errors_of_identify(request, survey, points[0], plan, [np.zeros_like(prior), prior])
    return Plan(
        study=study,
        knowledge=request.knowledge,
        criterion=search.criterion,
        limits=request.limits,
        budget=request.budget,
        records=records,
        before=errors(prior),
        alone=by_itself,
        after=after,
        alone_identify=identified[0] or by_itself,
        after_identify=identified[1] or after,
        value=value,
        value_before=_value_before(search),
        notes=tuple(notes),
        candidates=candidates,
        draws=len(points),
        seconds=0.0,
        rival="" if request.aim.rival is None else str(request.aim.rival.models.chosen["friction"]),
    )


def _value_before(search: Search) -> float:
    if isinstance(search.criterion, Discrimination) or not np.all(np.einsum("kii->ki", search.prior) > 0):
        return float("nan")
    return float(search.criterion(search.prior))


def _contribution(
    search: Search,
    together: Float[np.ndarray, "draws q q"],
    own: Float[np.ndarray, "draws q q"],
    value: float,
) -> float:
    """Factor by which the error grows without a record; infinite where the others do not determine it."""
    if isinstance(search.criterion, Discrimination):
        return 1.0 - float(search.criterion(search.base + together - own)) / value if value else 0.0
    without = search.prior + together - own
    if any(unseen_combinations(each, [""] * each.shape[0]) for each in without):
        return float("inf")
    return float(np.exp(search.criterion(without) - value))


def _errors(request: _Request, paths: Sequence[str], information: Float[np.ndarray, "p p"]) -> Errors:
    """Standard errors [SI]; NaN of parameters that take part in a combination without information."""
    lost = {path for combination in unseen_combinations(information, paths) for path in combination.exponents}
    kept = [i for i, path in enumerate(paths) if path not in lost]
    out = dict.fromkeys(paths, float("nan"))
    if kept:
        covariance = inverse_of(information[np.ix_(kept, kept)])
        return out | _in_si(request, [paths[i] for i in kept], np.diag(covariance))
    return out


def _in_si(request: _Request, paths: Sequence[str], variances: Float[np.ndarray, " p"]) -> Errors:
    transform = transform_of(request.study.parameters, request.knowledge.values)
    slopes = transform.slope(transform.encode(request.knowledge.values))
    slope = dict(zip(transform.paths, slopes, strict=True))
    return {p: float(slope[p] * np.sqrt(max(v, 0.0))) for p, v in zip(paths, variances, strict=True)}


def _errors_of_identify(
    request: _Request,
    survey: Survey,
    point: Point,
    plan: Sequence[Pair],
    priors: Sequence[Float[np.ndarray, "p p"]],
) -> list[Errors | None]:
    """Standard errors [SI] of ordinary least squares with each of the `priors`.

    None where the noise is white, which makes them those of the plan, or where not all parameters are determined.
    """
    if not any(survey.noise(experiment.kind).correlation_time for experiment, _ in plan):
        return [None for _ in priors]
    paths = survey.own.paths
    records = [(c[:, : len(paths)], t, survey.noise(e.kind)) for e, t, c in survey.exact_columns(plan, [point])]
    information = sum(columns.T @ (columns - columns.mean(axis=0)) for columns, _, _ in records)
    errors = lambda prior: _in_si(request, paths, np.diag(least_squares_errors(records, prior)))
    return [None if unseen_combinations(prior + information, paths) else errors(prior) for prior in priors]
