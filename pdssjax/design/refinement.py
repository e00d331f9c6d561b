"""Refinement of what is continuous in a plan: windows and intervals of the samples, voltages, frequencies and duties.

The sampling of each record is improved by a local search, and blocks of samples move from the record that misses them
least to the one that gains most.  Voltages, frequencies and duties follow the gradient of the criterion within their
limits (L-BFGS-B: R. H. Byrd, P. Lu, J. Nocedal and C. Zhu, SIAM J. Scientific Computing 16(5), 1995); the gradient
takes differences of one record at a time.  The frequency of a record that goes on through many cycles stays: where its
samples lie in the cycle changes by more than the cycle with a small change of it, and the criterion has no slope there.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from .exchange import Search
from .experiments import CompleteLimits, Experiment
from .sampling import FEWEST_SAMPLES, Schedule, improved_schedule
from .survey import Point, Survey

Pair = tuple[Experiment, Schedule]
"""A record of a plan: the experiment and its sampling."""

BLOCKS = (2, 8, 32)
"""Parts of a record's samples that move to another record."""

STEP = 1e-3
"""Relative difference by which a criterion is differentiated."""

_EVALUATIONS = 8
"""Largest number of evaluations of the criterion and its gradient."""


class Refinement(NamedTuple):
    """The data of a refinement."""

    survey: Survey
    search: Search
    points: Sequence[Point]
    resources_of: Callable[[Experiment, Schedule], Float[np.ndarray, " resources"]]
    report: Callable[[str], None]

    @property
    def numbers(self) -> range:
        """Indices of the points."""
        return range(len(self.points))

    @property
    def limits(self) -> CompleteLimits:
        """Limits of rig, sensor and recorder."""
        return self.survey.limits

    def information(self, pair: Pair) -> Float[np.ndarray, "draws q q"]:
        """Fisher information of one record, interpolated."""
        return self.survey.information(*pair, self.numbers)

    def value(self, information: Float[np.ndarray, "draws q q"]) -> float:
        """The criterion of records that have this information together."""
        found = float(self.search.criterion(self.search.base + information))
        return found if np.isfinite(found) else np.inf

    def fits(self, pair: Pair, others: Sequence[Pair]) -> bool:
        """Whether the recorder can take a record, and the budget has room for it beside the others."""
        experiment, schedule = pair
        if not schedule.fits(experiment.period, self.limits.interval, self.limits.duration):
            return False
        taken = sum((self.resources_of(*other) for other in others), np.zeros_like(self.search.budget))
        return bool(np.all(taken + self.resources_of(*pair) <= self.search.budget * (1 + 1e-9)))


def refined(data: Refinement, plan: Sequence[Pair]) -> list[Pair]:
    """The plan with better windows and drives, within the same budget."""
    best = _with_blocks_moved(data, _with_better_windows(data, list(plan)))
    data.report("refining voltages and frequencies")
    moved = _with_better_drives(data, best)
    if moved != best:
        data.survey.simulate([e for e, _ in moved], dict(enumerate(data.points)), lambda done, count: None)
        moved = _with_blocks_moved(data, _with_better_windows(data, moved))
        exact = lambda pairs: data.value(data.survey.exact_information(pairs, data.points).sum(axis=0))
        best = moved if exact(moved) < exact(best) else best
    return best


def _with_better_windows(data: Refinement, plan: list[Pair]) -> list[Pair]:
    """The plan after a local search of each record's sampling, one after the other."""
    for place, (experiment, schedule) in enumerate(plan):
        if experiment.motion is not None:
            continue
        others = plan[:place] + plan[place + 1 :]
        rest = sum((data.information(other) for other in others), np.zeros_like(data.search.prior))
        data.report(f"refining the samples of record {place + 1} of {len(plan)}")
        better, _ = improved_schedule(
            schedule,
            data.limits.interval,
            lambda other, e=experiment, o=others: data.fits((e, other), o),
            lambda other, e=experiment, r=rest: data.value(r + data.information((e, other))),
        )
        plan = [*plan[:place], (experiment, better), *plan[place + 1 :]]
    return plan


