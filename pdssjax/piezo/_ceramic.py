"""The aim of a composed stack: the displacement that the voltage would give at rest, and its rates.

It is the sum of a polynomial of the voltage, of what follows it with hysteresis, and of creep; `composed` tells the
equation.  The states of a law of hysteresis, its stops, are how far the voltage is ahead of each element [V].  Within a
mode they are smooth; each stop has a flag, a mark, of the mode it is in.
"""

import abc
from typing import Any, Generic, NamedTuple, TypeAlias

import equinox as eqx
import jax.numpy as jnp

from ..core import Scalar, ScalarLike
from ..integration import N, N_co

Entry: TypeAlias = Any
"""An entry of a state, or its rate: a number or a series.  Both go through the same functions, mixed, the flags of a
series being numbers, and a result is of the kind of what it is made of, which no type variable says."""

Entries: TypeAlias = tuple[Entry, ...]
"""Entries of one part of a state."""


class Parts(NamedTuple, Generic[N_co]):
    """The state of a composed stack in words."""

    mechanics: tuple[N_co, ...]
    """States of the dynamics."""
    voltage: N_co
    """The voltage [V]."""
    slope: N_co | None
    """Slope of the voltage [V/s]; None where no velocity depends on it."""
    stops: tuple[N_co, ...]
    """States of hysteresis: how far the voltage is ahead of each element [V]; h of Bouc and Wen."""
    crept: tuple[N_co, ...]
    """Displacement by each element of creep [m]."""
    flags: tuple[N_co, ...]
    """The sign of the voltage's rate; then one a stop, what its law of hysteresis knows of it."""

    @property
    def rises(self) -> Entry:
        """1 where the voltage rises, -1 where it falls; 0 where there is no hysteresis to know it."""
        return self.flags[0] if self.flags else 0.0

    @property
    def marks(self) -> Entries:
        """The flags of the stops."""
        return self.flags[1:]


class Layout(NamedTuple):
    """How many numbers each part of the state has."""

    mechanics: int
    slope: int
    stops: int
    crept: int

    @property
    def flags(self) -> int:
        """None without hysteresis."""
        return 1 + self.stops if self.stops else 0

    def split(self, state: tuple[N, ...]) -> Parts[Entry]:
        """The parts of a state."""
        left = list(state)
        found = []
        for count in (self.mechanics, 1, self.slope, self.stops, self.crept, self.flags):
            found.append(tuple(left[:count]))
            del left[:count]
        mechanics, voltage, slope, stops, crept, flags = found
        return Parts(mechanics, voltage[0], slope[0] if slope else None, stops, crept, flags)


def joined(x: Parts[Entry]) -> Entries:
    """The state that has these parts."""
    slope = () if x.slope is None else (x.slope,)
    return (*x.mechanics, x.voltage, *slope, *x.stops, *x.crept, *x.flags)


def after_jump(h: Scalar, change: ScalarLike, slope: ScalarLike, beta: ScalarLike, gamma: ScalarLike) -> Scalar:
    """h after the voltage has run a way of `change` [V]: unloading until h vanishes, loading then.

    **Arguments:** `slope` is dh/du where h vanishes; on a branch dh = (slope - (beta +- gamma) h) du.
    """
    side = jnp.where(change < 0.0, -1.0, 1.0)
    # Not |change|, which JAX gives no slope at 0, nor below a minimum of two zeros, which it halves: a stack begins so.
    path, ahead = side * change, side * h
    unloads, loads = beta - gamma, beta + gamma
    behind = jnp.minimum(ahead, 0.0)
    # The way on which the unloading branch reaches h = 0; it may never.
    growth = -behind * unloads / jnp.where(slope > 0.0, slope, 1.0)
    far = jnp.where((growth > -1.0) & (slope > 0.0), -behind / jnp.where(slope > 0.0, slope, 1.0), jnp.inf)
    way = jnp.where(jnp.isfinite(far), jnp.where(jnp.isfinite(far), far, 0.0) * _log_ratio(growth), jnp.inf)
    first = jnp.where(ahead < 0.0, jnp.minimum(way, path), 0.0)
    remainder = path - first
    unloaded = jnp.where(first < way, _branch(behind, slope, unloads, first), 0.0)
    begun = jnp.where(ahead < 0.0, unloaded, ahead)
    return side * _branch(begun, slope, loads, remainder)


