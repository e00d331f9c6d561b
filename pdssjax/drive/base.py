"""The interface of every voltage waveform: a chain of straight segments."""

import abc
from typing import NamedTuple

import equinox as eqx
from jaxtyping import Array, Float, Int


class Segment(NamedTuple):
    """A stretch of drive between two corners; within it the voltage is a straight line."""

    duration: Float[Array, ""]
    """Length [s]; zero for a jump, infinite for the last one."""
    start: Float[Array, ""]
    """Voltage just after the corner that opens the segment [V].

    Of a segment of zero length the mean of both ends: what a short one gives the platform,
    so that derivatives with respect to its length are right at zero, too.
    """
    slope: Float[Array, ""]
    """Rate of the voltage [V/s]."""


class AbstractDrive(eqx.Module):
    """A voltage against time, from t = 0 on; before that the piezo is at 0 V and at rest."""

    @abc.abstractmethod
    def segment(self, index: Int[Array, ""]) -> Segment:
        """The segment `index` = 0, 1, 2, …; may be traced and differentiated."""

    @abc.abstractmethod
    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        """The voltage [V] at times [s] from the start of the drive; 0 before it."""

    @abc.abstractmethod
    def period(self) -> tuple[int, int] | None:
        """`(first, count)`: from segment `first` on, the drive repeats every `count` segments.

        None where it never does.
        """
