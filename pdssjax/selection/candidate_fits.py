"""Fits candidates to a study's records, side by side in processes of their own, or wherever an executor says.

So that a wrong model costs little, and a right one is not lost in a wrong optimum:

0. The study's own model is fitted.  Where it explains the records the others begin at its optimum, and a fit that
   leaves much more is soon broken off.
1. Else each is fitted once from where its neighbour ended, a simpler model that shares parameters with it, after all
   that have fewer parameters; where one of those explains the records it takes the place of the study's own.
2. Where none explains the records, those that explain most are compared with fits from other starts, until that helps
   no more.
3. Each that explains less than the best is fitted again from the best one's optimum.  Then parts are held out.

So the result is the same however many fits run at a time.
"""

import dataclasses
import functools
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from typing import NamedTuple, Protocol

import numpy as np

from ..core import InputError, InputWarning
from ..inference import Progress, effort_of, fingerprint, identify, quiet
from ..study import Estimate, Study
from .candidates import Candidate, neighbours, starting_near
from .comparison import FittedCandidate
from .held_out import Part, held_out
from .worker_processes import gathered, workers

NO_BETTER = 1.0
"""Deviance by which a model may lie above a simpler one: a fit may end a little before its optimum."""

STUDY = "study"
"""The name of the study's own starts, from which a fit began."""

EARLY = 4
"""Linearisations after which a fit from the best model's optimum is broken off that leaves much more: a simpler law
that is right has found its place by then, and a contact that rings takes half a minute for each."""

FIRST = 30
"""Linearisations of a model's first fit: one that is right has converged by then, and one that is wrong creeps on."""

COMPARED_AT_ONCE = 2
"""Models that are compared with other starts side by side, whatever the number of cores."""

IN_VAIN = 2
"""Comparisons with other starts in a row that may not lower the deviance of the best: then no model is right."""

HOPELESS = 0.5
"""Deviance a sample by which a model may leave more than the best one and still be fitted to its end, and without each
part: half as much variance again, which shows also where a record of thousands of samples has a hundred independent
ones."""


class CandidateStore(Protocol):
    """Keeps fitted candidates, so that a comparison that is broken off can go on."""

    def kept(self, candidate: Candidate, digest: str) -> FittedCandidate | None:
        """The fit kept of a candidate with this `digest`; None where there is none, or another one."""
        ...

    def keep(self, candidate: Candidate, digest: str, fitted: FittedCandidate, estimate: Estimate | None) -> None:
        """Keep a candidate; without an `estimate` that which was kept before stays."""
        ...


class Task(NamedTuple):
    """The work of one process on one candidate."""

    candidate: Candidate
    effort: str
    near: FittedCandidate | None = None
    """The model at whose optimum a fit begins; None: where the study says, or a search finds."""
    earlier: FittedCandidate | None = None
    """The candidate as it was fitted before; None at first."""
    parts: tuple[Part, ...] = ()
    """Parts to hold out in the end."""
    best: float = np.inf
    """AIC of the best model; infinite where none is known that is right."""

    @property
    def most(self) -> float:
        """AIC up to which a model may still turn out to be as good."""
        samples = sum(record.time.size for record in self.candidate.study.records if record.role == "fit")
        return self.best + HOPELESS * samples


Answer = tuple[FittedCandidate, Estimate | None]


def digest_of(candidate: Candidate, effort: str, parts: Sequence[Part]) -> str:
    """A digest of what a candidate's result depends on: model, parameters, records, parts held out, and effort."""
    study = candidate.study
    records = [
        dataclasses.replace(record, file=type(record.file)(), columns={}, name=record.name) for record in study.records
    ]
    held = [(part.record, part.kind, part.rows.astype(float)) for part in parts]
    return fingerprint(
        [study.models.chosen, study.parameters, study.constraints, records, study.accuracy, held, effort]
    )