def _branch(h: Scalar, slope: ScalarLike, rate: ScalarLike, path: Scalar) -> Scalar:
    """h after a way of `path` [V] with dh = (slope - rate h) du."""
    x = rate * path
    safe = jnp.where(jnp.abs(x) < 1e-5, 1.0, x)
    part = jnp.where(jnp.abs(x) < 1e-5, 1.0 - x * (0.5 - x / 6.0), -jnp.expm1(-safe) / safe)
    return h + (slope - rate * h) * path * part


def _log_ratio(x: Scalar) -> Scalar:
    """log(1 + x) / x; for x > -1."""
    near = jnp.abs(x) < 1e-5
    safe = jnp.where(near | (x <= -1.0), 1.0, x)
    return jnp.where(near, 1.0 - x * (0.5 - x / 3.0), jnp.log1p(safe) / safe)


_ROUNDING = 1e-12
"""Part of its threshold by which an element that slips may seem short of it."""


class AbstractHysteresis(eqx.Module):
    """How the stops follow the voltage; `rises` is 1 where it rises, -1 where it falls."""

    weights: eqx.AbstractVar[tuple[ScalarLike, ...]]
    """Displacement per volt of what follows [m/V], one a stop."""

    @property
    def count(self) -> int:
        """How many stops there are."""
        return len(self.weights)

    @property
    @abc.abstractmethod
    def first_marks(self) -> tuple[float, ...]:
        """Marks where the stack has long rested."""

    @abc.abstractmethod
    def driven(self, stops: tuple[Scalar, ...], change: ScalarLike) -> tuple[Scalar, ...]:
        """The stops after the voltage has run a way of `change` [V]."""

    @abc.abstractmethod
    def rates(self, stops: Entries, rises: Entry, marks: Entries, slope: Entry) -> Entries:
        """Time derivatives of the stops [V/s] under a voltage of this `slope` [V/s]."""

    @abc.abstractmethod
    def bends(self, stops: Entries, rises: Entry, marks: Entries, slope: Entry, bend: Entry) -> Entries:
        """Second derivatives of the stops [V/s2]; `bend` [V/s2] is that of the voltage."""

    @abc.abstractmethod
    def guards(self, stops: Entries, rises: Entry, marks: Entries) -> Entries:
        """Positive while each stop keeps its mark."""

    @abc.abstractmethod
    def marks_after(self, marks: tuple[Scalar, ...], which: Scalar) -> tuple[Scalar, ...]:
        """The marks after an event: 0, the voltage has turned; j, the guard of stop j has fallen through zero."""

    @abc.abstractmethod
    def marks_at(self, stops: tuple[Scalar, ...], rises: Scalar) -> tuple[Scalar, ...]:
        """The marks of stops on a voltage that begins to rise or to fall."""


class Elements(AbstractHysteresis):
    """Elements of play or of Maxwell slip, any number, also none: a mark of 1 slips, of 0 follows the voltage."""

    weights: tuple[ScalarLike, ...] = ()
    thresholds: tuple[ScalarLike, ...] = ()
    """Where each begins to slip [V]."""

    @property
    def first_marks(self) -> tuple[float, ...]:
        return (0.0,) * self.count

    def driven(self, stops: tuple[Scalar, ...], change: ScalarLike) -> tuple[Scalar, ...]:
        return tuple(jnp.clip(s + change, -r, r) for s, r in zip(stops, self.thresholds, strict=True))

    def rates(self, stops: Entries, rises: Entry, marks: Entries, slope: Entry) -> Entries:
        return tuple(slope * (1.0 - slip) for slip in marks)

    def bends(self, stops: Entries, rises: Entry, marks: Entries, slope: Entry, bend: Entry) -> Entries:
        return tuple((1.0 - slip) * bend for slip in marks)

    def guards(self, stops: Entries, rises: Entry, marks: Entries) -> Entries:
        elements = zip(stops, marks, self.thresholds, strict=True)
        return tuple((r - s * rises) * (1.0 - slip) + slip for s, slip, r in elements)

    def marks_after(self, marks: tuple[Scalar, ...], which: Scalar) -> tuple[Scalar, ...]:
        # As the voltage turns, all follow it again.
        turns = which == 0
        return tuple(jnp.where(turns, 0.0, jnp.where(which == j, 1.0, m)) for j, m in enumerate(marks, start=1))

    def marks_at(self, stops: tuple[Scalar, ...], rises: Scalar) -> tuple[Scalar, ...]:
        elements = zip(stops, self.thresholds, strict=True)
        return tuple(jnp.where(rises * s >= r * (1.0 - _ROUNDING), 1.0, 0.0) for s, r in elements)


