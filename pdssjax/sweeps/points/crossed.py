"""Every point of a set with every point of another: a grid of drives with draws of parameters, say."""

import numpy as np
from jaxtyping import Float

from ...core import InputError
from .base import AbstractPoints, Scatter


class Crossed(AbstractPoints):
    """Every point of `outer` with every point of `inner`, which runs fastest."""

    outer: AbstractPoints
    inner: AbstractPoints

    def __init__(self, outer: AbstractPoints, inner: AbstractPoints):
        if twice := [path for path in outer.paths if path in inner.paths]:
            raise InputError(f'sweep: path "{twice[0]}": found it twice, expected every path once.')
        if twice := [name for name in outer.dimensions() if name in inner.dimensions()]:
            raise InputError(
                f'sweep: found two sets of points along "{twice[0]}", expected a grid with a list or sample.'
            )
        self.outer, self.inner = outer, inner

    @property
    def paths(self) -> tuple[str, ...]:
        return (*self.outer.paths, *self.inner.paths)

    def dimensions(self) -> dict[str, int]:
        return self.outer.dimensions() | self.inner.dimensions()

    def values(self) -> Float[np.ndarray, "points paths"]:
        outer, inner = self.outer.values(), self.inner.values()
        return np.concatenate([np.repeat(outer, len(inner), axis=0), np.tile(inner, (len(outer), 1))], axis=1)

    def coordinates(self) -> dict[str, tuple[str, Float[np.ndarray, " values"]]]:
        return self.outer.coordinates() | self.inner.coordinates()

    def scattered(self) -> dict[str, Scatter]:
        return self.outer.scattered() | self.inner.scattered()