def fit_all(
    candidates: Sequence[Candidate],
    parts: tuple[Part, ...],
    effort: str,
    executor: Executor | None,
    store: CandidateStore | None,
    report: Progress,
) -> dict[str, FittedCandidate]:
    """Every candidate's fit and what it predicts of the `parts` without having seen them, by name."""
    done: dict[str, FittedCandidate] = {}
    digests = {candidate.name: digest_of(candidate, effort, parts) for candidate in candidates}
    for candidate in candidates:
        if candidate.refused:
            done[candidate.name] = failed(candidate, candidate.refused)
        elif store is not None and (kept := store.kept(candidate, digests[candidate.name])) is not None:
            done[candidate.name] = kept

    def open_ones() -> list[Candidate]:
        return [c for c in candidates if not (c.name in done and (done[c.name].failure or done[c.name].finished))]

    def keep(candidate: Candidate, answer: Answer) -> None:
        fitted, estimate = answer
        done[candidate.name] = fitted
        if store is not None and (estimate is not None or fitted.finished):
            store.keep(candidate, digests[candidate.name], fitted, estimate)
        ended = len(candidates) - len(open_ones())
        count, what = (ended, "done") if fitted.finished else (len(done), "fitted")
        # A first fit is broken off early, so that only a finished one is said not to have converged.
        outcome = fitted.failure or (f"{what}, did not converge" if fitted.finished and not fitted.converged else what)
        report(f"{count} of {len(candidates)} models {what}; {candidate.name}: {outcome}, {fitted.seconds:.0f} s")

    if not open_ones():
        return done
    report(f"{len(done)} of {len(candidates)} models fitted; next {', '.join(c.name for c in open_ones())}")
    own = [c for c in candidates if c.is_own]
    near = neighbours(candidates) | dict.fromkeys(c.name for c in own)

    def lost(candidate: Candidate, why: str) -> Answer:
        return failed(candidate, why), None

    with workers(executor, len(open_ones())) as submit:
        run = functools.partial(gathered, submit, keep, lost)

        def from_right_or_neighbour(candidate: Candidate) -> Task | None:
            before = own if own_is_right else [*own, *(c for c in candidates if len(c.free) < len(candidate.free))]
            if any(c.name not in done for c in before):
                return None
            if right := [done[c.name] for c in before if done[c.name].explained]:
                best = min(right, key=lambda fitted: fitted.aic)
                return Task(candidate, effort, best, best=best.aic)
            if (neighbour := near[candidate.name]) is not None and neighbour not in done:
                return None
            while neighbour is not None and not done[neighbour].has_optimum:
                neighbour = near.get(neighbour)
            return Task(candidate, effort, None if neighbour is None else done[neighbour])

        run(fit_candidate, [c for c in own if c.name not in done], lambda c: Task(c, effort))
        own_is_right = any(done[c.name].explained for c in own)
        # What has most parameters takes longest: where nothing waits for anything it begins first.
        others = [c for c in candidates if c.name not in done]
        run(fit_candidate, others[::-1] if own_is_right else others, from_right_or_neighbour)
        for some in _to_compare(open_ones, done):
            run(compare_starts, some, lambda candidate: Task(candidate, effort, earlier=done[candidate.name]))
        best = _best(done)
        least = np.inf if best is None else best.aic

        def to_finish(candidate: Candidate) -> Task:
            fitted, near = done[candidate.name], best
            # Nothing is to be tried where it is the best itself, ended well, or has begun there already.
            if (
                best is None
                or best.name == fitted.name
                or (fitted.explained and fitted.converged)
                or (fitted.start == best.name and not best.compared)
            ):
                near = None
            return Task(candidate, effort, near, fitted, parts, least)

        run(finish, open_ones(), to_finish)
    return done


def _to_compare(
    open_ones: Callable[[], list[Candidate]], done: Mapping[str, FittedCandidate]
) -> Iterator[list[Candidate]]:
    """Models to be compared with other starts, those that explain most first, as long as none explains the records."""
    in_vain = 0
    while (best := _best(done)) is not None and not best.explained and in_vain < IN_VAIN:
        left = [c for c in open_ones() if not done[c.name].compared]
        some = sorted(left, key=lambda c: done[c.name].aic)[:COMPARED_AT_ONCE]
        if not some:
            return
        yield some
        better = _best(done)
        in_vain = 0 if better is not None and better.aic < best.aic - NO_BETTER else in_vain + 1


def _best(done: Mapping[str, FittedCandidate]) -> FittedCandidate | None:
    """The model that explains most for its parameters; None where there is no fit."""
    best = min(done.values(), key=lambda fitted: fitted.aic)
    return best if best.has_optimum else None


def _timed(work: Callable[[Task], Answer]) -> Callable[[Task], Answer]:
    """`work` whose time is added to what the candidate took before, and whose errors are the candidate's failure."""

    @functools.wraps(work)
    def timed(task: Task) -> Answer:
        begun, before = time.perf_counter(), task.earlier.seconds if task.earlier else 0.0
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", InputWarning)
                fitted, estimate = work(task)
        except InputError as error:
            fitted, estimate = failed(task.candidate, str(error)), None
        except (ArithmeticError, RuntimeError, ValueError, np.linalg.LinAlgError) as error:
            fitted, estimate = failed(task.candidate, f"{type(error).__name__}: {error}"), None
        return dataclasses.replace(fitted, seconds=before + time.perf_counter() - begun), estimate

    return timed


# ------------------------------------------------------------------------------------------------ fits


@_timed
def fit_candidate(task: Task) -> Answer:
    """Fit a candidate once from the optimum it is to begin at, from the study's own starts where there is none.

    Where it explains less than the neighbour that it began at, it ended in a wrong optimum, and is fitted from the
    study's starts, too.
    """
    own, near = task.candidate.study, task.near
    if near is None:
        return _fit_while_close(task, own, STUDY)
    first = _fit_while_close(task, starting_near(task.candidate, near.optimum), near.name)
    if first[0].deviance <= near.deviance + NO_BETTER or np.isfinite(task.best):
        return first
    return _lower_deviance(first, _fit_once(task, own, STUDY, FIRST))


