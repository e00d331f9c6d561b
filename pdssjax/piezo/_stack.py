"""A stack put together of dynamics and ceramic: what all stacks with hysteresis or creep do.

`composed` tells the equations; a stack says which mechanics it has and which numbers its ceramic.
"""

import abc
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core import Scalar, ScalarLike
from ..drive.base import Segment, Voltage
from ..integration import N, Term
from ._ceramic import Ceramic, Elements, Layout, Parts, joined
from ._dynamics import AbstractDynamics, Modal, Mode, Static
from ._on_lines import (
    CeramicArrays,
    Line,
    Moment,
    advanced,
    begins_of_lines,
    inside_lines,
    lines_a_segment,
    place_among_lines,
    straightened,
)
from .base import AbstractPiezo, State, Terms, slew_sign


class History(NamedTuple):
    """What a stack went through before t = 0."""

    rest: ScalarLike = 0.0
    """Voltage at which it had long rested [V]."""
    peak: ScalarLike = 0.0
    """Voltage to which it had been driven before that, from 0 V [V]."""
    left_to_creep: tuple[ScalarLike, ...] = ()
    """What each element of creep is ahead of that rest [m]; none: nothing."""


def oscillator(frequency: ScalarLike, damping: ScalarLike, mass: ScalarLike) -> Modal:
    """Mechanics of one second-order system: w [rad/s], xi [1], moving mass m_g [kg]."""
    return Modal((Mode(1.0, frequency, damping, mass),))


