"""A stack and platform without dynamics (1.1, 1.2): the platform is where the voltage puts it.

    y = C u

For voltages so slow that nothing rings.  A jump of the voltage would move the platform at
once, with an acceleration that knows no bound: what an end-effector then does is not told by
this model.  Nor does a force move the platform, so friction does not act back on it.
"""

from typing import ClassVar

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..drive.base import Segment, Voltage
from ..integration import N, Term
from .base import AbstractPiezo, State, Terms

_FAST = 1e4
"""Angular frequency [rad/s] that sets the scale between velocity and displacement: that of common stacks."""


class Static(AbstractPiezo):
    """Gain alone; displacement and velocity jump with the voltage and its rate."""

    closed = True
    is_compliant: ClassVar[bool] = False

    gain: float = quantity(1.007e-7, "m/V")
    """Displacement per volt C [m/V]."""

    @property
    def mass(self) -> Scalar:
        """Infinite [kg]: no force moves the platform."""
        return jnp.asarray(jnp.inf)

    def initial(self) -> State:
        return (jnp.zeros(()), jnp.zeros(()))

    def rate(self, state: Terms, voltage: Voltage[Term], force: Term) -> Terms:
        return state[1], self.acceleration(state, voltage)

    def platform(self, state: tuple[N, ...]) -> tuple[N, N]:
        return state[0], state[1]

    def acceleration(self, state: Terms, voltage: Voltage[Term]) -> Term:
        return state[0] * 0.0 + voltage.bend * self.gain

    def steady(self, state: State, segment: Segment, t_local: ScalarLike, force: ScalarLike) -> State:
        return self._at(segment, t_local)

    def motion(self, state: State, segment: Segment, t_local: ScalarLike, elapsed: ScalarLike) -> State:
        return self._at(segment, t_local + elapsed)

    def on_segment_start(self, state: State, segment: Segment) -> State:
        return self._at(segment, 0.0)

    def _at(self, segment: Segment, t_local: ScalarLike) -> State:
        voltage = segment.voltage(t_local)
        return self.gain * voltage.level, self.gain * voltage.slope

    def error_scale(self) -> State:
        return jnp.ones(()), 1.0 / self.frequency_scale()

    def static_gain(self) -> Scalar:
        return jnp.asarray(self.gain, float)

    def frequency_scale(self) -> Scalar:
        return jnp.asarray(_FAST)
