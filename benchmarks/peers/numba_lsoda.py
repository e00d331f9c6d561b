"""numbalsoda: the same LSODA, with solver and field compiled together by numba."""

import dataclasses
import functools
import importlib
from typing import Any

import numpy as np

from pdssjax import Record

from ..grid import Grid
from ..problem import Problem, pieces
from .base import ATTEMPTS, BLEND, LOOSER, AbstractPeer, Prepared, ladder, not_installed, persist, warmed
from .scipy_lsoda import RATE

_MOST_STEPS = 2_000
"""From one sample to the next."""


@dataclasses.dataclass(frozen=True)
class NumbaLSODA(AbstractPeer):
    """`numbalsoda.lsoda` on each straight piece of the drive."""

    tolerances: tuple[float, ...] = ladder(1e-4, 1e-9)
    jacobian_tolerances: tuple[float, ...] = ladder(1e-5, 1e-8)
    sweep_tolerances: tuple[float, ...] = ladder(1e-5, 1e-6, 4)
    fit_tolerance: float | None = 1e-7

    @property
    def name(self) -> str:
        return "numbalsoda"

    def missing(self) -> str | None:
        return not_installed(["numba", "numbalsoda"])

    def trajectory(self, problem: Problem) -> Prepared:
        table, times = _table(problem.drive(), problem.times[-1]), problem.times
        return warmed(lambda p, tolerance: _solver()(p, table, times, tolerance), 1e-3)

    def sweep(self, grid: Grid) -> Prepared:
        tables = np.array([_sawtooth(v, f, last) for (v, f), last in zip(grid.points, grid.times[:, -1], strict=True)])
        times = grid.times

        def run(p, tolerance):
            found = _looped()(p, tables, times, tolerance)
            for attempt in range(1, ATTEMPTS):  # as `persist` does
                stuck = np.flatnonzero(np.isnan(found).any(axis=1))
                if stuck.size:
                    found[stuck] = _looped()(p, tables[stuck], times[stuck], tolerance * LOOSER**attempt)
            return found

        return warmed(run, self.sweep_tolerances[0])

    def record(self, parameters: np.ndarray, record: Record, tolerance: float) -> np.ndarray:
        table = _table(record.drive, record.time[-1])
        return persist(lambda t: _solver()(parameters, table, record.time, t, BLEND), tolerance)


def _table(drive, until) -> np.ndarray:
    return np.array([dataclasses.astuple(piece) for piece in pieces(drive, until)])


def _sawtooth(voltage: float, frequency: float, until: float) -> list[list[float]]:
    """The straight pieces of an ideal forward sawtooth."""
    begins = np.arange(int(np.ceil(until * frequency))) / frequency
    return [[begin, min(begin + 1.0 / frequency, until), 0.0, voltage * frequency] for begin in begins]


@functools.cache
def _looped() -> Any:
    """`_solver` over all points, the loop compiled too."""
    numba: Any = importlib.import_module("numba")
    follow = _solver()

    @numba.njit
    def run(p, tables, times, tolerance):
        out = np.empty(times.shape)
        for i in range(len(times)):
            out[i] = follow(p, tables[i], times[i], tolerance)
        return out

    return run


@functools.cache
def _solver() -> Any:
    """Compiled on first use."""
    numba: Any = importlib.import_module("numba")
    numbalsoda: Any = importlib.import_module("numbalsoda")
    lsoda = numbalsoda.lsoda

    @numba.cfunc(numbalsoda.lsoda_sig)
    def field(time, x, rate, p):
        u = p[10] + p[11] * (time - p[12])
        v = (x[1] - x[3]) * RATE
        sharp = 1.0 if v >= 0 else 0.0
        ahead = 0.5 + 0.5 * np.tanh(v / p[13]) if p[13] > 0 else sharp
        s0 = p[5] + ahead * (p[4] - p[5])
        s1 = p[7] + ahead * (p[6] - p[7])
        f_ss = p[9] + ahead * (p[8] - p[9])
        flow = v - s0 * abs(v) / (1e6 * f_ss) * x[4]
        push = p[0] * p[0] * (1e6 * p[2] * u - x[0]) - 2.0 * p[1] * p[0] * x[1] * RATE
        rate[0] = x[1] * RATE
        rate[1] = push / RATE
        rate[2] = x[3] * RATE
        rate[3] = (s0 * x[4] + s1 * flow) / p[3] / RATE
        rate[4] = flow

    address: Any = field.address

    @numba.njit
    def follow(p, table, times, tolerance, blend=0.0):
        out, state, args, first = np.zeros(times.size), np.zeros(5), np.zeros(14), 0
        args[:10], args[13] = p, blend
        while first < times.size and times[first] <= table[0, 0]:
            first += 1
        for row in table:
            args[10], args[11], args[12] = row[2], row[3], row[0]
            after = first
            while after < times.size and times[after] <= row[1] * (1 + 1e-12):
                after += 1
            stops = np.empty(after - first + 2)
            stops[0], stops[-1] = row[0], row[1]
            stops[1:-1] = np.minimum(times[first:after], row[1])
            if after > first and stops[-2] == row[1]:
                stops = stops[:-1]
            states, ok = lsoda(address, state, stops, args, tolerance, tolerance, _MOST_STEPS)
            if not ok:
                out[:] = np.nan
                return out
            out[first:after] = states[1 : 1 + after - first, 2]
            state, first = states[-1].copy(), after
        return out

    return follow


PEERS = (NumbaLSODA(),)
