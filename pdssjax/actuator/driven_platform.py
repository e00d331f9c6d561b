"""Amplifier and piezo together: the command to the motion of the platform."""

from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp

from .amplifier import Amplifier
from .drive.base import Segment, Voltage
from .piezo.base import AbstractPiezo
from .series import weighted


class Driven(NamedTuple):
    """State of the driven platform: that of the piezo, and of the amplifier if there is one."""

    stack: tuple
    supply: tuple


class Stage(eqx.Module):
    """A piezo with its platform, behind an amplifier or straight on the command."""

    piezo: AbstractPiezo
    amplifier: Amplifier | None = None

    @property
    def closed(self) -> bool:
        """The motion is known in closed form while no force acts on the platform."""
        return self.piezo.closed and self.amplifier is None

    @property
    def jumps(self) -> bool:
        """The state of the piezo may jump at the corners of the drive."""
        return type(self.piezo).entered is not AbstractPiezo.entered

    def initial(self) -> Driven:
        supply = () if self.amplifier is None else self.amplifier.initial()
        return Driven(self.piezo.initial(), supply)

    def length(self) -> Driven:
        """Displacement [m] that one unit of each state stands for."""
        supply = () if self.amplifier is None else (self.piezo.per_volt(), jnp.ones(()))
        return Driven(self.piezo.length(), supply)

    def voltage(self, segment: Segment, after, x: Driven) -> Voltage:
        """The voltage on the piezo; numbers or series."""
        command = segment.voltage(after)
        return command if self.amplifier is None else self.amplifier.output(x.supply, command)

    def rate(self, segment: Segment, after, x: Driven, force, active) -> Driven:
        """Time derivative under `force` [N] on the platform; the steady creep where `active` is 0."""
        stack = self.piezo.rate(x.stack, self.voltage(segment, after, x), force)
        if self.piezo.settles:
            stack = tuple(rate if i % 2 == 0 else weighted(rate, active) for i, rate in enumerate(stack))
        if self.amplifier is None:
            return Driven(stack, ())
        slope, none = self.amplifier.rate(x.supply, segment.voltage(after))
        return Driven(stack, (slope * active + segment.slope * (1.0 - active), none))

    def platform(self, x: Driven) -> tuple[Any, Any]:
        """Displacement [m] and velocity [m/s]."""
        return self.piezo.platform(x.stack)

    def acceleration(self, segment: Segment, after, x: Driven):
        """y'' [m/s2] without a force on the platform."""
        return self.piezo.acceleration(x.stack, self.voltage(segment, after, x))

    def entered(self, segment: Segment, x: Driven) -> Driven:
        """The state just after the corner that opens `segment`."""
        if self.amplifier is None:
            return x._replace(stack=self.piezo.entered(x.stack, segment))
        x = x._replace(supply=self.amplifier.entered(x.supply, segment))
        # Behind an amplifier the voltage does not jump, but its rate may, and change its sign.
        fed = self.voltage(segment, 0.0, x)
        return x._replace(stack=self.piezo.entered(x.stack, Segment(segment.duration, fed.level, fed.slope)))

    def guards(self, segment: Segment, after, x: Driven) -> tuple:
        """Positive while piezo and amplifier keep their form: first the piezo's guards."""
        own = self.piezo.guards(x.stack, self.voltage(segment, after, x))
        return own if self.amplifier is None else (*own, *self.amplifier.guards(x.supply, segment.voltage(after)))

    def passed(self, segment: Segment, after, x: Driven, which) -> Driven:
        """The state just after `guards(...)[which]` has fallen through zero; `x` for others."""
        voltage = self.voltage(segment, after, x)
        own = len(self.piezo.guards(x.stack, voltage))
        stack, supply = x
        if own:
            stack = chosen((which >= 0) & (which < own), self.piezo.passed(stack, voltage, which), stack)
        if self.amplifier is not None:
            supply = chosen(which >= own, self.amplifier.passed(supply, which - own), supply)
        return Driven(stack, supply)

    def steady(self, segment: Segment, after, x: Driven, force) -> Driven:
        """What the state tends to on a straight segment."""
        if self.amplifier is None:
            return Driven(self.piezo.steady(x.stack, segment, after, force), ())
        fed = self.amplifier.steady(segment)
        stack = self.piezo.steady(x.stack, fed, after, force)
        return Driven(stack, (fed.start + fed.slope * after, jnp.zeros(())))

    def ringing(self, segment: Segment, after, x: Driven, force):
        """How far [m] the platform is from its steady motion; infinite where there is none."""
        if segment.wave is not None or not self.piezo.settles:
            return jnp.asarray(jnp.inf)
        away = [
            jnp.abs(a - b) * unit
            for x, steady, lengths in zip(x, self.steady(segment, after, x, force), self.length(), strict=True)
            for a, b, unit in zip(x, steady, lengths, strict=True)
        ]
        return jnp.stack(away).max()

    def motion(self, segment: Segment, after, x: Driven, lapse) -> Driven:
        """Where `closed`: the exact state `lapse` [s] later."""
        return Driven(self.piezo.motion(x.stack, segment, after, lapse), x.supply)


def chosen(condition, new: tuple, old: tuple) -> tuple:
    """`new` where the condition holds, else `old`."""
    return tuple(jnp.where(condition, a, b) for a, b in zip(new, old, strict=True))