def _with_blocks_moved(data: Refinement, plan: list[Pair]) -> list[Pair]:
    """The plan after blocks of samples moved from record to record, as long as that improves it."""
    known = [data.information(pair) for pair in plan]
    least = data.value(sum(known, np.zeros_like(data.search.prior)))
    for part in BLOCKS:
        improved = True
        while improved:
            improved = False
            for giver, taker in itertools.permutations(range(len(plan)), 2):
                trial = _move_block(plan, giver, taker, part)
                if trial is None or not all(data.fits(trial[i], trial[:i] + trial[i + 1 :]) for i in (giver, taker)):
                    continue
                new = list(known)
                new[giver], new[taker] = data.information(trial[giver]), data.information(trial[taker])
                value = data.value(sum(new, np.zeros_like(data.search.prior)))
                if value < least - 1e-6:
                    plan, known, least, improved = trial, new, value, True
    return plan


def _move_block(plan: list[Pair], giver: int, taker: int, part: int) -> list[Pair] | None:
    """The plan with one `part` of the giver's samples taken by another record; None where that cannot be."""
    (experiment, schedule), (other, receiving) = plan[giver], plan[taker]
    block = max(1, schedule.samples // part)
    gained = block * schedule.windows // receiving.windows
    if schedule.samples - block < FEWEST_SAMPLES or gained < 1 or None in (experiment.drive, other.drive):
        return None
    out = list(plan)
    out[giver] = experiment, dataclasses.replace(schedule, samples=schedule.samples - block)
    out[taker] = other, dataclasses.replace(receiving, samples=receiving.samples + gained)
    return out


def is_locked(pair: Pair) -> bool:
    """Whether the samples of a record stay where they are in the cycle when the frequency changes a little."""
    experiment, schedule = pair
    return schedule.windows > 1 or schedule.length < (experiment.period or np.inf)


def _with_better_drives(data: Refinement, plan: list[Pair]) -> list[Pair]:
    """The plan with voltages, frequencies and duties where the criterion is least nearby."""
    from scipy.optimize import minimize  # takes a while to load

    ends = {"voltage": data.limits.voltage, "frequency": data.limits.frequency}
    if data.limits.duty:
        ends["duty"] = min(data.limits.duty), max(data.limits.duty)
    free = [
        (place, field, low, high)
        for place, (experiment, _) in enumerate(plan)
        for field in experiment.shape
        for low, high in [ends.get(field, (1.0, 1.0))]
        if low < high and (field != "frequency" or is_locked(plan[place]))
    ]
    if not free:
        return plan
    lows, highs = (np.log([entry[i] for entry in free]) for i in (2, 3))
    start = np.log([plan[place][0].shape[field] for place, field, _, _ in free])

    def at(x: Float[np.ndarray, " v"]) -> list[Pair]:
        out = list(plan)
        for (place, field, _, _), number in zip(free, np.exp(np.clip(x, lows, highs)), strict=True):
            out[place] = out[place][0].with_shape({field: number}), out[place][1]
        return out

    def value_and_slope(x: Float[np.ndarray, " v"]) -> tuple[float, Float[np.ndarray, " v"]]:
        here = at(x)
        steps = np.where(x + STEP <= highs, STEP, -STEP)
        moved = [at(x + steps * (np.arange(x.size) == i))[place] for i, (place, *_) in enumerate(free)]
        found = data.survey.exact_information([*here, *moved], data.points)
        known = found[: len(here)].sum(axis=0)
        value, slope = data.value(known), np.zeros(x.size)
        for i, (place, *_) in enumerate(free):
            changed = data.value(known - found[place] + found[len(here) + i])
            slope[i] = (changed - value) / steps[i]
        return (value, slope) if np.isfinite(value) and np.isfinite(slope).all() else (1e9, np.zeros(x.size))

    allowed = lambda pairs: all(data.fits(pair, pairs[:i] + pairs[i + 1 :]) for i, pair in enumerate(pairs))
    found = minimize(
        value_and_slope,
        np.clip(start, lows, highs),
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(lows, highs, strict=True)),
        options={"maxfun": _EVALUATIONS, "maxiter": _EVALUATIONS, "maxls": 4},
    )
    end, sound = at(found.x), [e for e, _ in at(found.x) if e.drive is None or not e.drive.broken_conditions()]
    return end if allowed(end) and len(sound) == len(end) else plan
