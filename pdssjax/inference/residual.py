"""Measured minus predicted, whitened by the noise, stacked over the records fitted.

A record's free offset enters linearly; the best one is the mean of the difference.  It is projected out (variable
projection: G. H. Golub and V. Pereyra, SIAM J. Numerical Analysis 10(2), 1973).  The Jacobian, and with it every
covariance of the other parameters, is that of the fit with the offsets free.
"""

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.tree_util import register_dataclass
from jaxtyping import Array, Bool, Float

from ..core import Count, Scalar, ScalarLike, Tree, Truth, kept_jit
from ..integration import Accuracy
from ..study import Models, Predictor, Record, Values
from .losses.base import AbstractLoss
from .losses.squares import Squares
from .parameter_transform import ParameterTransform
from .prior import Prior


class Comparison(eqx.Module):
    """The data that predicted motions are compared with: samples of the records, and what was measured apart."""

    measured: tuple[Float[np.ndarray, " samples"], ...]
    used: tuple[Bool[np.ndarray, " samples"], ...]
    """Which samples of each record count: all, unless some are held out."""
    offsets: tuple[float | None, ...]
    """Given zeros of the sensors, each in its unit; None where free."""
    loss: AbstractLoss
    prior: Prior
    """What was measured apart of the free parameters [SI]."""

    def __init__(self, records: Sequence[Record], loss: AbstractLoss | None = None, prior: Prior | None = None):
        self.measured = tuple(record.measured for record in records)
        self.used = tuple(np.ones(record.measured.size, bool) for record in records)
        self.offsets = tuple(record.offset for record in records)
        self.loss = Squares() if loss is None else loss
        self.prior = prior or Prior()

    @property
    def size(self) -> int:
        """Number of residuals: samples of all records, then numbers measured apart."""
        return sum(measured.size for measured in self.measured) + len(self.prior.paths)

    def __call__(
        self,
        predicted: Sequence[Float[Array, " samples"]],
        values: Values,
        weights: Float[Array | np.ndarray, " records"],
    ) -> tuple[Float[Array, " n"], Float[Array, " records"]]:
        """Stacked residuals, under a robust loss their roots (`losses.base`), and each record's offset, in its unit.

        The deviations of parameters from their numbers measured apart follow the samples, in standard errors.
        `weights` are 1/noise [1/m] of the records, 0 to leave one out: its residuals are 0, and its offset is
        meaningless.  A record with all samples held out has residuals of 0, and the offset by all samples.
        """
        parts, offsets = self.by_record(predicted, values, weights)
        return jnp.concatenate(parts), jnp.stack(offsets)

    def by_record(
        self,
        predicted: Sequence[Float[Array, " samples"]],
        values: Values,
        weights: Float[Array | np.ndarray, " records"],
    ) -> tuple[list[Float[Array, " samples"]], list[Scalar]]:
        """The residuals and the offset of each record; the last residuals are of the numbers measured apart."""
        parts, zeros = [], []
        for i, (measured, motion, offset) in enumerate(zip(self.measured, predicted, self.offsets, strict=True)):
            difference = jnp.asarray(measured - motion)
            weight = jnp.where(self.used[i], weights[i], 0.0)
            zero = self.loss.location(difference, weight) if offset is None else jnp.asarray(offset, float)
            parts.append(jnp.where(weight > 0, self.loss.root((difference - zero) * weight), 0.0))
            zeros.append(zero)
        return [*parts, self.prior.deviations(values)], zeros


class Evaluated(NamedTuple):
    """Motions and residuals at the last of some points, and derivatives where they were wanted."""

    squares: Float[Array, " points"]
    """The sum of squares of the residual, of each of the points."""
    motions: list[Float[Array, " samples"]]
    """Predicted motion of every record that is used."""
    residual: Float[Array, " n"]
    offsets: Float[Array, " records"]
    jacobian: Float[Array, "n p"]
    """The Jacobian of the residual; 0 where no derivatives were wanted."""
    offsets_jacobian: Float[Array, "records p"]


TOGETHER = 16
"""Largest number of points of one call, since the overhead of a call is a third of an evaluation."""


@register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Evaluator:
    """The records of a study beside their predictions: compiled once for values and for derivatives, whoever asks."""

    predictor: Predictor
    """Predictor of all records, fitted or not."""
    comparison: Comparison
    """Samples of the records that are fitted."""
    accuracy: Accuracy
    places: tuple[int, ...] = dataclasses.field(metadata={"static": True})
    """Places of the fitted records among all."""
    paths: tuple[str, ...] = dataclasses.field(metadata={"static": True})
    """Paths of all parameters."""
    free: tuple[str, ...] = dataclasses.field(metadata={"static": True})
    """The paths by which derivatives are taken."""

    def __call__(
        self,
        points: Sequence[Values],
        weights: Float[Array | np.ndarray, " records"],
        used: Bool[np.ndarray, " all_records"] | None = None,
        directions: Float[np.ndarray, "p p"] | None = None,
    ) -> Evaluated:
        """Evaluate the `points`, each with the numbers [SI] of all parameters by path; compiled.

        **Arguments:** one point or more, up to `TOGETHER`; `weights` are 1/noise of the fitted records; only `used`
        records are predicted, by default all.  Derivatives are by p numbers, each of which moves the free parameters
        along a column of `directions`; None: no derivatives.
        """
        paths, free = self.paths, len(self.free)
        numbers = np.zeros((TOGETHER, len(paths)))
        for row, values in zip(numbers, points, strict=False):
            row[:] = [float(values[path]) for path in paths]
        sloped = np.asarray(directions is not None)
        directions = np.zeros((free, free)) if directions is None else directions
        used = np.ones(len(self.predictor.samples), bool) if used is None else used
        given: tuple[Any, ...] = numbers, np.asarray(len(points)), np.asarray(weights), used, sloped, directions
        return _evaluated(self, *given)


