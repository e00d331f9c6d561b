"""Platforms and an end-effector once more, in plain NumPy and SciPy, along voltages given as monotone pieces.

Nothing of the package is used: the hysteresis follows from its definition along each piece, the
rest from SciPy's DOP853 from corner to corner.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

TIGHT: dict[str, Any] = dict(method="DOP853", rtol=1e-11)
W, XI, C = 6736.0, 0.1772, 1.007e-7


@dataclasses.dataclass(frozen=True)
class Piece:
    """A stretch of time over which the voltage is smooth and does not turn."""

    begin: float
    end: float
    u: Callable[[float], float]
    slope: Callable[[float], float]


def line(begin: float, end: float, u0: float, u1: float) -> Piece:
    """A straight piece from u0 to u1."""
    rate = (u1 - u0) / (end - begin)
    return Piece(begin, end, lambda t: u0 + rate * (t - begin), lambda t: rate)


def half_sines(volts: float, frequency: float, until: float) -> list[Piece]:
    """V/2 (1 - cos), cut at its turning points."""
    w = 2 * np.pi * frequency
    u, slope = lambda t: 0.5 * volts * (1 - np.cos(w * t)), lambda t: 0.5 * volts * w * np.sin(w * t)
    count = int(np.ceil(until * 2 * frequency - 1e-9))
    return [Piece(k / (2 * frequency), (k + 1) / (2 * frequency), u, slope) for k in range(count)]


class Plain:
    """The voltage reaches the oscillator as it is; `extra` states follow y and y'."""

    extra = 0

    def jump(self, x: np.ndarray, u: float, piece: Piece) -> np.ndarray:
        """The state after the voltage has gone from u to that with which the piece begins."""
        return x

    def drives(self, t: float, x: np.ndarray, piece: Piece) -> Any:
        """The voltage that drives the oscillator."""
        return piece.u(t)

    def rates(self, t: float, x: np.ndarray, piece: Piece) -> list[float]:
        """Rates of the extra states."""
        return []


class Creeping(Plain):
    extra = 3

    def __init__(self, k: float, t1: float):
        self.k, self.times = k, t1 * np.array([1.0, 10.0, 100.0])

    def drives(self, t, x, piece):
        return piece.u(t) + x[2:5].sum()

    def rates(self, t, x, piece):
        return list((self.k * piece.u(t) - x[2:5]) / self.times)


class Bouc(Plain):
    extra = 1

    def __init__(self, a: float, b: float, g: float):
        self.a, self.b, self.g = a, b, g

    def flow(self, du: float, h: float) -> float:
        return self.a * C * du - self.b * abs(du) * h - self.g * du * abs(h)

    def jump(self, x, u, piece):
        change = piece.u(piece.begin) - u
        if abs(change) < 1e-9:
            return x
        kink = lambda _, h: h[0]
        stiff: Any = dict(method="DOP853", rtol=1e-12, atol=1e-22, max_step=0.01)
        ramp = solve_ivp(lambda _, h: [self.flow(change, h[0])], (0.0, 1.0), [x[2]], events=kink, **stiff)
        return np.array([*x[:2], ramp.y[0, -1], *x[3:]])

    def drives(self, t, x, piece):
        return piece.u(t) - x[2] / C

    def rates(self, t, x, piece):
        return [self.flow(piece.slope(t), x[2])]


class Stops(Plain):
    """Each s_i follows the voltage until it has reached its threshold: s = clip(s0 + u - u0)."""

    def __init__(self, shares: Any, thresholds: Any):
        self.b, self.r = np.array(shares), np.array(thresholds)
        self.s, self.seen = np.zeros(len(self.r)), 0.0

    def moved(self, u: float) -> np.ndarray:
        return np.clip(self.s + u - self.seen, -self.r, self.r)

    def jump(self, x, u, piece):
        for volts in (u, piece.u(piece.begin)):
            self.s, self.seen = self.moved(volts), volts
        return x

    def drives(self, t, x, piece):
        u = piece.u(t)
        return u - self.b @ self.moved(u)


def integrated(stack: Plain, pieces: list[Piece], times: Any, contact: tuple[float, ...] | None = None) -> np.ndarray:
    """Platform and end-effector displacement [m] at ascending `times` > 0, shape (m, 2).

    `contact` holds mass [kg], s0, s1, breakaway force of the isotropic LuGre law (5.20, 5.21).
    """
    n = 2 + stack.extra
    x, u = np.zeros(n + (3 if contact else 0)), 0.0
    out = []

    def field(t, x, piece):
        pushed = W**2 * (C * stack.drives(t, x, piece) - x[0]) - 2 * XI * W * x[1]
        rates = [x[1], pushed, *stack.rates(t, x, piece)]
        if contact:
            mass, s0, s1, f = contact
            v, z = x[1] - x[n + 1], x[n + 2]
            flow = v - abs(v) * s0 * z / f
            rates += [x[n + 1], (s0 * z + s1 * flow) / mass, flow]
        return rates

    for piece in pieces:
        x = stack.jump(x, u, piece)
        inside = [float(t) for t in times if piece.begin < t <= piece.end]
        stops = sorted({*inside, piece.end})
        atol = np.array(
            [1e-17, 1e-14, *[1e-12 if n > 3 else 1e-18] * stack.extra, *[1e-17, 1e-14, 1e-17][: x.size - n]]
        )
        solved = solve_ivp(
            field, (piece.begin, piece.end), x, args=(piece,), t_eval=stops, atol=atol, max_step=2e-4, **TIGHT
        )
        assert solved.success, solved.message
        out += [(solved.y[0, i], solved.y[n, i] if contact else 0.0) for i, t in enumerate(stops) if t in inside]
        x, u = solved.y[:, -1], piece.u(piece.end)
    return np.array(out)
