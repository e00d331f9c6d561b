"""Amplifier and piezo together: the command to the motion of the platform."""

from typing import Generic, NamedTuple, overload

import equinox as eqx
import jax.numpy as jnp

from ..core import Scalar, ScalarLike, Truth
from ..drive.base import Segment, Voltage
from ..integration import N, N_co, Term, weighted
from ..piezo.base import AbstractPiezo
from .parts import Amplifier


class DrivenPlatformState(NamedTuple, Generic[N_co]):
    """State of the driven platform: that of the piezo, and of the amplifier if there is one."""

    stack: tuple[N_co, ...]
    supply: tuple[N_co, ...]


class DrivenPlatform(eqx.Module):
    """A piezo with its platform, behind an amplifier or straight on the command."""

    piezo: AbstractPiezo
    amplifier: Amplifier | None = None

    @property
    def closed(self) -> bool:
        """Whether the motion is known in closed form while no force acts on the platform."""
        return self.piezo.closed and self.amplifier is None

    @property
    def closed_on_lines(self) -> bool:
        """Whether the motion is known in closed form under a chain of straight lines, while no force acts."""
        return self.piezo.closed_on_lines and self.amplifier is None

    @property
    def state_jumps(self) -> bool:
        """Whether the state of the piezo may jump at the corners of the drive."""
        return type(self.piezo).on_segment_start is not AbstractPiezo.on_segment_start

    def initial(self) -> DrivenPlatformState[Scalar]:
        supply = () if self.amplifier is None else self.amplifier.initial()
        return DrivenPlatformState(self.piezo.initial(), supply)

    def error_scale(self) -> DrivenPlatformState[Scalar]:
        """Displacement [m] that one unit of each state stands for."""
        supply = () if self.amplifier is None else (self.piezo.static_gain(), jnp.ones(()))
        return DrivenPlatformState(self.piezo.error_scale(), supply)

    @overload
    def voltage(self, segment: Segment, t_local: ScalarLike, x: DrivenPlatformState[Scalar]) -> Voltage[Scalar]: ...
    @overload
    def voltage(self, segment: Segment, t_local: Term, x: DrivenPlatformState[Term]) -> Voltage[Term]: ...
    def voltage(self, segment: Segment, t_local: Term, x: DrivenPlatformState[Term]) -> Voltage[Term]:
        """The voltage on the piezo; numbers or series."""
        command = segment.voltage(t_local)
        return command if self.amplifier is None else self.amplifier.output(x.supply, command)

    def rate(
        self, segment: Segment, t_local: Term, x: DrivenPlatformState[Term], force: Term, active: ScalarLike
    ) -> DrivenPlatformState[Term]:
        """Time derivative under `force` [N] on the platform; the steady creep where `active` is 0."""
        stack = self.piezo.rate(x.stack, self.voltage(segment, t_local, x), force)
        if self.piezo.has_steady_state:
            stack = tuple(rate if i % 2 == 0 else weighted(rate, active) for i, rate in enumerate(stack))
        if self.amplifier is None:
            return DrivenPlatformState(stack, ())
        slope, none = self.amplifier.rate(x.supply, segment.voltage(t_local))
        return DrivenPlatformState(stack, (slope * active + segment.slope * (1.0 - active), none))

    def platform(self, x: DrivenPlatformState[N]) -> tuple[N, N]:
        """Displacement [m] and velocity [m/s]."""
        return self.piezo.platform(x.stack)

    def acceleration(self, segment: Segment, t_local: Term, x: DrivenPlatformState[Term]) -> Term:
        """y'' [m/s2] without a force on the platform."""
        return self.piezo.acceleration(x.stack, self.voltage(segment, t_local, x))

    def on_segment_start(self, segment: Segment, x: DrivenPlatformState[Scalar]) -> DrivenPlatformState[Scalar]:
        """The state just after the corner that opens `segment`."""
        if self.amplifier is None:
            return x._replace(stack=self.piezo.on_segment_start(x.stack, segment))
        x = x._replace(supply=self.amplifier.on_segment_start(x.supply, segment))
        # Behind an amplifier the voltage does not jump, but its rate may, and change its sign.
        fed = self.voltage(segment, 0.0, x)
        return x._replace(stack=self.piezo.on_segment_start(x.stack, Segment(segment.duration, fed.level, fed.slope)))

    def guards(self, segment: Segment, t_local: Term, x: DrivenPlatformState[Term]) -> tuple[Term, ...]:
        """Positive while piezo and amplifier keep their form: first the piezo's guards."""
        piezo_guards = self.piezo.guards(x.stack, self.voltage(segment, t_local, x))
        return (
            piezo_guards
            if self.amplifier is None
            else (*piezo_guards, *self.amplifier.guards(x.supply, segment.voltage(t_local)))
        )

    def after_event(
        self, segment: Segment, t_local: ScalarLike, x: DrivenPlatformState[Scalar], which: Scalar
    ) -> DrivenPlatformState[Scalar]:
        """The state just after `guards(...)[which]` has fallen through zero; `x` for others."""
        voltage, guards = self.voltage(segment, t_local, x), len(self.guards(segment, t_local, x))
        of_piezo = len(self.piezo.guards(x.stack, voltage))
        stack, supply = x
        if of_piezo:
            stack = chosen((which >= 0) & (which < of_piezo), self.piezo.after_event(stack, voltage, which), stack)
        if self.amplifier is not None:
            ends = (which >= of_piezo) & (which < guards)
            supply = chosen(ends, self.amplifier.after_event(supply, which - of_piezo), supply)
        return DrivenPlatformState(stack, supply)

    def is_small_event(self, slope: Scalar, which: Scalar, amplitude: float) -> Truth:
        """Whether an event of the piezo with this `slope` of its guard comes from a voltage at rest.

        The voltage then moves the stack by less than `amplitude` [m] in a time constant.

        An amplifier's output tends to the peak of a flank, where an element that slipped there before returns to its
        threshold just so, and the voltage turns at no time that means anything.  By `AbstractPiezo.guards` the first
        one is the slope of the voltage, the others are voltages.
        """
        if self.amplifier is None:
            return jnp.zeros((), bool)
        rate = self.piezo.frequency_scale()
        moved = jnp.abs(slope) * self.piezo.static_gain() / jnp.where(which == 0, rate, 1.0)
        count = len(self.piezo.guards(self.piezo.initial(), Voltage(0.0, 0.0, 0.0)))
        return (which >= 0) & (which < count) & (moved < amplitude * rate)

    def steady(
        self, segment: Segment, t_local: ScalarLike, x: DrivenPlatformState[Scalar], force: ScalarLike
    ) -> DrivenPlatformState[Scalar]:
        """The state that the motion tends to on a straight segment."""
        if self.amplifier is None:
            return DrivenPlatformState(self.piezo.steady(x.stack, segment, t_local, force), ())
        fed = self.amplifier.steady(segment)
        stack = self.piezo.steady(x.stack, fed, t_local, force)
        return DrivenPlatformState(stack, (fed.start + fed.slope * t_local, jnp.zeros(())))

    def ringing(
        self, segment: Segment, t_local: ScalarLike, x: DrivenPlatformState[Scalar], force: ScalarLike
    ) -> Scalar:
        """How far [m] the platform is from its steady motion; infinite where there is none."""
        if segment.wave is not None or not self.piezo.has_steady_state:
            return jnp.asarray(jnp.inf)
        away = [
            jnp.abs(a - b) * unit
            for x, steady, lengths in zip(x, self.steady(segment, t_local, x, force), self.error_scale(), strict=True)
            for a, b, unit in zip(x, steady, lengths, strict=True)
        ]
        return jnp.stack(away).max()

    def motion(
        self, segment: Segment, t_local: ScalarLike, x: DrivenPlatformState[Scalar], elapsed: ScalarLike
    ) -> DrivenPlatformState[Scalar]:
        """Where `closed`: the exact state `elapsed` [s] later."""
        return DrivenPlatformState(self.piezo.motion(x.stack, segment, t_local, elapsed), x.supply)


def chosen(condition: Truth, new: tuple[Scalar, ...], old: tuple[Scalar, ...]) -> tuple[Scalar, ...]:
    """`new` where the condition holds, else `old`."""
    return tuple(jnp.where(condition, a, b) for a, b in zip(new, old, strict=True))
