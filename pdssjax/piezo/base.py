"""The interface of every model of the piezo stack with its platform.

The platform is a linear filter of the voltage unless friction acts back on it.  Between
two corners of the drive its motion is therefore known in closed form, and the integrator
takes it from there; the acceleration, which the end-effector feels, is integrated
numerically only where the friction force enters it (5.25).
"""

import abc
from typing import Any

import equinox as eqx
from jaxtyping import Array, Float

from ..drive.base import Segment


class AbstractPiezo(eqx.Module):
    """Platform displacement y [m] and velocity y' [m/s] under a voltage."""

    mass: eqx.AbstractVar[Any]
    """Moving mass of stack and platform m_g [kg]; only friction feedback (5.25) uses it."""

    @abc.abstractmethod
    def acceleration(self, y, w, voltage) -> Float[Array, ""]:
        """y'' [m/s2] at displacement `y`, velocity `w` and `voltage` [V], without friction."""

    @abc.abstractmethod
    def motion(self, y, w, segment: Segment, after, lapse) -> tuple[Any, Any]:
        """Exact (y, y') a time `lapse` [s] later, `after` [s] into a straight segment."""

    @abc.abstractmethod
    def steady(self, segment: Segment, after) -> tuple[Any, Any]:
        """The (y, y') to which the platform tends on a straight segment, `after` [s] into it."""

    @abc.abstractmethod
    def rate(self) -> Float[Array, ""]:
        """The fastest angular frequency [rad/s]: the scale between velocity and displacement."""
