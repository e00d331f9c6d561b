"""Compares models on the same records: fits each, holds parts out, and finds the simplest one that predicts as well.

Fits run side by side in processes of their own, or wherever an executor says.  A model begins where its neighbour, a
simpler one that shares parameters with it, ended; so the result is the same however many fits run at a time.
"""

import contextlib
import dataclasses
import functools
import multiprocessing
import os
import signal
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ProcessPoolExecutor, wait
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from ..core import (
    InputError,
    InputWarning,
    check_executor,
    check_kind,
    clear_bar,
    prepare_jax,
    require_float64,
    told_in_notebook,
)
from ..inference import Progress, effort_of, fingerprint, identify
from ..study import Estimate, Study, cycles_a_second
from .candidates import Candidate, candidates_of, neighbours, starting_near
from .comparison import Comparison, FittedCandidate, Misfit, RecordNoise, Result
from .held_out import Part, held_out, parts_of
from .scores import CommonNoise, Scores, choose, common_noise, criterion, groups_of, scores_of
from .telling_records import most_telling_record

EFFORT = "quick"
"""Of each fit, unless another is asked for: a law that is wrong is poor from every start, and would try them all."""

NO_BETTER = 1.0
"""Deviance by which a model may lie above its simpler neighbour: a fit may end a little before its optimum."""

BINS = 20
"""Parts of a cycle, or of a record, in which a misfit is looked for."""


class CandidateStore(Protocol):
    """Where fitted candidates are kept, so that a comparison that is broken off can go on."""

    def kept(self, candidate: Candidate, digest: str) -> FittedCandidate | None:
        """What was kept of a candidate with this `digest`; None where there is nothing, or something else."""
        ...

    def keep(self, candidate: Candidate, digest: str, fitted: FittedCandidate, estimate: Estimate | None) -> None:
        """Keep a candidate."""
        ...


class InMemoryStore:
    """Keeps nothing beyond the comparison."""

    def kept(self, candidate: Candidate, digest: str) -> FittedCandidate | None:
        return None

    def keep(self, candidate: Candidate, digest: str, fitted: FittedCandidate, estimate: Estimate | None) -> None:
        pass


class Task(NamedTuple):
    """What one process is asked for."""

    candidate: Candidate
    values: Mapping[str, float]
    """Of a neighbour's optimum [SI], by path; empty where there is none."""
    deviance: float
    """Of the neighbour's fit; infinite where there is none."""
    parts: tuple[Part, ...]
    effort: str


def compare_models(
    study: Study,
    *,
    friction: Iterable[str] | None = None,
    piezo: Iterable[str] | None = None,
    feedback: Iterable[bool] | None = None,
    effort: str = EFFORT,
    executor: Executor | None = None,
    store: CandidateStore | None = None,
    progress: Progress | None = None,
) -> Comparison:
    """Fit a study's records under its own model and others, and find the simplest one that predicts as well as any.

    **Arguments:** as of `pdssjax.compare`; finished candidates are kept in the `store`.

    **Raises:** `InputError` where nothing can be compared.  A model that cannot be fitted is a result that says why.
    """
    require_float64("compare")
    begun = time.perf_counter()
    check_kind("study", study, Study, "load_study")
    effort_of(effort)
    if executor is not None:
        check_kind("executor", executor, Executor)
    check_executor(executor)
    if not any(record.role == "fit" for record in study.records):
        raise InputError(f'{study.path or study.title}: found no record with role "fit", expected at least one.')
    candidates = candidates_of(study, friction, piezo, feedback)
    report, parts = progress or told_in_notebook() or _quiet, parts_of(study)
    try:
        fitted = _fit_all(candidates, parts, effort, executor, store or InMemoryStore(), report)
        report("comparing what was held out")
        found = judged(study, candidates, fitted, parts)
    finally:
        clear_bar(report)
    return dataclasses.replace(found, seconds=time.perf_counter() - begun)


def _quiet(message: str) -> None:
    """Reports no progress."""


def digest_of(candidate: Candidate, effort: str, parts: Sequence[Part]) -> str:
    """What a candidate's result depends on: model, parameters, records, what is held out, and the effort."""
    study = candidate.study
    records = [
        dataclasses.replace(record, file=type(record.file)(), columns={}, name=record.name) for record in study.records
    ]
    held = [(part.record, part.kind, part.rows.astype(float)) for part in parts]
    return fingerprint([study.models.chosen, study.parameters, records, study.accuracy, held, effort])


# ------------------------------------------------------------------------------------------------ fits


