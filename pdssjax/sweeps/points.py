"""Which points a sweep computes: a grid, a list, samples of a box, draws of what is known of parameters, or products.

`CovarianceDraws` draws from the covariance of an estimate: positive parameters are normal in their logarithm, with the
relative standard errors of the estimate; the others are normal.  To first order both have the covariance given.

`SigmaPoints` lie about an estimate, for bands to first order and for whether first order does.  With f+ and f- a metric
at +h and -h standard deviations along each of the p principal axes of the covariance,

    slope = (f+ - f-) / (2 h),        variance = sum over axes of slope^2

to first order.  First order is tested at the usual distance of a draw: at +r and -r along p random directions at right
angles to each other, r = sqrt(p), over which the mean square of the linear change is the variance itself.  With the odd
part o = (f+ - f-) / 2 and the even part e = (f+ + f-) / 2 - f of the change that is found there, what first order
misses of the variance is

    mean of (o^2 + e^2) - variance.

Unlike principal axes, random directions also show products of parameters.
"""

import abc
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Bool, Float

from ..core import InputError, sobol_points


class Scatter(NamedTuple):
    """How points scatter along a path by what is known of a parameter."""

    about: float | None
    """The number [SI] in the middle; None where it is that of the study."""
    standard_error: float
    """[SI]"""


class AbstractPoints(abc.ABC):
    """Points of a sweep, each a number [SI] for every path: a quantity of the drive or a parameter of the models."""

    paths: tuple[str, ...]
    """Paths of the numbers that differ from point to point, such as "drive.voltage"."""

    @abc.abstractmethod
    def dimensions(self) -> dict[str, int]:
        """Name and length of every dimension, the slowest first; there are as many points as their product."""

    @abc.abstractmethod
    def values(self) -> Float[np.ndarray, "points paths"]:
        """The numbers [SI] of all points, the last dimension running fastest."""

    def coordinates(self) -> dict[str, tuple[str, Float[np.ndarray, " values"]]]:
        """The dimension along which each path changes, by default the only one, and its values there [SI]."""
        (dimension,) = self.dimensions()
        return {path: (dimension, column) for path, column in zip(self.paths, self.values().T, strict=True)}

    def scattered(self) -> dict[str, Scatter]:
        """The paths along which points scatter about an estimate; by default none."""
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


def _columns(values: Mapping[str, Float[ArrayLike, " values"]]) -> dict[str, Float[np.ndarray, " values"]]:
    """By path, its values as an array; **raises** as `check_values` does."""
    columns = {path: np.atleast_1d(np.asarray(given, float)) for path, given in values.items()}
    for path, column in columns.items():
        check_values(path, column)
    return columns


class Grid(AbstractPoints):
    """Every combination of the values of each axis, the last axis running fastest; one point where there is none."""

    axes: dict[str, Float[np.ndarray, " values"]]
    """By path, its values [SI]."""

    def __init__(self, axes: Mapping[str, Float[ArrayLike, " values"]]):
        self.axes, self.paths = _columns(axes), tuple(axes)

    def dimensions(self) -> dict[str, int]:
        return {path.replace(".", "_"): values.size for path, values in self.axes.items()}

    def values(self) -> Float[np.ndarray, "points paths"]:
        crossed = np.meshgrid(*self.axes.values(), indexing="ij")
        return np.stack([values.ravel() for values in crossed], axis=1) if crossed else np.empty((1, 0))

    def coordinates(self) -> dict[str, tuple[str, Float[np.ndarray, " values"]]]:
        return {path: (path.replace(".", "_"), values) for path, values in self.axes.items()}


class Listed(AbstractPoints):
    """Point i takes entry i of every column."""

    columns: dict[str, Float[np.ndarray, " points"]]
    """By path, the values [SI] of all points."""

    def __init__(self, columns: Mapping[str, Float[ArrayLike, " points"]]):
        self.columns, self.paths = _columns(columns), tuple(columns)
        lengths = {path: values.size for path, values in self.columns.items()}
        if len(set(lengths.values())) != 1:
            raise InputError(f"sweep: found a list with columns of lengths {lengths}, expected columns of one length.")

    def dimensions(self) -> dict[str, int]:
        return {"point": next(iter(self.columns.values())).size}

    def values(self) -> Float[np.ndarray, "points paths"]:
        return np.stack(list(self.columns.values()), axis=1)


class AbstractSample(AbstractPoints):
    """Points spread over a box of ranges, by numbers between 0 and 1."""

    ranges: dict[str, tuple[float, float]]
    """By path, the lower and the upper end [SI]."""
    count: int
    seed: int

    def __init__(self, ranges: Mapping[str, tuple[float, float]], count: int, seed: int = 0):
        check_ranges(ranges, count)
        self.ranges, self.count, self.seed = dict(ranges), count, seed
        self.paths = tuple(self.ranges)

    @abc.abstractmethod
    def unit_cube(self, dimension: int) -> Float[np.ndarray, "points paths"]:
        """`count` points in the unit cube; the same for the same seed."""

    def dimensions(self) -> dict[str, int]:
        return {"point": self.count}

    def values(self) -> Float[np.ndarray, "points paths"]:
        low, high = np.array(list(self.ranges.values()), float).T
        return low + (high - low) * self.unit_cube(len(self.ranges))


class Sobol(AbstractSample):
    """The first `count` points of a scrambled Sobol sequence over the ranges."""

    def unit_cube(self, dimension: int) -> Float[np.ndarray, "points paths"]:
        return sobol_points(self.count, dimension, self.seed)


class LatinHypercube(AbstractSample):
    """`count` points, one in every slice of every range."""

    def unit_cube(self, dimension: int) -> Float[np.ndarray, "points paths"]:
        from scipy.stats import qmc

        return qmc.LatinHypercube(dimension, rng=np.random.default_rng(self.seed)).random(self.count)


