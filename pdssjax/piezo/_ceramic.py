"""What the ceramic of a composed stack aims at: the displacement that the voltage would give at rest, and its rates.

It is the sum of a polynomial of the voltage, of what follows it with hysteresis, and of creep; `composed` tells
the equation.
"""

from typing import NamedTuple

from ..core import ScalarLike
from ..integration import N
from ._composed_state import Entry, Parts
from ._hysteresis import AbstractHysteresis


class Ceramic(NamedTuple):
    """The numbers of polynomial, hysteresis and creep."""

    memoryless: tuple[ScalarLike, ...]
    """Coefficients of the voltage, its square, ... [m/V], [m/V^2], ..."""
    hysteresis: AbstractHysteresis
    shares: tuple[ScalarLike, ...]
    """Of each element of creep [m/V]."""
    times: tuple[ScalarLike, ...]
    """Of each element of creep [s]."""

    def aim(self, voltage: N, stops: tuple[N, ...], crept: tuple[N, ...]) -> N:
        """The displacement [m] that the ceramic would have at rest."""
        gain, *curves = self.memoryless
        total: Entry = voltage * gain
        for k, curve in enumerate(curves, start=2):
            total = total + _power(voltage, k) * curve
        for stop, weight in zip(stops, self.hysteresis.weights, strict=True):
            total = total + (voltage - stop) * weight
        return sum(crept, total)

    def aim_rate(self, x: Parts[Entry], slope: Entry) -> Entry:
        """Its rate [m/s], while that of the voltage is `slope` [V/s]."""
        gain, *curves = self.memoryless
        total = slope * gain
        for k, curve in enumerate(curves, start=2):
            total = total + _power(x.seen, k - 1) * slope * (k * curve)
        for rate, weight in zip(self.stop_rates(x, slope), self.hysteresis.weights, strict=True):
            total = total + (slope - rate) * weight
        return sum(self.creep_rates(x), total)

    def aim_bend(self, x: Parts[Entry], slope: Entry, bend: Entry) -> Entry:
        """The rate of its rate [m/s2], while that of the voltage's is `bend` [V/s2]."""
        gain, *curves = self.memoryless
        total = x.seen * 0.0 + bend * gain
        for k, curve in enumerate(curves, start=2):
            total = total + slope * slope * _power(x.seen, k - 2) * ((k - 1) * k * curve)
            total = total + _power(x.seen, k - 1) * bend * (k * curve)
        bends = self.hysteresis.bends(x.stops, x.rises, x.marks, slope, bend)
        for rate, weight in zip(bends, self.hysteresis.weights, strict=True):
            total = total + (bend - rate) * weight
        for rate, share, time in zip(self.creep_rates(x), self.shares, self.times, strict=True):
            total = total + (slope * share - rate) * (1.0 / time)
        return total

    def stop_rates(self, x: Parts[Entry], slope: Entry) -> tuple[Entry, ...]:
        """Of the elements of hysteresis [V/s]."""
        return self.hysteresis.rates(x.stops, x.rises, x.marks, slope)

    def creep_rates(self, x: Parts[Entry]) -> tuple[Entry, ...]:
        """Of the elements of creep [m/s]."""
        elements = zip(x.crept, self.shares, self.times, strict=True)
        return tuple((x.seen * share - c) * (1.0 / time) for c, share, time in elements)


def _power(x: Entry, exponent: int) -> Entry:
    """x to a whole power from 0 on, a number or a series; also of numbers that are not positive."""
    product: Entry = 1.0
    for _ in range(exponent):
        product = x * product
    return product
