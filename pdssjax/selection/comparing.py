"""Compare models on the same records: the simplest one that predicts what no fit has seen as well as any.

Where several models are left, one more record would tell them apart: the one in which their predictions differ most
beside the noise.  Records like those of the study are simulated by both models on a small grid of voltage and
frequency, with samples spread evenly or gathered behind the beginning of each cycle, where the contact slips; a
prescribed motion is made slower and faster.
"""

import dataclasses
import itertools
import time
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ..core import InputError, check_executor, check_kind, clear_bar, member_name, notebook_progress, require_float64
from ..inference import Progress, effort_of, quiet
from ..study import Record, Study, cycles_a_second
from .candidate_fits import CandidateStore, fit_all
from .candidates import Candidate, candidates_of
from .comparison import Comparison, DiscriminatingRecord, FittedCandidate, Misfit, Result
from .held_out import Part, parts_of
from .scores import CommonNoise, choose, common_noise, fitness, groups_of, scores_of

EFFORT = "quick"
"""Effort of each fit unless given: a law that is wrong is poor from every start, and would try them all."""

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
    report, parts = progress or notebook_progress() or quiet, parts_of(study)
    try:
        fitted = fit_all(candidates, parts, effort, executor, store, report)
        report("comparing what was held out")
        found = judged(study, candidates, fitted, parts)
    finally:
        clear_bar(report)
    return dataclasses.replace(found, seconds=time.perf_counter() - begun)


# ------------------------------------------------------------------------------------------------ verdicts


def judged(
    study: Study, candidates: Sequence[Candidate], fitted: Mapping[str, FittedCandidate], parts: Sequence[Part]
) -> Comparison:
    """The comparison that fits and held-out parts amount to."""
    order = [candidate.name for candidate in candidates]
    good = [name for name in order if not fitted[name].failure]
    if not good:
        results = tuple(Result(fitted[name]) for name in order)
        return Comparison(study.title, results, "", "", (), {}, 0, 0, study.records)
    noises = _noises(study, [fitted[name] for name in good])
    pick = lambda values: [value for value, r in zip(values, study.records, strict=True) if r.role == "fit"]
    known = pick(study.records), pick(noises)
    fits = {name: fitness(*known, pick(fitted[name].residuals), len(fitted[name].free)) for name in good}
    scores = scores_of(study.records, noises, parts, {name: fitted[name].held_out for name in good}, fits)
    chosen, best = choose(good, scores)
    groups = groups_of(good, chosen, best, scores)
    time_scores, record_scores = scores.only("time", "validation"), scores.only("record", "validation")
    least = min(fit.criterion for fit in scores.fits.values())

    def beside_best(name: str) -> Result:
        if fitted[name].failure:
            return Result(fitted[name])
        return Result(
            fitted[name],
            time_scores.difference(best, name),
            record_scores.difference(best, name) if record_scores.parts else None,
            scores.fits[name].criterion - least,
            next(number for number, group in enumerate(groups) if name in group),
            None if name == best else misfit_beside(study, fitted[name], fitted[best], noises),
        )

    telling = None
    if alike := [name for name in groups[0] if name != chosen]:
        other = best if best != chosen else max(alike, key=scores.total)
        by_name = {candidate.name: candidate.study for candidate in candidates}
        telling = most_discriminating_record((by_name[chosen], fitted[chosen]), (by_name[other], fitted[other]), noises)
    return Comparison(
        title=study.title,
        results=tuple(map(beside_best, order)),
        chosen=chosen,
        best=best,
        groups=tuple(map(tuple, groups)),
        noise={record.name: noise.size for record, noise in zip(study.records, noises, strict=True)},
        blocks=sum(part.kind == "time" for part in scores.parts),
        whole_records=sum(part.kind != "time" for part in scores.parts),
        records=study.records,
        telling=telling,
    )


def _noises(study: Study, fitted: Sequence[FittedCandidate]) -> list[CommonNoise]:
    """The noise of every record by the residuals of the candidate that fits best; the simplest of equal ones."""

    def misfit(candidate: FittedCandidate) -> float:
        """Minus twice the log-likelihood of the fitted records: chi-square if the noise is told, else n log of it."""
        total = 0.0
        for record, residual in zip(study.records, candidate.residuals, strict=True):
            if record.role == "fit":
                squares, n = float(np.sum(residual**2)), residual.size
                total += squares / record.noise**2 if record.noise else n * np.log(max(squares / n, 1e-300))
        return total

    best = min(fitted, key=misfit)
    samples = sum(record.time.size for record in study.records if record.role == "fit")
    out = []
    for record, residual in zip(study.records, best.residuals, strict=True):
        share = len(best.free) * record.time.size / samples if record.role == "fit" else 0.0
        freedom = max(record.time.size - share - (record.offset is None), 1.0)
        out.append(common_noise(record, record.measured - residual, freedom))
    return out


def misfit_beside(
    study: Study, model: FittedCandidate, best: FittedCandidate, noises: Sequence[CommonNoise]
) -> Misfit | None:
    """Where a `model` leaves more than the `best` one: the record, and the window of its cycle or time.

    None where it leaves no more anywhere.
    """
    excesses = [
        np.where(noise.used, mine**2 - theirs**2, 0.0) / noise.size.deviation**2
        for noise, mine, theirs in zip(noises, model.residuals, best.residuals, strict=True)
    ]
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


