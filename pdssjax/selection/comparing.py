"""Compares models on the same records: the simplest one that predicts what no fit has seen as well as any."""

import dataclasses
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor

import numpy as np
from jaxtyping import Float

from ..core import InputError, check_executor, check_kind, clear_bar, require_float64, told_in_notebook
from ..inference import Progress, effort_of, quiet
from ..study import Study, cycles_a_second
from .candidate_fits import CandidateStore, InMemoryStore, fit_all
from .candidates import Candidate, candidates_of
from .comparison import Comparison, FittedCandidate, Misfit, RecordNoise, Result
from .held_out import Part, parts_of
from .scores import CommonNoise, Fitness, Scores, choose, common_noise, fitness, groups_of, scores_of
from .telling_records import most_telling_record

EFFORT = "quick"
"""Of each fit, unless another is asked for: a law that is wrong is poor from every start, and would try them all."""

BINS = 20
"""Parts of a cycle, or of a record, in which a misfit is looked for."""


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
    report, parts = progress or told_in_notebook() or quiet, parts_of(study)
    try:
        fitted = fit_all(candidates, parts, effort, executor, store or InMemoryStore(), report)
        report("comparing what was held out")
        found = judged(study, candidates, fitted, parts)
    finally:
        clear_bar(report)
    return dataclasses.replace(found, seconds=time.perf_counter() - begun)


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
    fits = _fits(study, fitted, good, noises)
    scores = scores_of(study.records, noises, parts, {name: fitted[name].held_out for name in good}, fits)
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


def _fits(
    study: Study, fitted: Mapping[str, FittedCandidate], names: Sequence[str], noises: Sequence[CommonNoise]
) -> dict[str, Fitness]:
    """How well each model explains the records that are fitted."""
    used = [place for place, record in enumerate(study.records) if record.role == "fit"]
    records, noise = [study.records[place] for place in used], [noises[place] for place in used]
    out = {}
    for name in names:
        free, residuals = len(fitted[name].free), [fitted[name].residuals[place] for place in used]
        out[name] = fitness(records, noise, residuals, free)
    return out


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
    least = min(fit.criterion for fit in scores.fits.values())
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
                scores.fits[name].criterion - least,
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