class BoucWen(AbstractHysteresis):
    """One stop, h of Bouc and Wen; its mark is its sign."""

    weights: tuple[ScalarLike, ...]
    beta: ScalarLike
    """[1/V]"""
    gamma: ScalarLike
    """[1/V]"""

    @property
    def first_marks(self) -> tuple[float, ...]:
        return (1.0,)

    def driven(self, stops: tuple[Scalar, ...], change: ScalarLike) -> tuple[Scalar, ...]:
        return (after_jump(stops[0], change, 1.0, self.beta, self.gamma),)

    def rates(self, stops: Entries, rises: Entry, marks: Entries, slope: Entry) -> Entries:
        return (slope - slope * stops[0] * self._decay(rises, marks),)

    def bends(self, stops: Entries, rises: Entry, marks: Entries, slope: Entry, bend: Entry) -> Entries:
        (rate,) = self.rates(stops, rises, marks, slope)
        return (bend - (stops[0] * bend + slope * rate) * self._decay(rises, marks),)

    def guards(self, stops: Entries, rises: Entry, marks: Entries) -> Entries:
        return (stops[0] * marks[0],)

    def marks_after(self, marks: tuple[Scalar, ...], which: Scalar) -> tuple[Scalar, ...]:
        return (jnp.where(which == 1, -marks[0], marks[0]),)

    def marks_at(self, stops: tuple[Scalar, ...], rises: Scalar) -> tuple[Scalar, ...]:
        h = stops[0]
        return (jnp.where(h == 0.0, rises, jnp.where(h > 0.0, 1.0, -1.0)),)

    def _decay(self, rises: Entry, marks: Entries) -> Entry:
        """Decay rate of h along the path of the voltage [1/V], signed as its slope."""
        return rises * self.beta + marks[0] * self.gamma


class Ceramic(NamedTuple):
    """The numbers of polynomial, hysteresis and creep."""

    memoryless: tuple[ScalarLike, ...]
    """Coefficients of the voltage, its square, ... [m/V], [m/V^2], ..."""
    hysteresis: AbstractHysteresis
    shares: tuple[ScalarLike, ...]
    """Gain of each element of creep [m/V]."""
    times: tuple[ScalarLike, ...]
    """Time constant of each element of creep [s]."""

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
        """Time derivative of the aim [m/s] under a voltage of this `slope` [V/s]."""
        gain, *curves = self.memoryless
        total = slope * gain
        for k, curve in enumerate(curves, start=2):
            total = total + _power(x.voltage, k - 1) * slope * (k * curve)
        for rate, weight in zip(self.stop_rates(x, slope), self.hysteresis.weights, strict=True):
            total = total + (slope - rate) * weight
        return sum(self.creep_rates(x), total)

    def aim_bend(self, x: Parts[Entry], slope: Entry, bend: Entry) -> Entry:
        """The rate of its rate [m/s2], while that of the voltage's is `bend` [V/s2]."""
        gain, *curves = self.memoryless
        total = x.voltage * 0.0 + bend * gain
        for k, curve in enumerate(curves, start=2):
            total = total + slope * slope * _power(x.voltage, k - 2) * ((k - 1) * k * curve)
            total = total + _power(x.voltage, k - 1) * bend * (k * curve)
        bends = self.hysteresis.bends(x.stops, x.rises, x.marks, slope, bend)
        for rate, weight in zip(bends, self.hysteresis.weights, strict=True):
            total = total + (bend - rate) * weight
        for rate, share, time in zip(self.creep_rates(x), self.shares, self.times, strict=True):
            total = total + (slope * share - rate) * (1.0 / time)
        return total

    def stop_rates(self, x: Parts[Entry], slope: Entry) -> Entries:
        """Time derivatives of the elements of hysteresis [V/s]."""
        return self.hysteresis.rates(x.stops, x.rises, x.marks, slope)

    def creep_rates(self, x: Parts[Entry]) -> Entries:
        """Time derivatives of the elements of creep [m/s]."""
        elements = zip(x.crept, self.shares, self.times, strict=True)
        return tuple((x.voltage * share - c) * (1.0 / time) for c, share, time in elements)


def _power(x: Entry, exponent: int) -> Entry:
    """x to a whole power from 0 on, a number or a series; also of numbers that are not positive."""
    product: Entry = 1.0
    for _ in range(exponent):
        product = x * product
    return product
