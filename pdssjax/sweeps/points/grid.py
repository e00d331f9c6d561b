"""A grid: every combination of the values of its axes."""

from collections.abc import Mapping

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from .base import AbstractPoints, check_values


class Grid(AbstractPoints):
    """Every combination of the values of each axis, the last axis running fastest; one point where there is none."""

    axes: dict[str, Float[np.ndarray, " values"]]
    """By path, its values [SI]."""

    def __init__(self, axes: Mapping[str, Float[ArrayLike, " values"]]):
        self.axes = {path: np.atleast_1d(np.asarray(values, float)) for path, values in axes.items()}
        for path, values in self.axes.items():
            check_values(path, values)

    @property
    def paths(self) -> tuple[str, ...]:
        return tuple(self.axes)

    def dimensions(self) -> dict[str, int]:
        return {path.replace(".", "_"): values.size for path, values in self.axes.items()}

    def values(self) -> Float[np.ndarray, "points paths"]:
        crossed = np.meshgrid(*self.axes.values(), indexing="ij")
        return np.stack([values.ravel() for values in crossed], axis=1) if crossed else np.empty((1, 0))

    def coordinates(self) -> dict[str, tuple[str, Float[np.ndarray, " values"]]]:
        return {path: (path.replace(".", "_"), values) for path, values in self.axes.items()}