def _fit_all(
    candidates: Sequence[Candidate],
    parts: tuple[Part, ...],
    effort: str,
    executor: Executor | None,
    store: CandidateStore,
    report: Progress,
) -> dict[str, FittedCandidate]:
    """Every candidate's fit, by name, each after its neighbour's."""
    near, done = neighbours(candidates), {}
    for candidate in candidates:
        if candidate.refused:
            done[candidate.name] = _failed(candidate, candidate.refused)
        elif (kept := store.kept(candidate, digest_of(candidate, effort, parts))) is not None:
            done[candidate.name] = kept
    waiting = [candidate for candidate in candidates if candidate.name not in done]
    if not waiting:
        return done
    report(f"{len(done)} of {len(candidates)} models; fitting {', '.join(c.name for c in waiting)}")
    with _workers(executor, len(waiting)) as submit:
        running: dict[Future[_Answer], Candidate] = {}
        while waiting or running:
            for candidate in [c for c in waiting if near[c.name] is None or near[c.name] in done]:
                waiting.remove(candidate)
                task = Task(candidate, *_optimum_near(candidate, near, done), parts, effort)
                running[submit(fit_candidate, task)] = candidate
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                candidate = running.pop(future)
                fitted, estimate = _answer(future, candidate)
                done[candidate.name] = fitted
                if estimate is not None:
                    store.keep(candidate, digest_of(candidate, effort, parts), fitted, estimate)
                told = fitted.failure or ("done" if fitted.converged else "did not converge")
                report(f"{len(done)} of {len(candidates)} models; {candidate.name}: {told}, {fitted.seconds:.0f} s")
    return done


_Answer = tuple[FittedCandidate, Estimate | None]


def _optimum_near(
    candidate: Candidate, near: Mapping[str, str | None], done: Mapping[str, FittedCandidate]
) -> tuple[dict[str, float], float]:
    """Numbers and deviance of the nearest simpler candidate that has a fit; none and infinite where there is none."""
    name = near[candidate.name]
    while name is not None and done[name].failure:
        name = near.get(name)
    if name is None:
        return {}, np.inf
    return {path: done[name].values[path] for path in done[name].free}, done[name].deviance


def _answer(future: Future[_Answer], candidate: Candidate) -> _Answer:
    """What a process found; a process that died is a failure of its candidate alone."""
    try:
        return future.result()
    except BrokenExecutor as error:
        return _failed(candidate, f"the process that fitted it ended ({error or type(error).__name__})"), None
    except Exception as error:  # whatever a worker could not send back stops no other candidate
        return _failed(candidate, f"{type(error).__name__}: {error}"), None


@contextlib.contextmanager
def _workers(executor: Executor | None, most: int) -> Iterator[Callable[..., Future[_Answer]]]:
    """What submits work: to the `executor` that is given, else to processes that are spawned, one a core.

    Where it is left early, processes of its own are ended; those of the caller only lose what has not begun.
    """
    if executor is not None:
        futures: list[Future[_Answer]] = []

        def submit(work: Callable[..., _Answer], task: Task) -> Future[_Answer]:
            futures.append(executor.submit(work, task))
            return futures[-1]

        try:
            yield submit
        finally:
            for future in futures:
                future.cancel()
        return
    count = min(os.cpu_count() or 1, most)
    pools: list[ProcessPoolExecutor] = []

    def submit_here(work: Callable[..., _Answer], task: Task) -> Future[_Answer]:
        try:
            return pools[-1].submit(work, task)
        except (BrokenExecutor, IndexError):  # none yet, or one whose process died: the others go on in a new one
            context = multiprocessing.get_context("spawn")
            pools.append(ProcessPoolExecutor(count, mp_context=context, initializer=_begin_process))
            return pools[-1].submit(work, task)

    try:
        yield submit_here
    except BaseException:
        for pool in pools:
            for process in list((getattr(pool, "_processes", None) or {}).values()):
                process.terminate()
        raise
    finally:
        for pool in pools:
            pool.shutdown(wait=False, cancel_futures=True)