class AbstractStack(AbstractPiezo):
    """The mechanics' states, the voltage [V], then the elements' and those of creep; then flags."""

    has_steady_state = False

    @property
    @abc.abstractmethod
    def dynamics(self) -> AbstractDynamics:
        """The mechanics, with their numbers."""

    @property
    @abc.abstractmethod
    def ceramic(self) -> Ceramic:
        """Polynomial, hysteresis and creep, with their numbers."""

    @property
    def history(self) -> History:
        """What it went through before t = 0: nothing, unless a stack tells."""
        return History()

    @property
    def _is_static(self) -> bool:
        """The platform follows the ceramic at once, and its velocity the slope of the voltage."""
        return isinstance(self.dynamics, Static)

    def initial(self) -> State:
        ceramic, history, zero = self.ceramic, self.history, jnp.zeros(())
        law, rest, peak = ceramic.hysteresis, history.rest + zero, history.peak
        stops = law.driven(law.driven((zero,) * law.count, peak), rest - peak)
        left = history.left_to_creep or (0.0,) * len(ceramic.shares)
        crept = tuple(k * rest + d for k, d in zip(ceramic.shares, left, strict=True))
        aim = ceramic.aim(rest, stops, crept)
        flags = tuple(zero + flag for flag in (1.0, *law.first_marks)) if law.count else ()
        slope = zero if self._is_static else None
        return joined(Parts(self.dynamics.initial(aim), rest, slope, stops, crept, flags))

    def rate(self, state: Terms, voltage: Voltage[Term], force: Term) -> Terms:
        ceramic, x = self.ceramic, self._parts(state)
        mechanics = self.dynamics.rates(x.mechanics, ceramic.aim(x.voltage, x.stops, x.crept), force)
        slope = voltage.slope if x.slope is None else x.slope
        bend = None if x.slope is None else voltage.bend + x.slope * 0.0
        flags = tuple(0 for _ in x.flags)
        return joined(Parts(mechanics, slope, bend, ceramic.stop_rates(x, slope), ceramic.creep_rates(x), flags))

    def platform(self, state: tuple[N, ...]) -> tuple[N, N]:
        ceramic, x = self.ceramic, self._parts(state)
        aim = ceramic.aim(x.voltage, x.stops, x.crept)
        speed = aim if x.slope is None else ceramic.aim_rate(x, x.slope)
        return self.dynamics.platform(x.mechanics, aim, speed)

    def acceleration(self, state: Terms, voltage: Voltage[Term]) -> Term:
        ceramic, x = self.ceramic, self._parts(state)
        slope = voltage.slope if x.slope is None else x.slope
        aim, speed = ceramic.aim(x.voltage, x.stops, x.crept), ceramic.aim_rate(x, slope)
        return self.dynamics.acceleration(x.mechanics, aim, speed, ceramic.aim_bend(x, slope, voltage.bend))

    def steady(self, state: State, segment: Segment, t_local: ScalarLike, force: ScalarLike) -> State:
        return state

    def guards(self, state: Terms, voltage: Voltage[Term]) -> Terms:
        x = self._parts(state)
        if not x.flags:
            return ()
        turns = x.voltage * 0.0 + voltage.slope * x.rises
        return turns, *self.ceramic.hysteresis.guards(x.stops, x.rises, x.marks)

    def after_event(self, state: State, voltage: Voltage[Scalar], which: Scalar) -> State:
        x = self._parts(state)
        turned = jnp.where(which == 0, -x.rises, x.rises)
        return joined(x._replace(flags=(turned, *self.ceramic.hysteresis.marks_after(x.marks, which))))

    def on_segment_start(self, state: State, segment: Segment) -> State:
        x, law = self._parts(state), self.ceramic.hysteresis
        voltage = segment.voltage(0.0)
        stops = law.driven(x.stops, voltage.level - x.voltage)
        slope = None if x.slope is None else voltage.slope + 0.0 * x.slope
        x = x._replace(voltage=voltage.level + 0.0 * x.voltage, slope=slope, stops=stops)
        if not x.flags:
            return joined(x)
        rises = slew_sign(voltage, x.rises)
        return joined(x._replace(flags=(rises, *law.marks_at(stops, rises))))

    def motion(self, state: State, segment: Segment, t_local: ScalarLike, elapsed: ScalarLike) -> State:
        x = self._parts(state)
        line = Line(segment.voltage(t_local).level, jnp.asarray(segment.slope, float))
        end = advanced(self._arrays(), self.dynamics, line, self._moment(x), elapsed)
        return self._state_at(end, line.start + line.slope * elapsed, line.slope)

    def states_on_lines(
        self, segments: Segment, places: Int[Array, " m"], t_local: Float[Array, " m"]
    ) -> tuple[Float[Array, " m"], ...]:
        ceramic, dynamics, x = self._arrays(), self.dynamics, self._parts(self.initial())
        now = jax.vmap(Segment.voltage)(jax.tree.map(lambda array: array[places], segments), t_local)
        if segments.wave is not None:
            many = lines_a_segment(segments.start.size)
            places, t_local = place_among_lines(segments, places, t_local, many)
            segments = straightened(segments, many)
        lines = Line(segments.start, segments.slope)
        durations = jnp.where(jnp.isfinite(segments.duration), segments.duration, 0.0)
        begins = begins_of_lines(ceramic, dynamics, lines, durations, x.voltage, self._moment(x))
        here, line = (jax.tree.map(lambda array: array[places], tree) for tree in (begins, lines))
        moments = inside_lines(ceramic, dynamics, line, here, t_local)
        return jax.vmap(self._state_at)(moments, now.level, now.slope)

    def error_scale(self) -> State:
        metre, volt, mechanics = jnp.ones(()), self.static_gain(), self.dynamics.scales()
        slope = volt / self.frequency_scale() if self._is_static else None
        has = self._layout()
        return joined(Parts(mechanics, volt, slope, (volt,) * has.stops, (metre,) * has.crept, (metre,) * has.flags))

    def static_gain(self) -> Scalar:
        ceramic = self.ceramic
        return jnp.asarray(sum(ceramic.hysteresis.weights, ceramic.memoryless[0]), float)

    def frequency_scale(self) -> Scalar:
        return self.dynamics.frequency_scale()

    def _arrays(self) -> CeramicArrays:
        ceramic = self.ceramic
        law = ceramic.hysteresis
        thresholds = law.thresholds if isinstance(law, Elements) else ()
        arrays = (law.weights, thresholds, ceramic.shares, ceramic.times)
        return CeramicArrays(ceramic.memoryless, *(jnp.asarray(numbers, float) for numbers in arrays))

    def _moment(self, x: Parts[Any]) -> Moment:
        return Moment(*(jnp.asarray(numbers, float) for numbers in (x.mechanics, x.stops, x.crept)))

    def _state_at(self, moment: Moment, voltage: Scalar, slope: Scalar) -> State:
        """The state at a moment within a line."""
        flags: tuple[Scalar, ...] = ()
        stops = tuple(moment.stops)
        if stops:
            rises = jnp.where(slope < 0.0, -1.0, 1.0)
            flags = (rises, *self.ceramic.hysteresis.marks_at(stops, rises))
        rate = slope if self._is_static else None
        return joined(Parts(tuple(moment.mechanics), voltage, rate, stops, tuple(moment.crept), flags))

    def _layout(self) -> Layout:
        ceramic = self.ceramic
        return Layout(len(self.dynamics.scales()), int(self._is_static), ceramic.hysteresis.count, len(ceramic.shares))

    def _parts(self, state: tuple[N, ...]) -> Parts[Any]:
        return self._layout().split(state)