@kept_jit
def _evaluated(
    of: Evaluator,
    points: Float[Array, "points k"],
    count: Count,
    weights: Float[Array, " records"],
    used: Bool[Array, " all_records"],
    sloped: Truth,
    directions: Float[Array, "p p"],
) -> Evaluated:
    comparison, predictor, p = of.comparison, of.predictor, len(of.free)
    moving = {path: directions[i] for i, path in enumerate(of.free)}
    at = lambda row: {path: points[row, i] for i, path in enumerate(of.paths)}
    prior_values = lambda values: {path: values[path] for path in comparison.prior.paths}

    def next_point(row: Count, so_far: Tree) -> Tree:
        values, (squares, _, memory, *_) = at(row), so_far
        motions, memory = predictor.linearised(values, moving, sloped, of.accuracy, memory, used)
        residual, offsets = comparison([motions[place] for place in of.places], prior_values(values), weights)
        return squares.at[row].set(jnp.sum(residual**2)), motions, memory, residual, offsets

    # Memory that each point writes over, cleared once.
    memory = predictor.scratch(at(0), moving, of.accuracy)
    motions = [jnp.zeros(size) for size in predictor.samples]
    nothing = jnp.zeros(len(points)), motions, memory, jnp.zeros(comparison.size), jnp.zeros(len(of.places))
    squares, motions, memory, residual, offsets = lax.fori_loop(0, count, next_point, nothing)
    fitted, priors = [motions[place] for place in of.places], prior_values(at(count - 1))

    def along(fitted_dot: list[Float[Array, " samples"]], direction: Values) -> tuple[Tree, Tree]:
        compared = lambda fitted, priors: comparison.by_record(fitted, priors, weights)
        return jax.jvp(compared, (fitted, priors), (fitted_dot, prior_values(direction)))[1]

    def with_slopes() -> tuple[Float[Array, "n p"], Float[Array, "records p"]]:
        # Concatenated after vmap, or XLA would transpose the Jacobian.
        slopes = predictor.slopes(memory)
        fitted_slopes = [slopes[place] for place in of.places]
        parts, zeros = jax.vmap(along, in_axes=(-1, 0), out_axes=-1)(fitted_slopes, moving)
        return jnp.concatenate(parts), jnp.stack(zeros)

    none = lambda: (jnp.zeros((residual.size, p)), jnp.zeros((offsets.size, p)))
    return Evaluated(squares, motions, residual, offsets, *lax.cond(sloped, with_slopes, none))


@register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Residual:
    """The residual vector as a function of the free numbers."""

    predictor: Predictor
    comparison: Comparison
    transform: ParameterTransform
    fixed: dict[str, Float[np.ndarray, ""]]
    """The parameters that are not free [SI], by path."""
    accuracy: Accuracy

    @staticmethod
    def of(
        models: Models,
        records: Sequence[Record],
        transform: ParameterTransform,
        fixed: Mapping[str, float],
        accuracy: Accuracy,
        loss: AbstractLoss | None = None,
        prior: Prior | None = None,
    ) -> "Residual":
        """Make the residual of these `records`; the parameters `fixed` are numbers [SI] by path."""
        numbers = {path: np.asarray(value, float) for path, value in fixed.items()}
        return Residual(Predictor(models, records), Comparison(records, loss, prior), transform, numbers, accuracy)

    @property
    def loss(self) -> AbstractLoss:
        """The loss that is summed over the residuals."""
        return self.comparison.loss

    @property
    def prior(self) -> Prior:
        """What was measured apart of the free parameters."""
        return self.comparison.prior

    @property
    def size(self) -> int:
        """How many residuals there are."""
        return self.comparison.size

    def values(self, free: Float[Array | np.ndarray, " p"]) -> Values:
        """All parameters [SI] by path, the free ones from the scale of the fit."""
        return self.fixed | self.transform.decode(free)

    def __call__(
        self, free: Float[Array | np.ndarray, " p"], weights: Float[Array | np.ndarray, " records"]
    ) -> tuple[Float[Array, " n"], Float[Array, " records"]]:
        """Residuals and offsets as of `Comparison`; a record whose weight is 0 is not simulated."""
        values = self.values(free)
        return self.comparison(self.predictor(values, self.accuracy, jnp.asarray(weights) > 0), values, weights)


def free_offset(
    measured: Float[np.ndarray, " samples"],
    predicted: Float[np.ndarray, " samples"],
    given: float | None,
    loss: AbstractLoss,
    noise: float,
) -> float:
    """The record's zero, in its unit: the one given, or that of the least `loss` of the residuals."""
    if given is not None:
        return given
    difference = measured - predicted
    scale = noise if noise > 0 else float(np.std(difference)) or 1.0
    return float(_location(loss, difference, np.float64(1.0 / scale)))


@kept_jit
def _location(loss: AbstractLoss, difference: Float[np.ndarray, " n"], weight: ScalarLike) -> Scalar:
    return loss.location(jnp.asarray(difference), jnp.asarray(weight))


def as_weights(noise: Iterable[float], used: Iterable[bool]) -> Float[np.ndarray, " records"]:
    """1/noise of the records used, 0 of the others."""
    return np.array([1.0 / sigma if use else 0.0 for sigma, use in zip(noise, used, strict=True)])