def _begin_process() -> None:
    """A process of its own is the parent's to end, and computes in double precision."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    prepare_jax(dedicated=True)


def fit_candidate(task: Task) -> _Answer:
    """Fit a candidate from its neighbour's optimum, if need be from the study's starts, too; hold parts out."""
    candidate, begun = task.candidate, time.perf_counter()
    try:
        require_float64("compare")
    except InputError:
        prepare_jax()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            estimate, start = _best_estimate(task)
            if not np.isfinite(estimate.statistics.chi2):
                return _failed(candidate, f"the fit has no end: {estimate.message}"), estimate
            parts = held_out(candidate.study, estimate, task.parts)
    except InputError as error:
        return _failed(candidate, str(error)), None
    except (ArithmeticError, RuntimeError, ValueError, np.linalg.LinAlgError) as error:
        return _failed(candidate, f"{type(error).__name__}: {error}"), None
    fitted = _fitted(candidate, estimate, start)
    if not all(np.isfinite(residual).all() for residual in (*fitted.residuals, *parts.residuals)):
        return _failed(candidate, "it cannot be simulated at the parameters that some of the samples give"), estimate
    seconds = time.perf_counter() - begun
    return dataclasses.replace(fitted, held_out=parts.residuals, refitted=parts.refitted, seconds=seconds), estimate


def _best_estimate(task: Task) -> tuple[Estimate, str]:
    """The fit from the neighbour's optimum, or a better one from the study's own starts.

    A poor fit is compared with other starts within `identify`.  From the study's own it is repeated where it did not
    converge, or explains less than the simpler neighbour: then it ended in a wrong optimum.
    """
    own = task.candidate.study
    fit = functools.partial(identify, effort=task.effort, progress=_quiet)
    near = starting_near(task.candidate, task.values) if task.values else own
    first = fit(near)
    as_good = first.converged and _deviance(first) <= task.deviance + NO_BETTER
    if not task.values or first.success or as_good:
        return first, "neighbour" if task.values else "study"
    second = fit(own)
    better = second.statistics.aic < first.statistics.aic or not np.isfinite(first.statistics.aic)
    return (second, "study") if better else (first, "neighbour")


def _deviance(estimate: Estimate) -> float:
    """Minus twice the logarithm of the likelihood that the fit maximised."""
    return estimate.statistics.aic - 2.0 * estimate.statistics.free


def _fitted(candidate: Candidate, estimate: Estimate, start: str) -> FittedCandidate:
    return FittedCandidate(
        name=candidate.name,
        model=candidate.study.models.chosen,
        free=candidate.free,
        converged=estimate.converged,
        explained=estimate.explained,
        message=estimate.message,
        values={path: parameter.value for path, parameter in estimate.parameters.items()},
        units={path: parameter.unit for path, parameter in estimate.parameters.items()},
        errors={path: estimate.parameters[path].standard_error for path in estimate.names},
        deviance=_deviance(estimate),
        residuals=tuple(record.residual for record in estimate.records),
        start=start,
    )


def _failed(candidate: Candidate, why: str) -> FittedCandidate:
    return FittedCandidate(candidate.name, candidate.study.models.chosen, candidate.free, failure=why)


# ------------------------------------------------------------------------------------------------ verdicts


def judged(
    study: Study, candidates: Sequence[Candidate], fitted: Mapping[str, FittedCandidate], parts: Sequence[Part]
) -> Comparison:
    """What fits and held-out parts amount to."""
    order = [candidate.name for candidate in candidates]
    good = [name for name in order if not fitted[name].failure]
    if not good:
        results = tuple(Result(fitted[name]) for name in order)
        return Comparison(study.title, results, "", "", (), {}, 0, 0, study.records)
    noises = _noises(study, [fitted[name] for name in good])
    scores = scores_of(study.records, noises, parts, {name: fitted[name].held_out for name in good})
    chosen, best = choose(good, scores)
    groups = groups_of(good, chosen, best, scores)
    results = _results(study, order, fitted, noises, scores, best, groups)
    noise = {
        record.name: RecordNoise(found.deviation, found.is_told, found.correlation_time, found.independent)
        for record, found in zip(study.records, noises, strict=True)
    }
    telling = None
    if alike := [name for name in groups[0] if name != chosen]:
        other = best if best != chosen else max(alike, key=scores.total)
        by_name = {candidate.name: candidate.study for candidate in candidates}
        telling = most_telling_record((by_name[chosen], fitted[chosen]), (by_name[other], fitted[other]), noises)
    return Comparison(
        title=study.title,
        results=results,
        chosen=chosen,
        best=best,
        groups=tuple(map(tuple, groups)),
        noise=noise,
        blocks=sum(part.kind == "time" for part in scores.parts),
        whole_records=sum(part.kind != "time" for part in scores.parts),
        records=study.records,
        telling=telling,
    )


def _noises(study: Study, fitted: Sequence[FittedCandidate]) -> list[CommonNoise]:
    """The noise of every record by the residuals of the candidate that fits best; the simplest of equal ones."""
    best = min(fitted, key=lambda candidate: _misfit_of(study, candidate))
    samples = sum(record.time.size for record in study.records if record.role == "fit")
    out = []
    for record, residual in zip(study.records, best.residuals, strict=True):
        share = len(best.free) * record.time.size / samples if record.role == "fit" else 0.0
        freedom = max(record.time.size - share - (record.offset is None), 1.0)
        out.append(common_noise(record, record.measured - residual, freedom))
    return out


def _misfit_of(study: Study, candidate: FittedCandidate) -> float:
    """Minus twice the log-likelihood of the fitted records: chi-square where the noise is told, else n log of it."""
    total = 0.0
    for record, residual in zip(study.records, candidate.residuals, strict=True):
        if record.role == "fit":
            squares = float(np.sum(residual**2))
            n = residual.size
            total += squares / record.noise**2 if record.noise else n * np.log(max(squares / n, 1e-300))
    return total


def _results(
    study: Study,
    order: Sequence[str],
    fitted: Mapping[str, FittedCandidate],
    noises: Sequence[CommonNoise],
    scores: Scores,
    best: str,
    groups: Sequence[Sequence[str]],
) -> tuple[Result, ...]:
    """Every candidate beside the best one."""
    time_scores, record_scores = scores.only("time", "validation"), scores.only("record", "validation")
    used = [place for place, record in enumerate(study.records) if record.role == "fit"]
    records = [study.records[place] for place in used]
    criteria = {
        name: criterion(
            records,
            [noises[place] for place in used],
            [fitted[name].residuals[place] for place in used],
            len(fitted[name].free),
        )
        for name in order
        if not fitted[name].failure
    }
    out = []
    for name in order:
        if fitted[name].failure:
            out.append(Result(fitted[name]))
            continue
        out.append(
            Result(
                fitted[name],
                time_scores.difference(best, name),
                record_scores.difference(best, name) if record_scores.parts else None,
                criteria[name] - min(criteria.values()),
                next(number for number, group in enumerate(groups) if name in group),
                None if name == best else misfit_beside(study, fitted[name], fitted[best], noises),
            )
        )
    return tuple(out)


def misfit_beside(
    study: Study, model: FittedCandidate, best: FittedCandidate, noises: Sequence[CommonNoise]
) -> Misfit | None:
    """Where a `model` leaves more than the `best` one: the record, and the window of its cycle or time.

    None where it leaves no more anywhere.
    """
    excesses = []
    for noise, mine, theirs in zip(noises, model.residuals, best.residuals, strict=True):
        excess = np.where(noise.used, mine**2 - theirs**2, 0.0) / noise.deviation**2
        excesses.append(excess)
    totals = [float(np.sum(excess)) for excess in excesses]
    place, total = int(np.argmax(totals)), sum(max(value, 0.0) for value in totals)
    if not totals[place] > 0.0:
        return None
    record, frequency = study.records[place], cycles_a_second(study.records[place])
    repeats = frequency is not None and np.ptp(record.time) * frequency >= 1.0
    span = float(np.ptp(record.time)) or 1.0
    where = np.mod(record.time * (frequency or 1.0), 1.0) if repeats else (record.time - record.time[0]) / span
    sums = np.bincount(np.minimum((where * BINS).astype(int), BINS - 1), excesses[place], BINS)
    begin, length = _shortest_half(sums, repeats)
    inside = [(begin + k) % BINS for k in range(length)]
    share = float(sums[inside].sum()) / total
    ends = begin / BINS, (begin + length) % BINS / BINS or 1.0
    if not repeats:
        ends = tuple(record.time[0] + span * end for end in ends)
    rms = lambda residual: float(np.sqrt(np.mean(residual[noises[place].used] ** 2)))
    of_model, of_best = rms(model.residuals[place]), rms(best.residuals[place])
    return Misfit(record.name, share, float(ends[0]), float(ends[1]), bool(repeats), of_model, of_best)


def _shortest_half(sums: Float[np.ndarray, " bins"], repeats: bool) -> tuple[int, int]:
    """First bin and number of bins of the shortest window that holds half of the sum; it may pass the end of a
    cycle."""
    half = 0.5 * float(np.sum(sums))
    for length in range(1, BINS + 1):
        begins = range(BINS if repeats else BINS + 1 - length)
        held = [float(sum(sums[(begin + k) % BINS] for k in range(length))) for begin in begins]
        if max(held) >= half:
            return int(np.argmax(held)), length
    return 0, BINS
