"""What samples of a box share: ranges, a count, a seed."""

import abc
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from .base import AbstractPoints, check_ranges


class AbstractSample(AbstractPoints):
    """Points spread over a box of ranges, by numbers between 0 and 1."""

    ranges: dict[str, tuple[float, float]]
    """By path, the lower and the upper end [SI]."""
    count: int
    seed: int

    def __init__(self, ranges: Mapping[str, tuple[float, float]], count: int, seed: int = 0):
        check_ranges(ranges, count)
        self.ranges, self.count, self.seed = dict(ranges), count, seed

    @abc.abstractmethod
    def unit_cube(self, paths: int) -> Float[np.ndarray, "points paths"]:
        """`count` points in the unit cube; the same for the same seed."""

    @property
    def paths(self) -> tuple[str, ...]:
        return tuple(self.ranges)

    def dimensions(self) -> dict[str, int]:
        return {"point": self.count}

    def values(self) -> Float[np.ndarray, "points paths"]:
        low, high = np.array(list(self.ranges.values()), float).T
        return low + (high - low) * self.unit_cube(len(self.ranges))
