"""Piezo stack and platform as one second-order system (4.2, 5.27-5.29).

    y'' + 2 xi w y' + w^2 y = C w^2 u   [ - F / m_g with friction feedback (5.25) ],

u being the level of the voltage [V].
Its motion is known in closed form on every segment of a drive (`pdssjax.piezo._oscillator`).
"""

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..drive.base import Segment, Voltage
from ..integration import N, Term
from ._oscillator import accelerated, forced, tends_to, underdamped
from .base import AbstractPiezo, State, Terms


class SecondOrder(AbstractPiezo):
    """Gain, natural frequency and damping ratio; underdamped."""

    closed = True

    gain: float = quantity(1.007e-7, "m/V")
    """Steady displacement per volt C [m/V]."""
    natural_frequency: float = quantity(6736.0, "rad/s")
    """Undamped natural frequency w [rad/s]."""
    damping_ratio: float = quantity(0.1772, "", high=1.0)
    """Damping ratio xi [1], below 1."""
    mass: float = quantity(0.56, "kg", optional=True)
    """Moving mass of stack and platform m_g [kg]; only friction feedback (5.25) uses it."""

    def initial(self) -> State:
        return (jnp.zeros(()), jnp.zeros(()))

    def rate(self, state: Terms, voltage: Voltage[Term], force: Term) -> Terms:
        return state[1], self.acceleration(state, voltage) + force * (1.0 / self.mass)

    def platform(self, state: tuple[N, ...]) -> tuple[N, N]:
        return state[0], state[1]

    def acceleration(self, state: Terms, voltage: Voltage[Term]) -> Term:
        y, w = state
        return accelerated(y, w, self.gain * voltage.level, self.natural_frequency, self.damping_ratio)

    def steady(self, state: State, segment: Segment, t_local: ScalarLike, force: ScalarLike) -> State:
        y, w = tends_to(*self._system(), segment, t_local)
        return y + force / (self.mass * self.natural_frequency**2), w

    def motion(self, state: State, segment: Segment, t_local: ScalarLike, elapsed: ScalarLike) -> State:
        y0, w0 = forced(*self._system(), segment, t_local)
        y1, w1 = forced(*self._system(), segment, t_local + elapsed)
        y, w = underdamped(state[0] - y0, state[1] - w0, self.natural_frequency, self.damping_ratio, elapsed)
        return y1 + y, w1 + w

    def _system(self) -> tuple[float, float, float]:
        return self.gain, self.natural_frequency, self.damping_ratio

    def error_scale(self) -> State:
        return jnp.ones(()), 1.0 / self.frequency_scale()

    def static_gain(self) -> Scalar:
        return jnp.asarray(self.gain, float)

    def frequency_scale(self) -> Scalar:
        return jnp.asarray(self.natural_frequency, float)
