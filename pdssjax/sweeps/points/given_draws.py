"""Draws that were made elsewhere: of a bootstrap, of a posterior, or any other sample of what is known."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ...core import InputError
from .base import AbstractPoints, Scatter, check_values


class GivenDraws(AbstractPoints):
    """Draws of the parameters `paths`, one row of `values` [SI] each; at most `count` of them, evenly chosen.

    **Raises:** `InputError` for a table that has not a column a path, or numbers that are not finite.
    """

    def __init__(self, paths: Sequence[str], values: Float[np.ndarray, "draws paths"], count: int | None = None):
        self._paths, given = tuple(paths), np.asarray(values, float)
        if given.ndim != 2 or given.shape[1] != len(self._paths) or not len(given):
            raise InputError(
                f"sweep: found draws of shape {given.shape}, expected a row a draw and {len(self._paths)} columns."
            )
        if count is not None and count < 1:
            raise InputError(f"sweep: found {count} draws, expected at least 1.")
        for path, column in zip(self._paths, given.T, strict=True):
            check_values(path, column)
        number = min(len(given), count or len(given))
        self._values = given[np.linspace(0, len(given) - 1, number).round().astype(int)]

    @property
    def paths(self) -> tuple[str, ...]:
        return self._paths

    def dimensions(self) -> dict[str, int]:
        return {"draw": len(self._values)}

    def scattered(self) -> dict[str, Scatter]:
        """About the study's number: draws made elsewhere have no middle that is more than their mean."""
        return {path: Scatter(None, float(e)) for path, e in zip(self.paths, self._values.std(axis=0), strict=True)}

    def values(self) -> Float[np.ndarray, "points paths"]:
        return self._values
