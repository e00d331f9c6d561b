"""numbalsoda: the same LSODA, with solver and field compiled together by numba."""

import dataclasses
import functools
import importlib
from typing import Any

import numpy as np

from pdssjax.records import Record

from ..problem import Problem, pieces
from .base import AbstractPeer, Prepared, ladder, not_installed, warmed
from .scipy_lsoda import RATE

_MOST_STEPS = 20_000
"""From one sample to the next."""
_ATTEMPTS = 20
"""For a record of a fit."""


@dataclasses.dataclass(frozen=True)
class NumbaLSODA(AbstractPeer):
    """`numbalsoda.lsoda` on each straight piece of the drive."""

    tolerances: tuple[float, ...] = ladder(1e-4, 1e-9)
    jacobian_tolerances: tuple[float, ...] = ladder(1e-5, 1e-8)
    fit_tolerance: float | None = 1e-7

    @property
    def name(self) -> str:
        return "numbalsoda"

    def missing(self) -> str | None:
        return not_installed(["numba", "numbalsoda"])

    def trajectory(self, problem: Problem) -> Prepared:
        table, times = _table(problem.drive(), problem.times[-1]), problem.times
        return warmed(lambda p, tolerance: _solver()(p, table, times, tolerance), 1e-3)

    def record(self, parameters: np.ndarray, record: Record, tolerance: float) -> np.ndarray:
        # LSODA gets stuck at a switch now and then; another tolerance, and it is past it.
        table, motion = _table(record.drive, record.time[-1]), np.array([np.nan])
        for attempt in range(_ATTEMPTS):
            if np.isnan(motion).any():
                motion = _solver()(parameters, table, record.time, tolerance * 1.2**attempt)
        return motion


def _table(drive, until) -> np.ndarray:
    return np.array([dataclasses.astuple(piece) for piece in pieces(drive, until)])


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
        k = 0 if v >= 0 else 1
        s0, s1, f_ss = p[4 + k], p[6 + k], p[8 + k]
        flow = v - s0 * abs(v) / (1e6 * f_ss) * x[4]
        push = p[0] * p[0] * (1e6 * p[2] * u - x[0]) - 2.0 * p[1] * p[0] * x[1] * RATE
        rate[0] = x[1] * RATE
        rate[1] = push / RATE
        rate[2] = x[3] * RATE
        rate[3] = (s0 * x[4] + s1 * flow) / p[3] / RATE
        rate[4] = flow

    address: Any = field.address

    @numba.njit
    def follow(p, table, times, tolerance):
        out, state, args, first = np.zeros(times.size), np.zeros(5), np.zeros(13), 0
        args[:10] = p
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