@_timed
def compare_starts(task: Task) -> Answer:
    """Fit a candidate from the study's own starts, compared with other starts where that is poor."""
    estimate = identify(task.candidate.study, effort=task.effort, progress=quiet)
    assert task.earlier is not None
    found = _lower_deviance((task.earlier, None), _answer_of(task, estimate, STUDY))
    return dataclasses.replace(found[0], compared=True), found[1]


@_timed
def finish(task: Task) -> Answer:
    """Try another fit of a candidate from the best model's optimum if asked to, and hold parts out.

    One that explains nearly as much as the best is brought to its end first; one that leaves much more is taken for
    what it leaves of the parts in its fit, which is to its advantage.
    """
    assert task.earlier is not None
    found: Answer = task.earlier, None
    if task.near is not None:
        begun = dataclasses.replace(task.candidate, study=_starting_where_it_ended(task.candidate, found[0]))
        near = starting_near(begun, task.near.optimum)
        found = _lower_deviance(found, _fit_while_close(task, near, task.near.name))
    is_close = found[0].aic <= task.most
    if is_close and not found[0].converged:
        reached = _starting_where_it_ended(task.candidate, found[0])
        found = _lower_deviance(found, _fit_once(task, reached, found[0].start))
    fitted, estimate = found
    if not fitted.has_optimum:
        return failed(task.candidate, f"the fit has no end: {fitted.message}"), estimate
    if is_close:
        predicted, refitted = held_out(task.candidate.study, fitted, task.parts)
    else:
        predicted, refitted = tuple(fitted.residuals[part.record][part.rows] for part in task.parts), 0
    finite = lambda residual: bool(np.isfinite(residual).all())
    pairs = zip(task.candidate.study.records, fitted.residuals, strict=True)
    if lost := [record.name for record, residual in pairs if not finite(residual)]:
        return failed(task.candidate, f'where its fit ended it cannot simulate the record "{lost[0]}"'), estimate
    if not all(map(finite, predicted)):
        why = "it cannot be simulated at the parameters that it has without some of the samples"
        return failed(task.candidate, why), estimate
    whole = dataclasses.replace(fitted, held_out=predicted, refitted=refitted, finished=True)
    return whole, estimate


def _starting_where_it_ended(candidate: Candidate, fitted: FittedCandidate) -> Study:
    """The candidate's study with the optimum of a fit of it as starts; as it is where that fit has no end."""
    return starting_near(candidate, fitted.optimum) if fitted.has_optimum else candidate.study


def _fit_while_close(task: Task, study: Study, start: str) -> Answer:
    """The first fit of a `study`, broken off where it leaves much more than the best model."""
    if not np.isfinite(task.best):
        return _fit_once(task, study, start, FIRST)
    first = _fit_once(task, study, start, EARLY)
    if first[0].converged or first[0].aic > task.most:
        return first
    reached = _starting_where_it_ended(task.candidate, first[0])
    return _lower_deviance(first, _fit_once(task, reached, start, FIRST - EARLY))


def _fit_once(task: Task, study: Study, start: str, most: int | None = None) -> Answer:
    """The fit of a `study`, not compared with other starts, of so many linearisations at `most`."""
    alone = effort_of(task.effort)._replace(compares=False)
    if start == STUDY:  # where much is to be searched for, and a miss costs most
        alone = alone._replace(starts=max(1.0, alone.starts))
    if most is not None:
        alone = alone._replace(iterations=min(most, alone.iterations))
    return _answer_of(task, identify(study, effort=alone, progress=quiet), start)


def _answer_of(task: Task, estimate: Estimate, start: str) -> Answer:
    return fitted_candidate(task.candidate, estimate, start), estimate


def _lower_deviance(one: Answer, other: Answer) -> Answer:
    """The fit of the lower deviance, the first where they are equal."""
    return other if other[0].aic < one[0].aic - 1e-3 * NO_BETTER else one


def fitted_candidate(candidate: Candidate, estimate: Estimate, start: str) -> FittedCandidate:
    """The values of a candidate's `estimate` that a comparison needs; it began at `start`."""
    statistics = estimate.statistics
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
        at_bound=tuple(path for path in estimate.names if estimate.parameters[path].at_bound),
        noise={record.name: record.noise for record in estimate.records},
        deviance=statistics.aic - 2.0 * statistics.free,
        residuals=tuple(record.residual for record in estimate.records),
        start=start,
    )


def failed(candidate: Candidate, why: str) -> FittedCandidate:
    """A candidate without a fit that can be compared."""
    return FittedCandidate(candidate.name, candidate.study.models.chosen, candidate.free, failure=why)
