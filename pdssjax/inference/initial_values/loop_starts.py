"""Starts for a stack that is no straight line: least squares over the response of each element and power.

Thresholds and times are tried on a grid and refined, all else follows by least squares that keeps weights positive.  It
takes seconds where a search by simulations, each with a derivative an element, takes a quarter of an hour.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...core import Quantity, quantities
from ...metrics import scatter_floor
from ...piezo.base import AbstractPiezo, Shown
from ...study import Record
from ..solver.box_least_squares import nonnegative_least_squares
from .record_features import as_quantity, sticking_parts

_MOST_SAMPLES = 3000
"""Largest number of samples used of a record."""

_THRESHOLDS = (0.08, 0.15, 0.25, 0.4, 0.55, 0.75, 1.0)
"""Thresholds tried, as fractions of the voltage's swing."""

_TIME_CONSTANTS = 5
"""Number of time constants tried."""

_REFINEMENTS = (1.3, 1.1, 1.02)
"""Factors by which thresholds and time constants are refined."""

_ROUNDS = 4
"""Largest number of steps by one factor."""

_UNUSED = 1e-3
"""Start of a weight whose least-squares value is no larger, as a fraction of the gain."""


class _Loop(NamedTuple):
    """A record, or a part of it, with the voltage before."""

    time: Float[np.ndarray, " n"]
    volts: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, " m"]
    """Displacement at the last m of the times."""
    noise: float

    @staticmethod
    def of(record: Record, part: slice | None) -> "_Loop":
        """A record, or a `part` of it with the voltage before."""
        drive = record.drive
        assert drive is not None
        noise = record.noise or scatter_floor(record.measured) or float(np.std(record.measured)) or 1.0
        if part is not None:
            time = record.time[: part.stop]
            return _Loop(time, drive.sampled_at(time), record.measured[part], noise)
        stride = -(-record.time.size // _MOST_SAMPLES)
        time, measured = record.time[::stride], record.measured[::stride]
        time, measured = time[time > 0.0], measured[time > 0.0]
        first = float(time[0]) if time.size else 0.0
        interval = float(np.median(np.diff(record.time))) * stride
        before = np.linspace(0.0, first, 500, endpoint=False)[1:] if first > 2.0 * interval else np.zeros(0)
        whole = np.concatenate([before, time])
        return _Loop(whole, drive.sampled_at(whole), measured, noise)


def loop_starts(
    piezo: type[AbstractPiezo], shown: Shown, known: Mapping[str, float], records: Sequence[Record]
) -> dict[str, float]:
    """Starts of a stack's numbers by name, as the `records` suggest them; none for a stack that is a straight line.

    Records of the platform alone determine loops and creep.  Without such a record end-effectors, while they are
    likely to stick, determine powers of the voltage.

    **Arguments:** features `shown` by the records; the numbers `known`, which are held.
    """
    names = piezo.loop_numbers
    # The trials assume a stack that has rested at 0 V.
    if names is None or any(known.get(name) for name in ("initial_voltage", "initial_peak")):
        return {}
    moving = as_quantity(records, "displacement")
    driven = [record for record in moving if record.drive is not None and record.time.size >= 8]
    alone = [record for record in driven if record.measurement.platform_alone]
    if bool(alone) != bool(names):
        return {}  # a fit finds powers from nothing where the whole motion shows them, and parts show no loop
    parts = [(r, part) for r in alone or driven for part in ([None] if alone else sticking_parts(r))]
    loops = [_Loop.of(record, part) for record, part in parts]
    loops = [loop for loop in loops if np.ptp(loop.volts) > 0.0 and np.ptp(loop.measured) > 0.0]
    if not loops:
        return {}
    trial = _Trial(piezo, known, loops, quantities(piezo))
    if not names:
        return trial.best_weights(())
    ranges = piezo.determinable_ranges(shown)
    swing = max(float(np.ptp(np.append(loop.volts, 0.0))) for loop in loops)
    grid = []
    for name in names:
        if name in known:
            grid.append([known[name]])
        elif trial.declared[name].unit == "V":
            grid.append([share * swing for share in _THRESHOLDS])
        else:
            grid.append([float(time) for time in np.geomspace(ranges[name].low, ranges[name].high, _TIME_CONSTANTS)])
    by_first: dict[float, tuple[float, tuple[float, ...]]] = {}
    for point in itertools.product(*grid):
        left = trial.left(point)
        if left < by_first.get(point[0], (math.inf, point))[0]:
            by_first[point[0]] = left, point
    free = [i for i, name in enumerate(names) if name not in known]
    ends = [ranges[name][:2] if name in ranges else (0.0, math.inf) for name in names]
    # Several points of the grid are refined: the best one may have one element in another's place.
    promising = sorted(by_first.values())[:3]
    _, best = min(_refined(trial, point, left, free, ends) for left, point in promising)
    found = trial.best_weights(best) | dict(zip(names, best, strict=True))
    return {name: number for name, number in found.items() if name not in known}


class _Trial(NamedTuple):
    """Least squares over the weights of a stack, for thresholds and times that are tried."""

    piezo: type[AbstractPiezo]
    known: Mapping[str, float]
    loops: Sequence[_Loop]
    declared: Mapping[str, Quantity]

    def left(self, point: Sequence[float]) -> float:
        """Sum of squared residuals over the noise, with these thresholds and times and the best weights."""
        return self._solved(point)[1]

    def best_weights(self, point: Sequence[float]) -> dict[str, float]:
        """The weights that leave the least, by name, none next to zero: a fit's unit is the size of its start."""
        found, _ = self._solved(point)
        gain = found.get("gain") or self.known.get("gain") or max(found.values(), default=1e-7) or 1e-7
        swing = max(float(np.max(np.abs(loop.volts))) for loop in self.loops)
        power = lambda name: int(name.rpartition("_")[2]) if name.startswith("asymmetry_") else 1
        least = {name: _UNUSED * gain / swing ** (power(name) - 1) for name in found}
        return {name: number if abs(number) > least[name] else least[name] for name, number in found.items()}

    def _solved(self, point: Sequence[float]) -> tuple[dict[str, float], float]:
        numbers, rows, targets, names = dict(zip(self.piezo.loop_numbers or (), point, strict=True)), [], [], []
        for place, loop in enumerate(self.loops):
            columns = self.piezo.loop_columns(loop.time, loop.volts, numbers)
            names = [name for name in columns if name not in self.known]
            held = sum((columns[n] * self.known[n] for n in columns if n in self.known), np.zeros(loop.time.size))
            zeros = np.zeros((loop.measured.size, len(self.loops)))
            zeros[:, place] = 1.0
            last = slice(loop.time.size - loop.measured.size, None)
            rows.append(np.column_stack([*(columns[name][last] for name in names), zeros]) / loop.noise)
            targets.append((loop.measured - held[last]) / loop.noise)
        signed = np.array([self.declared[name].low != 0.0 for name in names] + [True] * len(self.loops))
        x, left = nonnegative_least_squares(np.concatenate(rows), np.concatenate(targets), signed)
        return {name: float(number) for name, number in zip(names, x, strict=False)}, left


def _refined(
    trial: _Trial, best: tuple[float, ...], least: float, free: Sequence[int], ends: Sequence[tuple[float, float]]
) -> tuple[float, tuple[float, ...]]:
    """The sum of squares left and the point where, from a point of the grid on, one number after the other."""
    for factor in _REFINEMENTS:
        for _ in range(_ROUNDS):
            before = least
            for place in free:
                for way in (factor, 1.0 / factor):
                    low, high = ends[place]
                    there = (*best[:place], min(max(best[place] * way, low), high), *best[place + 1 :])
                    if (left := trial.left(there)) < least:
                        best, least = there, left
                        break
            if not least < before:
                break
    return least, best
