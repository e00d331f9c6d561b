"""Laws of hysteresis of a composed stack: voltages that follow the one applied, and stop.

`composed` tells their equations.  The states of a law, its stops, are how far the voltage is ahead of each element
[V].  Within a mode they are smooth; each stop has a flag, a mark, of the mode it is in.
"""

import abc

import equinox as eqx
import jax.numpy as jnp

from ..core import Scalar, ScalarLike
from ._bouc_wen_path import after_jump
from ._composed_state import Entry

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
    def rates(
        self, stops: tuple[Entry, ...], rises: Entry, marks: tuple[Entry, ...], slope: Entry
    ) -> tuple[Entry, ...]:
        """Time derivatives of the stops [V/s] under a voltage of this `slope` [V/s]."""

    @abc.abstractmethod
    def bends(
        self, stops: tuple[Entry, ...], rises: Entry, marks: tuple[Entry, ...], slope: Entry, bend: Entry
    ) -> tuple[Entry, ...]:
        """Second derivatives of the stops [V/s2]; `bend` [V/s2] is that of the voltage."""

    @abc.abstractmethod
    def guards(self, stops: tuple[Entry, ...], rises: Entry, marks: tuple[Entry, ...]) -> tuple[Entry, ...]:
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

    def rates(
        self, stops: tuple[Entry, ...], rises: Entry, marks: tuple[Entry, ...], slope: Entry
    ) -> tuple[Entry, ...]:
        return tuple(slope * (1.0 - slip) for slip in marks)

    def bends(
        self, stops: tuple[Entry, ...], rises: Entry, marks: tuple[Entry, ...], slope: Entry, bend: Entry
    ) -> tuple[Entry, ...]:
        return tuple((1.0 - slip) * bend for slip in marks)

    def guards(self, stops: tuple[Entry, ...], rises: Entry, marks: tuple[Entry, ...]) -> tuple[Entry, ...]:
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

    def rates(
        self, stops: tuple[Entry, ...], rises: Entry, marks: tuple[Entry, ...], slope: Entry
    ) -> tuple[Entry, ...]:
        return (slope - slope * stops[0] * self._decay(rises, marks),)

    def bends(
        self, stops: tuple[Entry, ...], rises: Entry, marks: tuple[Entry, ...], slope: Entry, bend: Entry
    ) -> tuple[Entry, ...]:
        (rate,) = self.rates(stops, rises, marks, slope)
        return (bend - (stops[0] * bend + slope * rate) * self._decay(rises, marks),)

    def guards(self, stops: tuple[Entry, ...], rises: Entry, marks: tuple[Entry, ...]) -> tuple[Entry, ...]:
        return (stops[0] * marks[0],)

    def marks_after(self, marks: tuple[Scalar, ...], which: Scalar) -> tuple[Scalar, ...]:
        return (jnp.where(which == 1, -marks[0], marks[0]),)

    def marks_at(self, stops: tuple[Scalar, ...], rises: Scalar) -> tuple[Scalar, ...]:
        h = stops[0]
        return (jnp.where(h == 0.0, rises, jnp.where(h > 0.0, 1.0, -1.0)),)

    def _decay(self, rises: Entry, marks: tuple[Entry, ...]) -> Entry:
        """Of h along the path of the voltage [1/V], signed as its slope."""
        return rises * self.beta + marks[0] * self.gamma