class CovarianceDraws(AbstractPoints):
    """`count` draws of some parameters about their estimates."""

    def __init__(
        self,
        paths: Sequence[str],
        means: Float[np.ndarray, " paths"],
        covariance: Float[np.ndarray, "paths paths"],
        positive: Bool[np.ndarray, " paths"],
        count: int,
        seed: int = 0,
    ):
        if count < 1:
            raise InputError(f"sweep: found {count} draws, expected at least 1.")
        if not (np.isfinite(covariance).all() and len(paths)):
            raise InputError(
                "sweep: found no finite covariance to draw from, expected an estimate with standard errors."
            )
        self.paths, self.means, self.positive = tuple(paths), np.asarray(means, float), np.asarray(positive, bool)
        self.covariance, self.count, self.seed = np.asarray(covariance, float), count, seed

    def dimensions(self) -> dict[str, int]:
        return {"draw": self.count}

    def values(self) -> Float[np.ndarray, "points paths"]:
        normal = np.random.default_rng(self.seed).standard_normal((self.count, len(self.means)))
        return self.moved(normal @ self.principal_axes().T)

    def scattered(self) -> dict[str, Scatter]:
        errors = np.sqrt(np.diag(self.covariance))
        return {p: Scatter(float(m), float(e)) for p, m, e in zip(self.paths, self.means, errors, strict=True)}

    def principal_axes(self) -> Float[np.ndarray, "paths axes"]:
        """The principal axes as columns, a square root of the covariance [1, or SI where not positive].

        On the scale of `moved`.
        """
        unit = np.where(self.positive, self.means, 1.0)
        # By eigenvalues: a covariance with a parameter that another determines has no Cholesky factor.
        spread = np.sqrt(np.diag(self.covariance)) / unit
        scale = unit * np.where(spread > 0, spread, 1.0)
        scaled = self.covariance / np.outer(scale, scale)
        variances, directions = np.linalg.eigh(scaled)
        return spread[:, None] * directions * np.sqrt(np.clip(variances, 0.0, None))

    def moved(self, away: Float[np.ndarray, "points paths"]) -> Float[np.ndarray, "points paths"]:
        """The means [SI] moved by `away`: a change of the logarithm where a parameter is positive."""
        return np.where(self.positive, self.means * np.exp(np.where(self.positive, away, 0.0)), self.means + away)


class GivenDraws(AbstractPoints):
    """Draws of the parameters `paths`, one row of `values` [SI] each; at most `count` of them, evenly chosen.

    **Raises:** `InputError` for a table that has not a column a path, or numbers that are not finite.
    """

    def __init__(self, paths: Sequence[str], values: Float[np.ndarray, "draws paths"], count: int | None = None):
        self.paths, given = tuple(paths), np.asarray(values, float)
        if given.ndim != 2 or given.shape[1] != len(self.paths) or not len(given):
            raise InputError(
                f"sweep: found draws of shape {given.shape}, expected a row a draw and {len(self.paths)} columns."
            )
        if count is not None and count < 1:
            raise InputError(f"sweep: found {count} draws, expected at least 1.")
        for path, column in zip(self.paths, given.T, strict=True):
            check_values(path, column)
        number = min(len(given), count or len(given))
        self._values = given[np.linspace(0, len(given) - 1, number).round().astype(int)]

    def dimensions(self) -> dict[str, int]:
        return {"draw": len(self._values)}

    def scattered(self) -> dict[str, Scatter]:
        """By the standard deviation of the draws about their mean; which estimate they belong to is not known."""
        return {path: Scatter(None, float(e)) for path, e in zip(self.paths, self._values.std(axis=0), strict=True)}

    def values(self) -> Float[np.ndarray, "points paths"]:
        return self._values


AXIS_STEP = 0.5
"""Distance of sigma points along an axis, in standard deviations: h above."""


class SigmaPoints(AbstractPoints):
    """The estimate, then both points on every principal axis, then both on as many random directions.

    On an axis without variance both are the estimate.
    """

    def __init__(self, draws: CovarianceDraws):
        """Sigma points about the means of `draws`, with their covariance."""
        self.draws, self.paths = draws, draws.paths

    def dimensions(self) -> dict[str, int]:
        return {"sigma_point": 1 + 4 * len(self.paths)}

    def scattered(self) -> dict[str, Scatter]:
        return self.draws.scattered()

    def values(self) -> Float[np.ndarray, "points paths"]:
        axes = self.draws.principal_axes().T
        count = len(axes)
        # The same directions in every sweep.
        directions = np.linalg.qr(np.random.default_rng(0).standard_normal((count, count)))[0]
        out = np.concatenate([AXIS_STEP * axes, np.sqrt(count) * directions @ axes])
        away = np.concatenate([np.zeros((1, len(self.paths))), np.repeat(out, 2, axis=0)])
        away[2::2] *= -1.0
        return self.draws.moved(away)


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
        self.paths = (*outer.paths, *inner.paths)

    def dimensions(self) -> dict[str, int]:
        return self.outer.dimensions() | self.inner.dimensions()

    def values(self) -> Float[np.ndarray, "points paths"]:
        outer, inner = self.outer.values(), self.inner.values()
        return np.concatenate([np.repeat(outer, len(inner), axis=0), np.tile(inner, (len(outer), 1))], axis=1)

    def coordinates(self) -> dict[str, tuple[str, Float[np.ndarray, " values"]]]:
        return self.outer.coordinates() | self.inner.coordinates()

    def scattered(self) -> dict[str, Scatter]:
        return self.outer.scattered() | self.inner.scattered()
