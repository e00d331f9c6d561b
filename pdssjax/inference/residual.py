"""Measured minus predicted, whitened by the noise, stacked over the records fitted.

A record's free offset enters linearly, and the best one is the mean of what is left.  It is
taken out here (variable projection: G. H. Golub and V. Pereyra, SIAM J. Numerical Analysis
10(2), 1973), so that the fit never sees it; the Jacobian, and with it every covariance of
the other parameters, is that of the fit with the offsets free.
"""

from collections.abc import Iterable, Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import Scalar, ScalarLike, kept_jit
from ..integration import Accuracy
from ..study import Directions, Models, Predictor, Record, Values
from .losses.base import AbstractLoss
from .losses.squares import Squares
from .parameter_transform import ParameterTransform


class Comparison(eqx.Module):
    """The data that predicted motions are compared with: samples of the records, and what was measured apart."""

    measured: tuple[Float[np.ndarray, " samples"], ...]
    used: tuple[Bool[np.ndarray, " samples"], ...]
    """Which samples of each record count: all, unless some are held out."""
    offsets: tuple[float | None, ...]
    """Given zeros of the sensors, each in its unit; None where free."""
    loss: AbstractLoss
    apart: dict[str, Float[np.ndarray, "2"]]
    """By path of a free parameter that was measured apart, in alphabetical order: number and standard error [SI]."""

    def __init__(
        self,
        records: Sequence[Record],
        loss: AbstractLoss | None = None,
        apart: Mapping[str, tuple[float, float]] | None = None,
    ):
        self.measured = tuple(record.measured for record in records)
        self.used = tuple(np.ones(record.measured.size, bool) for record in records)
        self.offsets = tuple(record.offset for record in records)
        self.loss = Squares() if loss is None else loss
        # In the order that JAX gives a dictionary: it is that of the residuals, compiled or not.
        self.apart = {path: np.asarray(told, float) for path, told in sorted((apart or {}).items())}

    @property
    def size(self) -> int:
        """How many residuals there are: samples of all records, then what was measured apart."""
        return sum(measured.size for measured in self.measured) + len(self.apart)

    def __call__(
        self,
        predicted: Sequence[Float[Array, " samples"]],
        values: Values,
        weights: Float[Array | np.ndarray, " records"],
    ) -> tuple[Float[Array, " n"], Float[Array, " records"]]:
        """Stacked residuals, under a robust loss their roots (`losses.base`), and each record's offset, in its unit.

        After the samples comes how far each parameter that was measured apart is from that, in standard errors.
        `weights` are 1/noise [1/m] of the records, 0 to leave one out: its residuals are 0, and its offset says
        nothing.  Where all samples of a record are held out its residuals are 0, and its offset is that of all of them.
        """
        parts, zeros = [], []
        for i, (measured, motion, offset) in enumerate(zip(self.measured, predicted, self.offsets, strict=True)):
            difference = jnp.asarray(measured - motion)
            weight = jnp.where(self.used[i], weights[i], 0.0)
            zero = self.loss.location(difference, weight) if offset is None else jnp.asarray(offset, float)
            parts.append(jnp.where(weight > 0, self.loss.root((difference - zero) * weight), 0.0))
            zeros.append(zero)
        told = [(values[path] - number) / error for path, (number, error) in self.apart.items()]
        return jnp.concatenate([*parts, jnp.asarray(told, float)]), jnp.stack(zeros)


def compared(
    comparison: Comparison,
    motions: Sequence[Float[Array, " samples"]],
    values: Values,
    weights: Float[Array | np.ndarray, " records"],
) -> tuple[Float[Array, " n"], Float[Array, " records"]]:
    """The outputs of `comparison`, compiled."""
    return _compared(comparison, motions, {path: values[path] for path in comparison.apart}, weights)


@kept_jit
def _compared(
    comparison: Comparison,
    motions: Sequence[Float[Array, " samples"]],
    apart: Values,
    weights: Float[Array | np.ndarray, " records"],
) -> tuple[Float[Array, " n"], Float[Array, " records"]]:
    return comparison(motions, apart, weights)


class Residual(eqx.Module):
    """The residual vector as a function of the free numbers."""

    predictor: Predictor
    comparison: Comparison
    transform: ParameterTransform
    fixed: dict[str, Float[np.ndarray, ""]]
    accuracy: Accuracy

    def __init__(
        self,
        models: Models,
        records: Sequence[Record],
        transform: ParameterTransform,
        fixed: dict[str, float],
        accuracy: Accuracy,
        loss: AbstractLoss | None = None,
        apart: Mapping[str, tuple[float, float]] | None = None,
    ):
        self.predictor = Predictor(models, records)
        self.comparison = Comparison(records, loss, apart)
        self.transform = transform
        self.fixed = {path: np.asarray(value, float) for path, value in fixed.items()}
        self.accuracy = accuracy

    @property
    def loss(self) -> AbstractLoss:
        """The loss that is summed over the residuals."""
        return self.comparison.loss

    @property
    def apart(self) -> dict[str, Float[np.ndarray, "2"]]:
        """Number and standard error [SI] of the free parameters that were measured apart, by path."""
        return self.comparison.apart

    @property
    def size(self) -> int:
        """How many residuals there are."""
        return self.comparison.size

    def values(self, free: Float[Array | np.ndarray, " p"]) -> Values:
        """All parameters [SI] by path, the free ones from the scale of the fit."""
        return self.fixed | self.transform.decode(free)

    def linearised_values(self, free: Float[Array | np.ndarray, " p"]) -> tuple[Values, Directions]:
        """`values`, and how the free ones move with each of the numbers of the fit."""
        moving, directions = self.transform.linearised(free)
        return self.fixed | moving, directions

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
    """The record's zero, in its unit: given, or where the `loss` of what the prediction leaves is least."""
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
