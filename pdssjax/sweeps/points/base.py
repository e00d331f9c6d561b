"""The contract of a set of points: paths, their values, and the dimensions along which the results are laid out."""

import abc
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...core import InputError


class Scatter(NamedTuple):
    """How points scatter along a path by what is known of a parameter."""

    about: float | None
    """The number [SI] in the middle; None where it is that of the study."""
    standard_error: float
    """[SI]"""


class AbstractPoints(abc.ABC):
    """Points of a sweep, each a number [SI] for every path: a quantity of the drive or a parameter of the models."""

    @property
    @abc.abstractmethod
    def paths(self) -> tuple[str, ...]:
        """What differs from point to point, such as "drive.voltage"."""

    @abc.abstractmethod
    def dimensions(self) -> dict[str, int]:
        """Name and length of every dimension, the slowest first; there are as many points as their product."""

    @abc.abstractmethod
    def values(self) -> Float[np.ndarray, "points paths"]:
        """The numbers [SI] of all points, the last dimension running fastest."""

    def coordinates(self) -> dict[str, tuple[str, Float[np.ndarray, " values"]]]:
        """By path, the dimension along which it changes, and its values there [SI]; by default the only one."""
        (dimension,) = self.dimensions()
        return {path: (dimension, column) for path, column in zip(self.paths, self.values().T, strict=True)}

    def scattered(self) -> dict[str, Scatter]:
        """Those of the paths along which points scatter about an estimate; by default none does."""
        return {}

    def __len__(self) -> int:
        return int(np.prod(list(self.dimensions().values()), dtype=int))


def check_values(path: str, values: Float[np.ndarray, "..."]) -> None:
    """**Raises** `InputError` unless `values` is a vector of finite numbers, at least one of them."""
    if values.size == 0 or values.ndim != 1:
        raise InputError(f'sweep: path "{path}": found an array of shape {values.shape}, expected some values.')
    if not np.isfinite(values).all():
        found = values[~np.isfinite(values)][0]
        raise InputError(f'sweep: path "{path}": found {found}, expected finite numbers.')


def check_ranges(ranges: Mapping[str, Sequence[float]], count: int) -> None:
    """**Raises** `InputError` unless every range is (low, high), low below high, and `count` is positive."""
    if count < 1:
        raise InputError(f"sweep: found a sample of {count} points, expected at least 1.")
    if not ranges:
        raise InputError("sweep: found a sample without a range, expected at least one path with (low, high).")
    for path, ends in ranges.items():
        if len(ends) != 2:
            raise InputError(f'sweep: path "{path}": found {len(ends)} numbers, expected two: the range (low, high).')
        check_values(path, np.asarray(ends, float))
        low, high = ends
        if not low < high:
            raise InputError(
                f'sweep: path "{path}": found the range {low:g} to {high:g}, expected the lower end first.'
            )
