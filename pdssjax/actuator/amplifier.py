"""The amplifier between the command and the piezo: first-order bandwidth and slew limit.

    u' = w_a (command - u), but never faster than the slew rate.

Its state is the voltage u and a flag: 0 while it follows, +1 or -1 while it slews.
"""

import jax.numpy as jnp

from ..core import AbstractModel, Scalar, ScalarLike, quantity
from ..drive.base import Segment, Voltage
from ..integration import Term


class Amplifier(AbstractModel):
    """A voltage amplifier of finite bandwidth and slew rate."""

    bandwidth: float = quantity(5e3, "Hz", optional=True)
    """Frequency at which a small signal is down by 3 dB [Hz]."""
    slew: float = quantity(1e9, "V/s", optional=True)
    """Largest rate of the output [V/s]."""

    def initial(self) -> tuple[Scalar, ...]:
        """The state at rest: the output [V], and 0 while it follows, 1 or -1 while it slews."""
        return jnp.zeros(()), jnp.zeros(())

    def rate(self, state: tuple[Term, ...], command: Voltage[Term]) -> tuple[Term, ...]:
        """Time derivative of the state [V/s]."""
        u, slews = state
        follows = 1.0 - slews * slews
        return (command.level - u) * (self.pole() * follows) + slews * self.slew, 0

    def output(self, state: tuple[Term, ...], command: Voltage[Term]) -> Voltage[Term]:
        """The voltage on the piezo; numbers or series."""
        slope, _ = self.rate(state, command)
        follows = 1.0 - state[1] * state[1]
        return Voltage(state[0], slope, (command.slope - slope) * (self.pole() * follows))

    def on_segment_start(self, state: tuple[Scalar, ...], segment: Segment) -> tuple[Scalar, ...]:
        """The state just after the corner that opens `segment`, where the command may jump."""
        u, _ = state
        wanted = self.pole() * (segment.voltage(0.0).level - u)
        return u, jnp.where(jnp.abs(wanted) > self.slew, jnp.sign(wanted), 0.0)

    def guards(self, state: tuple[Term, ...], command: Voltage[Term]) -> tuple[Term, ...]:
        """Positive while the amplifier goes on following, or slewing."""
        u, slews = state
        wanted = (command.level - u) * self.pole()
        limited = slews * slews
        follows = 1.0 - limited
        upper = (self.slew - wanted) * follows + (slews * wanted - self.slew) * limited
        return upper, (self.slew + wanted) * follows + limited

    def after_event(self, state: tuple[Scalar, ...], which: Scalar) -> tuple[Scalar, ...]:
        """The state just after `guards(...)[which]` has fallen through zero."""
        u, slews = state
        return u, jnp.where(slews != 0.0, 0.0, jnp.where(which == 0, 1.0, -1.0))

    def steady(self, segment: Segment) -> Segment:
        """What the piezo gets of a straight segment in the end: the same, later."""
        return segment._replace(start=segment.start - segment.slope * (1.0 / self.pole()))

    def pole(self) -> ScalarLike:
        """Angular corner frequency w_a [rad/s]."""
        return 2.0 * jnp.pi * self.bandwidth
