"""A list of points: any numbers, one point after the other."""

from collections.abc import Mapping

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Float

from ...core import InputError
from .base import AbstractPoints, check_values


class Listed(AbstractPoints):
    """Point i takes entry i of every column."""

    columns: dict[str, Float[np.ndarray, " points"]]
    """By path, the values [SI] of all points."""

    def __init__(self, columns: Mapping[str, Float[ArrayLike, " points"]]):
        self.columns = {path: np.atleast_1d(np.asarray(values, float)) for path, values in columns.items()}
        for path, values in self.columns.items():
            check_values(path, values)
        lengths = {path: values.size for path, values in self.columns.items()}
        if len(set(lengths.values())) != 1:
            raise InputError(f"sweep: found a list with columns of lengths {lengths}, expected columns of one length.")

    @property
    def paths(self) -> tuple[str, ...]:
        return tuple(self.columns)

    def dimensions(self) -> dict[str, int]:
        return {"point": next(iter(self.columns.values())).size}

    def values(self) -> Float[np.ndarray, "points paths"]:
        return np.stack(list(self.columns.values()), axis=1)
