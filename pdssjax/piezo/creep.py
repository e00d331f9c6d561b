"""A second-order system with creep: after a step the platform moves on, by as much in every decade of time.

    y'' + 2 xi w y' + w^2 y = C w^2 (u + c_1 + c_2 + c_3)   [ - F / m_g with friction feedback (5.25) ]
    c_i' = (k u - c_i) / t_i,   t_i = t_1, 10 t_1, 100 t_1

Springs with dampers in parallel, one behind the other, whose times are spread evenly on a
logarithmic scale, follow the creep y = y_0 (1 + k log10(t / t_0)) of piezo ceramics over as many
decades as there are elements; each adds the part k of the voltage in the end, in steps that
the eye does not tell from a straight line.  The logarithmic law: H. Jung and D.-G. Gweon, Review of Scientific
Instruments 71(4), 2000; the linear elements: D. Croft, G. Shed and S. Devasia, Journal of
Dynamic Systems, Measurement, and Control 123(1), 2001.
"""

from collections.abc import Mapping

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..drive.base import Segment, Voltage
from ..integration import N, Term
from ._oscillator import accelerated
from .base import AbstractPiezo, Shown, State, Terms

_DECADES = (1.0, 10.0, 100.0)

_PARTS = 60.0
"""Times that t_1 fits into the longest record: the slowest element then has most of its way within it."""


class Creep(AbstractPiezo):
    """Displacement and velocity, then the voltages c_1, c_2, c_3 [V] by which the stack has crept."""

    has_steady_state = False

    gain: float = quantity(1.007e-7, "m/V")
    """Displacement per volt C before any creep [m/V]."""
    natural_frequency: float = quantity(6736.0, "rad/s")
    """Undamped natural frequency w [rad/s]."""
    damping_ratio: float = quantity(0.1772, "", high=1.0)
    """Damping ratio xi [1], below 1."""
    creep: float = quantity(0.015, "", positive=False, low=0.0)
    """Part k of the voltage by which a decade of time adds to it [1]."""
    creep_time: float = quantity(0.05, "s", optional=True)
    """Time of the fastest element t_1 [s]."""
    mass: float = quantity(0.56, "kg", optional=True)
    """Moving mass of stack and platform m_g [kg]; only friction feedback (5.25) uses it."""

    @classmethod
    def first_guess(cls, shown: Shown, known: Mapping[str, float]) -> dict[str, float]:
        guess = super().first_guess(shown, known)
        return guess | ({"creep_time": shown.duration / _PARTS} if shown.duration else {})

    def initial(self) -> State:
        return tuple(jnp.zeros(()) for _ in range(2 + len(_DECADES)))

    def rate(self, state: Terms, voltage: Voltage[Term], force: Term) -> Terms:
        _, w, *crept = state
        creeps = (
            (voltage.level * self.creep - c) * (1.0 / (self.creep_time * decade))
            for c, decade in zip(crept, _DECADES, strict=True)
        )
        return (w, self.acceleration(state, voltage) + force * (1.0 / self.mass), *creeps)

    def platform(self, state: tuple[N, ...]) -> tuple[N, N]:
        return state[0], state[1]

    def acceleration(self, state: Terms, voltage: Voltage[Term]) -> Term:
        y, w, *crept = state
        drives = sum(crept, voltage.level)
        return accelerated(y, w, drives * self.gain, self.natural_frequency, self.damping_ratio)

    def steady(self, state: State, segment: Segment, t_local: ScalarLike, force: ScalarLike) -> State:
        return state

    def error_scale(self) -> State:
        volt = self.static_gain()
        return (jnp.ones(()), 1.0 / self.frequency_scale(), *(volt for _ in _DECADES))

    def static_gain(self) -> Scalar:
        return jnp.asarray(self.gain, float)

    def frequency_scale(self) -> Scalar:
        return jnp.asarray(self.natural_frequency, float)
