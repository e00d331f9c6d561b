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

from ..core import quantity
from ._ceramic import Ceramic, Elements
from ._dynamics import Modal
from ._stack import AbstractStack, oscillator
from .base import Shown

_DECADES = (1.0, 10.0, 100.0)

_PARTS = 60.0
"""Times that t_1 fits into the longest record: the slowest element then has most of its way within it."""


class Creep(AbstractStack):
    """Displacement, velocity, voltage [V], then the displacements by which the three elements have crept [m]."""

    closed_on_lines = True

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

    @property
    def dynamics(self) -> Modal:
        return oscillator(self.natural_frequency, self.damping_ratio, self.mass)

    @property
    def ceramic(self) -> Ceramic:
        share = self.gain * self.creep
        return Ceramic((self.gain,), Elements(), (share,) * len(_DECADES), tuple(self.creep_time * d for d in _DECADES))
