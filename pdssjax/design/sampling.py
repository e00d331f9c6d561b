"""Where a limited number of samples goes: windows of a recorder, one a cycle of the drive.

A recorder takes samples at an even interval from a trigger on.  It may be triggered once, and then records on through
the cycles, or once a cycle, and then only a window of each is recorded, as after the fast flank.  Where the trigger of
each window comes a fraction of the interval later than that of the one before, the windows of a periodic motion
together sample it finer than the recorder can: equivalent-time sampling.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

PARTS = (0.5, 1.0, 2.0)
"""Samples of a record, in parts of an even share of the budget."""

INTERVALS = (1, 2, 4, 8, 16, 64)
"""Intervals, in those that the recorder can do at least."""

WINDOWS = (1, 2, 4, 8, 16)
"""Cycles that are recorded."""

SHIFTS = (1, 4)
"""Triggers at different fractions of an interval; 1: all alike."""

FEWEST_SAMPLES = 8
"""Samples of a window."""


class Window(NamedTuple):
    """Samples at an even interval."""

    start: float
    """Time of the first [s], from the start of the drive."""
    samples: int
    interval: float
    """[s]"""


@dataclasses.dataclass(frozen=True)
class Schedule:
    """The samples of a record, on the clock of its drive, whatever the frequency is."""

    first: int
    """The cycle, from 0 on, in which recording begins."""
    windows: int
    """How many windows are recorded, one a cycle."""
    lead: float
    """Time from the start of the cycle to the first sample of its window [s]; negative if the sample comes before."""
    samples: int
    """Samples of each window."""
    interval: float
    """Between samples [s]."""
    shifts: int = 1
    """Number of cycles in which the window moves by one interval; 1 where it does not move."""

    @property
    def count(self) -> int:
        """All samples."""
        return self.windows * self.samples

    @property
    def length(self) -> float:
        """Time from the first sample of a window to its last [s]."""
        return (self.samples - 1) * self.interval

    def begins(self, period: float | None) -> Float[np.ndarray, " windows"]:
        """Time of the first sample of each window [s]; `period` [s] of the drive, None where it does not repeat."""
        cycle = np.arange(self.windows)
        whole = 0.0 if period is None else (self.first + cycle) * period
        return whole + self.lead + (cycle % self.shifts) * self.interval / self.shifts

    def times(self, period: float | None) -> Float[np.ndarray, " count"]:
        """Sample times [s] from the start of the drive."""
        return np.ravel(self.begins(period)[:, None] + self.interval * np.arange(self.samples))

    def rounded(self) -> "Schedule":
        """The schedule with its first sample at a whole number of tenths of a microsecond."""
        return dataclasses.replace(self, lead=round(self.lead, 7), interval=float(f"{self.interval:.9g}"))

    def list_windows(self, period: float | None) -> list[Window]:
        """The windows in their order."""
        return [Window(float(begin), self.samples, self.interval) for begin in self.begins(period)]

    def fits(self, period: float | None, finest: float, duration: float) -> bool:
        """Whether a recorder whose least interval is `finest` [s] can take it, within a record of `duration` [s]."""
        if self.samples < FEWEST_SAMPLES or self.windows < 1 or self.interval < finest * (1 - 1e-9) or self.first < 0:
            return False
        if period is None and (self.windows > 1 or self.first):
            return False
        late = self.interval * (self.shifts - 1) / self.shifts
        if self.windows > 1 and period is not None and self.length + late + finest > period:
            return False
        end = self.times(period)[-1]
        return bool(0.0 < end <= duration * (1 + 1e-9) and self.lead >= -0.1 * duration)


def possible_schedules(
    period: float | None, starts: Sequence[float], share: float, most: int, finest: float, duration: float
) -> list[Schedule]:
    """Ways to spend about `share` samples, and `most` at most, on a record.

    **Arguments:** `period` [s] of the drive, None where it does not repeat; `starts` of windows from the start of a
    cycle [s], such as where the fast flank begins and ends; the recorder's least interval `finest` and the longest
    record, `duration`, in s.
    """
    found: dict[Schedule, None] = {}
    counts = dict.fromkeys(min(max(round(part * share), FEWEST_SAMPLES), most) for part in PARTS)
    for count, windows, factor, shifts, start in itertools.product(counts, WINDOWS, INTERVALS, SHIFTS, starts):
        if (period is None and windows > 1) or shifts > windows:
            continue
        for first in (0, 1) if period is not None else (0,):
            schedule = Schedule(first, windows, start, count // windows, factor * finest, shifts)
            if schedule.fits(period, finest, duration):
                found[schedule] = None
        # Once triggered, the recorder may go on through as many cycles; samples before the drive tell the zero.
        if windows == 1 and shifts == 1:
            whole = duration if period is None else min(duration, max(WINDOWS) * period)
            even = Schedule(0, 1, 0.0, count, finest * max(1, int(whole / count / finest)), 1)
            early = Schedule(0, 1, -0.1 * count * factor * finest, count, factor * finest, 1)
            for schedule in (even, early):
                if schedule.fits(period, finest, duration):
                    found[schedule] = None
    return list(found)


def contact_schedules(period: float, share: float, most: int, finest: float, duration: float) -> list[Schedule]:
    """Schedules of a contact under a prescribed motion, which is known at the samples only: even, from its start on."""
    counts = dict.fromkeys(min(max(round(part * share), FEWEST_SAMPLES), most) for part in PARTS)
    spans = [cycles * period for cycles in (1, 2, 4) if cycles * period <= duration]
    made = [Schedule(0, 1, 0.0, n, finest * max(1, int(span / n / finest)), 1) for n in counts for span in spans]
    return [schedule for schedule in dict.fromkeys(made) if schedule.fits(period, finest, duration)]


def neighbours(schedule: Schedule, finest: float) -> list[Schedule]:
    """Schedules that differ in one respect and have no more samples: the moves of a local search.

    Intervals are whole numbers of the `finest` [s] that the recorder can do, as its clock is divided.
    """
    change = lambda **fields: dataclasses.replace(schedule, **fields)
    interval, samples = schedule.interval, schedule.samples
    moved = [change(lead=schedule.lead + steps * interval) for steps in (-64, -16, -4, -1, -0.5, 0.5, 1, 4, 16, 64)]
    ticks = round(interval / finest)
    others = {ticks - 1, ticks + 1, *(round(factor * ticks) for factor in (0.5, 0.7, 0.9, 1.1, 1.4, 2.0))}
    moved += [change(interval=count * finest) for count in sorted(others) if count >= 1]
    moved += [change(first=schedule.first + step) for step in (-1, 1, 4)]
    moved += [change(windows=2 * schedule.windows, samples=samples // 2)]
    moved += [change(windows=(schedule.windows + 1) // 2, samples=2 * samples)] if schedule.windows % 2 == 0 else []
    moved += [change(shifts=shifts) for shifts in (1, 2, 4, 8) if shifts <= schedule.windows]
    return [other for other in dict.fromkeys(moved) if other != schedule]


class Grid(NamedTuple):
    """Dense times of an experiment, finer after each corner of the drive, from which any schedule is interpolated."""

    times: Float[np.ndarray, " m"]
    """[s], ascending, from 0 on."""
    period: float | None
    """Period of the drive [s]; None where it does not repeat."""
    cycles: int
    """Cycles that the grid covers."""

    def interpolated(
        self, columns: Float[np.ndarray, "m q"], times: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n q"]:
        """The `columns`, known on the grid, at other `times` [s]; zero before the drive.

        Beyond the grid's cycles a motion goes on as it did from the last but one to the last: the same at each phase,
        but for a constant step a cycle.
        """
        if self.period is None:
            return self._linear(columns, times)
        beyond = np.maximum(np.floor(times / self.period).astype(int) - (self.cycles - 1), 0)
        out = self._linear(columns, times - beyond * self.period)
        late = np.flatnonzero(beyond)
        if late.size and self.cycles > 1:
            inside = times[late] - beyond[late] * self.period
            before = self._linear(columns, inside - self.period)
            out[late] += beyond[late, None] * (out[late] - before)
        return out

    def _linear(self, columns: Float[np.ndarray, "m q"], times: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n q"]:
        place = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, self.times.size - 2)
        part = np.clip((times - self.times[place]) / (self.times[place + 1] - self.times[place]), 0.0, 1.0)[:, None]
        return np.where(times[:, None] < 0.0, 0.0, (1.0 - part) * columns[place] + part * columns[place + 1])


_FINE, _OCTAVE = 160, 80
"""Points after a corner at the finest spacing, and at each coarser one, twice the one before."""

CYCLES = 4
"""Cycles of a drive that a grid covers: a motion repeats after two or three."""


def graded_grid(period: float | None, corners: Sequence[float], spacing: float, duration: float) -> Grid:
    """The grid of an experiment: `spacing` [s] after each of the `corners` [s] of a cycle, coarser further on.

    **Arguments:** `period` [s] of the drive, None where it does not repeat; the longest record has `duration` [s].
    """
    cycles = 1 if period is None else max(1, min(CYCLES, math.ceil(duration / period - 1e-9)))
    whole = duration if period is None else period
    ends = [*corners[1:], whole]
    parts = [graded(begin, end, spacing) for begin, end in zip(corners, ends, strict=True)]
    cycle = np.unique(np.concatenate(parts))
    times = np.concatenate([cycle + number * whole for number in range(cycles)])
    return Grid(np.append(times, cycles * whole), period, cycles)


def graded(begin: float, end: float, spacing: float) -> Float[np.ndarray, " points"]:
    """Times from `begin` up to `end` [s], the latter not included: `spacing` doubles after every octave of points."""
    times, step, here, count = [], spacing, begin, _FINE
    while here < end:
        part = here + step * np.arange(count)
        times.append(part[part < end - 0.25 * step])
        here, step, count = here + step * count, 2.0 * step, _OCTAVE
    return np.concatenate(times) if times else np.array([begin])


def improved_schedule(
    schedule: Schedule,
    finest: float,
    allowed: Callable[[Schedule], bool],
    score: Callable[[Schedule], float],
    rounds: int = 6,
) -> tuple[Schedule, float]:
    """The best schedule that a local search reaches from `schedule`, and its score; lower is better.

    **Arguments:** the recorder's least interval `finest` [s], which schedules are `allowed`, and their `score`.
    """
    best, least = schedule, score(schedule)
    for _ in range(rounds):
        trials = [(score(other), other) for other in neighbours(best, finest) if allowed(other)]
        lowest, other = min(trials, key=lambda trial: trial[0], default=(least, best))
        if lowest >= least - 1e-7:
            break
        least, best = lowest, other
    return best, least
