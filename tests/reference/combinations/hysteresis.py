"""Rate-independent hysteresis in closed form along monotone stretches of the voltage.

`paths` follows the same laws step by step along a motion; here each stretch is cut where a law changes its
expression, and on each part the displacement is an explicit function of the voltage.
"""

import dataclasses
import itertools
import math

from tests.reference.combinations.roots import crossing
from tests.reference.combinations.voltage import Stretch

Curve = tuple[float, ...]
"""k_2 [m/V^2], k_3 [m/V^3], ..."""


@dataclasses.dataclass(frozen=True)
class Expression:
    """e = k_0 + k_1 u + k_2 u^2 + ... + k_b exp(rate (u - u_b)) [m]: what the stack aims at, but for creep."""

    constant: float
    linear: float
    curve: Curve = ()
    factor: float = 0.0
    rate: float = 0.0
    origin: float = 0.0

    def at(self, u: float) -> float:
        """e [m]."""
        e = self.constant + u * self.linear + sum(k * u**n for n, k in enumerate(self.curve, 2))
        return e + self.factor * math.exp(self.rate * (u - self.origin)) if self.factor else e

    def derivatives(self, u: float, du: float, ddu: float) -> tuple[float, float]:
        """e' [m/s] and e'' [m/s^2] under u' [V/s] and u'' [V/s^2]."""
        slope = self.linear + sum(n * k * u ** (n - 1) for n, k in enumerate(self.curve, 2))
        bend = sum(n * (n - 1) * k * u ** (n - 2) for n, k in enumerate(self.curve, 2))
        if self.factor:
            x = self.factor * math.exp(self.rate * (u - self.origin))
            slope, bend = slope + self.rate * x, bend + self.rate * self.rate * x
        return slope * du, slope * ddu + bend * du * du


@dataclasses.dataclass(frozen=True)
class Piece:
    """A stretch of the voltage on which the stack has one expression."""

    voltage: Stretch
    expression: Expression


class Elements:
    """Stops s_i in parallel: e = k_1 u + k_2 u^2 + ... - sum b_i s_i, s_i = clip(s_i + du, -r_i, r_i).

    M. Goldfarb and N. Celanovic, J. Dynamic Systems, Measurement, and Control 119(3), 1997; u - s_i is a play, and
    a sum of those a Prandtl-Ishlinskii operator.
    """

    def __init__(self, weights: list[float], thresholds: list[float], linear: float, curve: Curve = ()):
        """Weights b_i [m/V], thresholds r_i [V], k_1 [m/V] and the curve beyond it."""
        self.weights, self.thresholds = weights, thresholds
        self.linear, self.curve = linear, curve
        self.stops = [0.0] * len(weights)

    def split(self, voltage: Stretch) -> list[Piece]:
        """The pieces of a monotone stretch, cut where an element begins to slip; the stops are then at its end."""
        start, end = voltage.at(voltage.begin)[0], voltage.at(voltage.end)[0]
        way, whole = 1.0 if end >= start else -1.0, abs(end - start)
        springs = list(zip(self.stops, self.thresholds, strict=True))
        cuts = sorted(way * (r - way * s) + start for s, r in springs if 0.0 < r - way * s < whole)
        times = [voltage.begin]
        for cut in cuts if way > 0 else reversed(cuts):
            times.append(crossing(lambda t, cut=cut: voltage.at(t)[0] - cut, times[-1], voltage.end))
        times.append(voltage.end)
        pieces = []
        for a, b in itertools.pairwise(times):
            if b > a:
                middle = 0.5 * (voltage.at(a)[0] + voltage.at(b)[0])
                pieces.append(Piece(voltage.part(a, b), self.expression(start, middle, way)))
        self.pass_over(end - start)
        return pieces

    def expression(self, start: float, middle: float, way: float) -> Expression:
        """On the part around the voltage `middle` of a stretch that begins at the voltage `start` [V]."""
        constant, linear = 0.0, self.linear
        for b, s, r in zip(self.weights, self.stops, self.thresholds, strict=True):
            if way * s + abs(middle - start) >= r:
                constant -= b * way * r
            else:
                constant -= b * (s - start)
                linear -= b
        return Expression(constant, linear, self.curve)

    def pass_over(self, change: float) -> None:
        """The voltage runs a monotone way of `change` [V], or jumps by it."""
        self.stops = [min(max(s + change, -r), r) for s, r in zip(self.stops, self.thresholds, strict=True)]


class BoucWen:
    """e = k_1 u + k_2 u^2 + ... - c h, dh = (A - (beta +- gamma) h sign(du)) du, + while du and h are of one sign.

    T. S. Low and W. Guo, J. Microelectromechanical Systems 4(4), 1995. In terms of H = h sign(du) and the path of u,
    H tends exponentially to A / (beta +- gamma).
    """

    def __init__(self, linear: float, curve: Curve, weight: float, slope: float, beta: float, gamma: float):
        """k_1 [m/V], the curve beyond it, c, A, beta [1/V] and gamma [1/V]."""
        self.linear, self.curve, self.weight, self.slope = linear, curve, weight, slope
        self.loading, self.unloading = beta + gamma, beta - gamma
        self.h = 0.0

    def path_to_zero(self, h: float) -> float:
        """The path of the voltage [V] after which an H < 0 is 0."""
        rate = self.unloading
        return -h / self.slope if abs(rate) < 1e-14 else math.log1p(-rate * h / self.slope) / rate

    def after(self, h: float, rate: float, path: float) -> float:
        """H after a path [V] on a branch with this rate [1/V]."""
        return h * math.exp(-rate * path) - self.slope * math.expm1(-rate * path) / rate

    def split(self, voltage: Stretch) -> list[Piece]:
        """The pieces of a monotone stretch, cut where h passes through zero; h is then at its end."""
        start, end = voltage.at(voltage.begin)[0], voltage.at(voltage.end)[0]
        way = 1.0 if end >= start else -1.0
        h, path = way * self.h, abs(end - start)
        branches = [(voltage.begin, voltage.end, h, self.loading if h >= 0 else self.unloading, start)]
        if h < 0 and (left := self.path_to_zero(h)) < path:
            zero = crossing(lambda t: way * (voltage.at(t)[0] - start) - left, voltage.begin, voltage.end)
            first = voltage.begin, zero, h, self.unloading, start
            branches = [first, (zero, voltage.end, 0.0, self.loading, start + way * left)]
        pieces = []
        for a, b, h, rate, origin in branches:
            if b > a:
                # h = way (A / rate + (H - A / rate) exp(-rate way (u - u_b)))
                constant, factor = (-self.weight * way * x for x in (self.slope / rate, h - self.slope / rate))
                exponential = factor, -rate * way, origin
                pieces.append(Piece(voltage.part(a, b), Expression(constant, self.linear, self.curve, *exponential)))
        self.pass_over(end - start)
        return pieces

    def pass_over(self, change: float) -> None:
        """The voltage runs a monotone way of `change` [V], or jumps by it."""
        way = 1.0 if change >= 0 else -1.0
        h, path = way * self.h, abs(change)
        if h < 0:
            left = self.path_to_zero(h)
            if left >= path:
                self.h = way * self.after(h, self.unloading, path)
                return
            h, path = 0.0, path - left
        self.h = way * self.after(h, self.loading, path)
