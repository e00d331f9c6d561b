"""Measured minus predicted, whitened by the noise, stacked over the records fitted.

A record's free offset enters linearly, and the best one is the mean of what is left.  It is
taken out here (variable projection: G. H. Golub and V. Pereyra, SIAM J. Numerical Analysis
10(2), 1973), so that the fit never sees it; the Jacobian, and with it every covariance of
the other parameters, is that of the fit with the offsets free.
"""

from collections.abc import Iterable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..integration import Accuracy
from ..study import Models, Predictor, Record
from .parameter_transform import ParameterTransform


class Residual(eqx.Module):
    """The residual vector as a function of the free numbers."""

    predictor: Predictor
    measured: tuple[Float[np.ndarray, " samples"], ...]
    offsets: tuple[float | None, ...]
    """Given zeros of the sensors, each in its unit; None where free."""
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
    ):
        self.predictor = Predictor(models, records)
        self.measured = tuple(record.measured for record in records)
        self.offsets = tuple(record.offset for record in records)
        self.transform = transform
        self.fixed = {path: np.asarray(value, float) for path, value in fixed.items()}
        self.accuracy = accuracy

    @property
    def samples(self) -> int:
        """Of all records together."""
        return sum(measured.size for measured in self.measured)

    def __call__(
        self, free: Float[Array | np.ndarray, " p"], weights: Float[Array | np.ndarray, " records"]
    ) -> tuple[Float[Array, " n"], Float[Array, " records"]]:
        """Stacked residuals, and the offset of every record, in its unit.

        `weights` are 1/noise [1/m] of the records, 0 to leave one out.
        """
        values = self.fixed | self.transform.decode(free)
        predicted = self.predictor(values, self.accuracy)
        parts, zeros = [], []
        for i, (measured, motion, offset) in enumerate(zip(self.measured, predicted, self.offsets, strict=True)):
            difference = measured - motion
            zero = jnp.mean(difference) if offset is None else jnp.asarray(offset, float)
            parts.append(jnp.where(weights[i] > 0, (difference - zero) * weights[i], 0.0))
            zeros.append(zero)
        return jnp.concatenate(parts), jnp.stack(zeros)


def free_offset(
    measured: Float[np.ndarray, " samples"], predicted: Float[np.ndarray, " samples"], given: float | None
) -> float:
    """The record's zero, in its unit: given, or the mean of what the prediction leaves."""
    return float(np.mean(measured - predicted)) if given is None else given


def as_weights(noise: Iterable[float], used: Iterable[bool]) -> Float[np.ndarray, " records"]:
    """1/noise of the records used, 0 of the others."""
    return np.array([1.0 / sigma if use else 0.0 for sigma, use in zip(noise, used, strict=True)])
