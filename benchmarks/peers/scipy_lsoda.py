"""SciPy's LSODA, one `solve_ivp` for each straight piece of the drive; a plain or a compiled field."""

import dataclasses
import functools
import importlib
import math
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from pdssjax import Record

from ..problem import Piece, Problem, pieces
from .base import BLEND, AbstractPeer, Prepared, ladder, not_installed, persist, warmed

RATE = 6736.0
"""Scale of the velocities [1/s], so that one tolerance suits displacements and velocities."""


def field(time, state, p, voltage, slope, begin, blend=0.0):
    """The coupled equations in um and um times `RATE`, as a user of SciPy writes them; `blend` as `BLEND`."""
    y, w, _, w_e, z = state
    u = voltage + slope * (time - begin)
    v = (w - w_e) * RATE
    if blend > 0:
        ahead = 0.5 + 0.5 * math.tanh(v / blend)
        s0, s1, f_ss = p[5] + ahead * (p[4] - p[5]), p[7] + ahead * (p[6] - p[7]), p[9] + ahead * (p[8] - p[9])
    elif v >= 0:
        s0, s1, f_ss = p[4], p[6], p[8]
    else:
        s0, s1, f_ss = p[5], p[7], p[9]
    rate = v - s0 * abs(v) / (1e6 * f_ss) * z
    force = s0 * z + s1 * rate
    push = p[0] * p[0] * (1e6 * p[2] * u - y) - 2.0 * p[1] * p[0] * w * RATE
    return [w * RATE, push / RATE, w_e * RATE, force / p[3] / RATE, rate]


def follow(run, parameters, drive_pieces: list[Piece], times: np.ndarray) -> np.ndarray:
    """The end-effector at `times` from a `run` over one piece: (state, piece, times inside) -> states."""
    out, state = np.zeros(times.size), np.zeros(5)
    for piece in drive_pieces:
        inside = np.flatnonzero((times > piece.begin * (1 + 1e-12)) & (times <= piece.end * (1 + 1e-12)))
        wanted = np.minimum(times[inside], piece.end)
        stops = wanted if wanted.size and wanted[-1] == piece.end else np.append(wanted, piece.end)
        states = run(state, piece, stops)
        out[inside] = states[: inside.size, 2]
        state = states[-1]
        if np.isnan(state).any():
            return np.full(times.size, np.nan)
    return out


@dataclasses.dataclass(frozen=True)
class SciPyLSODA(AbstractPeer):
    """`scipy.integrate.solve_ivp(method="LSODA")`."""

    numba: bool
    tolerances: tuple[float, ...] = ladder(1e-4, 1e-9)
    # Seconds a run: few tolerances, about the one that gives 1e-3.
    jacobian_tolerances: tuple[float, ...] = ladder(1e-6, 1e-7)
    fit_tolerance: float | None = 1e-7

    @property
    def name(self) -> str:
        return "SciPy LSODA" + (", field compiled by numba" if self.numba else "")

    def missing(self) -> str | None:
        return not_installed(["numba"]) if self.numba else None

    def trajectory(self, problem: Problem) -> Prepared:
        drive_pieces, times = pieces(problem.drive(), problem.times[-1]), problem.times
        return warmed(lambda p, tolerance: self._follow(p, drive_pieces, times, tolerance), 1e-3)

    def record(self, parameters: np.ndarray, record: Record, tolerance: float) -> np.ndarray:
        assert record.drive is not None
        drive_pieces = pieces(record.drive, record.time[-1])
        return persist(lambda t: self._follow(parameters, drive_pieces, record.time, t, BLEND), tolerance)

    def _follow(self, p, drive_pieces, times, tolerance, blend=0.0):
        compiled = _compiled_field() if self.numba else field

        def run(state, piece, stops):
            found = solve_ivp(
                compiled,
                (piece.begin, piece.end),
                state,
                method="LSODA",
                t_eval=stops,
                rtol=tolerance,
                atol=tolerance,
                first_step=1e-6,
                args=(p, piece.voltage, piece.slope, piece.begin, blend),
            )
            return found.y.T if found.success else np.full((stops.size, state.size), np.nan)

        return follow(run, p, drive_pieces, times)


@functools.cache
def _compiled_field() -> Any:
    numba: Any = importlib.import_module("numba")
    plain = numba.njit(field)
    return numba.njit(lambda t, x, p, u, k, t0, blend: np.array(plain(t, x, p, u, k, t0, blend)))


PEERS = (SciPyLSODA(numba=False), SciPyLSODA(numba=True))