# ------------------------------------------------------------------------------------------------ another record


VOLTAGES = (0.5, 0.75, 1.0)
"""Parts of the template's voltage: what drove the rig once does not harm it."""

FREQUENCIES = (0.25, 1.0, 4.0)
"""Times the template's frequency."""

WINDOWS = (1.0, 0.1)
"""Parts of each cycle in which the samples lie."""

SPEEDS = (0.1, 1.0, 10.0)
"""Times the speed of a prescribed motion."""

CYCLES = 4
"""Cycles of each record that is tried."""

SAMPLES = 800
"""Samples of each record that is tried."""


class _Trial(NamedTuple):
    """A record that could be made, like a `template` of the study."""

    record: Record
    noise: CommonNoise
    template: Record
    window: float
    speed: float


def most_discriminating_record(
    first: tuple[Study, FittedCandidate],
    second: tuple[Study, FittedCandidate],
    noises: Sequence[CommonNoise],
) -> DiscriminatingRecord | None:
    """The record that best tells two models apart; None where none can be made up, or both predict the same.

    **Arguments:** each model's study and fit; the noise of each record.
    """
    trials = _trials(first[0].records, noises)
    if not trials:
        return None
    motions = [_predicted(study, fitted, [trial.record for trial in trials]) for study, fitted in (first, second)]
    sizes = [_distance_in_sigmas(trial, a - b) for trial, a, b in zip(trials, *motions, strict=True)]
    place = int(np.argmax(sizes))
    if not sizes[place] > 0.0:
        return None
    found, drive = trials[place], trials[place].record.drive
    return DiscriminatingRecord(
        models=(first[1].name, second[1].name),
        template=found.template.name,
        measures=found.template.measures,
        voltage=float("nan") if drive is None else float(drive.peak()),
        frequency=cycles_a_second(found.record) or float("nan"),
        window=found.window,
        speed=found.speed,
        samples=found.record.time.size,
        sigmas=float(sizes[place]),
        tried=len(trials),
    )


def _trials(records: Sequence[Record], noises: Sequence[CommonNoise]) -> list[_Trial]:
    """Records to try: like the first one of each kind of measurement and drive."""
    kinds: dict[tuple[str, str], tuple[Record, CommonNoise]] = {}
    for record, noise in zip(records, noises, strict=True):
        waveform = "" if record.drive is None else member_name(type(record.drive))
        kinds.setdefault((record.measures, waveform), (record, noise))
    out = []
    for record, noise in kinds.values():
        if record.drive is not None:
            out += _drive_trials(record, noise)
        elif record.motion is not None and record.measurement.prescribed != "velocity":
            since = record.time - record.time[0]
            faster = [(dataclasses.replace(record, time=record.time[0] + since / speed), speed) for speed in SPEEDS]
            out += [_Trial(made, noise, record, 1.0, speed) for made, speed in faster]
    return out


def _drive_trials(record: Record, noise: CommonNoise) -> list[_Trial]:
    """A drive that repeats, at other voltages and frequencies; none where it has no such numbers."""
    drive, frequency = record.drive, cycles_a_second(record)
    if drive is None or frequency is None or not {"voltage", "frequency"} <= set(drive.numbers()):
        return []
    out, numbers = [], drive.numbers()
    cycle, within = np.divmod(np.arange(SAMPLES), SAMPLES // CYCLES)
    for part, times, window in itertools.product(VOLTAGES, FREQUENCIES, WINDOWS):
        changed = {"voltage": part * float(numbers["voltage"]), "frequency": times * float(numbers["frequency"])}
        made = drive.with_numbers(changed)
        if not made.broken_conditions():
            trial = dataclasses.replace(
                record,
                drive=made,
                overrides=record.overrides | {"voltage", "frequency"},
                time=(cycle + window * within * CYCLES / SAMPLES) / (times * frequency),
                measured=np.zeros(SAMPLES),
            )
            out.append(_Trial(trial, noise, record, window, 1.0))
    return out


def _predicted(study: Study, fitted: FittedCandidate, records: Sequence[Record]) -> list[Float[np.ndarray, " samples"]]:
    known = {path: number for path, number in fitted.values.items() if path in study.parameters}
    posed = dataclasses.replace(study, records=tuple(records)).with_values(known, of_estimate=True)
    return [np.asarray(motion) for motion in posed.predict()]


def _distance_in_sigmas(trial: _Trial, apart: Float[np.ndarray, " samples"]) -> float:
    """How far two predictions are `apart`, in standard deviations of the noise; 0 where one of them failed."""
    if not np.isfinite(apart).all():
        return 0.0
    if trial.record.offset is None:
        apart = apart - np.mean(apart)
    interval = float(np.median(np.diff(trial.record.time)))
    share = 1.0 / (1.0 + 2.0 * trial.noise.size.correlation_time / interval)
    return float(np.sqrt(share * np.sum(apart**2))) / trial.noise.size.deviation
