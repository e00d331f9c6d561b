"""Timing: everyone takes turns, round after round, so that a busy moment hits all alike."""

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

ROUND_SECONDS = 0.02
"""A round repeats a fast call until it has lasted this long."""
_SLOW = 2.0
"""Seconds from which on a call is not repeated for a rung."""


@dataclasses.dataclass
class Entry:
    """One row of the table: who did which job, how well and how fast."""

    job: str
    who: str
    call: Callable[[], Any] | None
    """What is timed; None where the `times` were taken elsewhere."""
    target: str = ""
    """The accuracy asked for."""
    tolerance: float = math.nan
    """The loosest tolerance that gives it."""
    error: float = math.nan
    """The error found: um for a trajectory, relative for the worst column of a Jacobian."""
    wrong: bool = False
    """No tolerance helps."""
    compile_seconds: float = math.nan
    first_seconds: float = math.nan
    """Of the first call after the compilation."""
    times: list[float] = dataclasses.field(default_factory=list)
    """Seconds of a warm call, one a round."""
    note: str = ""
    ours: bool = False
    cut: bool = False
    """Broken off: it takes more than the time given."""

    @property
    def median(self) -> float:
        return float(np.median(self.times)) if self.times else math.nan


@dataclasses.dataclass(frozen=True)
class Effort:
    """How much time to spend."""

    rounds: int = 9
    longest: float = 6.0
    """Seconds for all rounds of one entry; a slow one is called less often, but at least once."""
    fits: bool = True
    """Whether the slow fits of the peers are run."""
    patient: bool = False
    """Whether each of them runs to its end."""
    ends: float = math.inf
    """When, by `time.perf_counter`, the last job may begin [s]."""
    report: Callable[[str], None] = lambda message: None
    """Called with a line of text now and then."""


def seconds_of(call: Callable[[], Any]) -> float:
    """Wall-clock seconds of one call."""
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def interleave(entries: Sequence[Entry], effort: Effort) -> None:
    """Times the entries in turns: A, B, C, A, B, C, …"""
    plan = []
    for entry in entries:
        if entry.call is None:
            continue
        first = seconds_of(entry.call)
        entry.first_seconds = first if math.isnan(entry.first_seconds) else entry.first_seconds
        typical = seconds_of(entry.call) if first < effort.longest / 2 else first
        rounds = int(np.clip(effort.longest / typical, 1, effort.rounds))
        if rounds == 1:
            entry.times.append(min(first, typical))
            continue
        plan.append((entry, entry.call, rounds, int(np.clip(ROUND_SECONDS / typical, 1, 50))))
    for turn in range(effort.rounds):
        for entry, call, rounds, repeats in plan:
            if turn < rounds:
                entry.times.append(seconds_of(lambda call=call, n=repeats: [call() for _ in range(n)]) / repeats)


@dataclasses.dataclass
class Rung:
    """One point of a work-precision curve."""

    tolerance: float
    error: float
    seconds: float


@dataclasses.dataclass
class Curve:
    """Error against time of one simulator, loosest tolerance first."""

    job: str
    who: str
    rungs: list[Rung]
    wrong: bool = False

    def reaching(self, target: float) -> Rung | None:
        """The loosest rung from which on every error is within the target: no lucky hit counts."""
        found = None
        for rung in reversed(self.rungs):
            if not rung.error <= target:
                break
            found = rung
        return found


def climb(
    job: str, who: str, run: Callable[[float], Any], error: Callable[[Any], float], tolerances: Sequence[float]
) -> Curve:
    """Error and time, the better of two calls unless they are slow, at each tolerance, until one fails."""
    rungs = []
    for tolerance in tolerances:
        times, result = [], None
        for _ in range(2):
            begun = time.perf_counter()
            result = run(tolerance)
            times.append(time.perf_counter() - begun)
            if times[0] > _SLOW:
                break
        rungs.append(Rung(tolerance, error(result), min(times)))
        if len(rungs) > 1 and rungs[-1].error == math.inf:
            return Curve(job, who, rungs[:-1])
    return Curve(job, who, rungs)


@dataclasses.dataclass
class Outcome:
    """What a job brings home."""

    entries: list[Entry]
    curves: list[Curve] = dataclasses.field(default_factory=list)
    facts: dict[str, Any] = dataclasses.field(default_factory=dict)
    """Counts and other numbers that are no times."""
    lines: list[str] = dataclasses.field(default_factory=list)
    """Sentences for the reader."""
