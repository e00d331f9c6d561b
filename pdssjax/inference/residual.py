"""Measured minus predicted, whitened by the noise, stacked over the records fitted.

A record's free offset enters linearly, and the best one is the mean of what is left.  It is
taken out here (variable projection: G. H. Golub and V. Pereyra, SIAM J. Numerical Analysis
10(2), 1973), so that the fit never sees it; the Jacobian, and with it every covariance of
the other parameters, is that of the fit with the offsets free.
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .integration import Accuracy
from .parameters import Scale
from .prediction import Models, Predictor
from .records import Record

_FAR = 3.0
"""Standard deviations from which a second difference counts as motion, not noise."""
_KEPT = 0.98658
"""Standard deviation of a normal variable cut off there."""


class Residual(eqx.Module):
    """The residual vector as a function of the free numbers."""

    predictor: Predictor
    measured: tuple[np.ndarray, ...]
    offsets: tuple[float | None, ...]
    """Given zeros of the sensor [m or N]; None where free."""
    scale: Scale
    fixed: dict[str, Any]
    accuracy: Accuracy

    def __init__(
        self, models: Models, records: Sequence[Record], scale: Scale, fixed: dict[str, float], accuracy: Accuracy
    ):
        self.predictor = Predictor(models, records)
        self.measured = tuple(record.measured for record in records)
        self.offsets = tuple(record.offset for record in records)
        self.scale = scale
        self.fixed = {path: np.asarray(value, float) for path, value in fixed.items()}
        self.accuracy = accuracy

    @property
    def samples(self) -> int:
        """Of all records together."""
        return sum(measured.size for measured in self.measured)

    def __call__(
        self, free: Float[Array, " p"], weights: Float[Array, " records"]
    ) -> tuple[Float[Array, " n"], Float[Array, " records"]]:
        """Stacked residuals, and the offset of every record [m or N].

        `weights` are 1/noise [1/m] of the records, 0 to leave one out.
        """
        values = self.fixed | self.scale.decode(free)
        predicted = self.predictor(values, self.accuracy)
        parts, zeros = [], []
        for i, (measured, motion, offset) in enumerate(zip(self.measured, predicted, self.offsets, strict=True)):
            rest = measured - motion
            zero = jnp.mean(rest) if offset is None else jnp.asarray(offset, float)
            parts.append(jnp.where(weights[i] > 0, (rest - zero) * weights[i], 0.0))
            zeros.append(zero)
        return jnp.concatenate(parts), jnp.stack(zeros)


def noise_floor(record: Record) -> float:
    """A first guess of the noise [m or N] of a record from the scatter of its second differences.

    Robust against the fast motion of a slip, which fills few samples: what lies far out is
    left out again and again.  A smooth motion between samples hardly enters, and rounding
    no more than it does in the noise itself.
    """
    if record.measured.size < 8:
        return float(np.std(record.measured)) or 1e-9
    bends = np.abs(np.diff(record.measured, 2))
    spread = 1.4826 * float(np.median(bends))
    for _ in range(20):
        near = bends[bends <= _FAR * spread] if spread > 0 else bends
        spread = float(np.sqrt(np.mean(near**2))) / _KEPT
    return max(spread / np.sqrt(6.0), 1e-4 * float(np.std(record.measured)), 1e-12)


def free_offset(measured: np.ndarray, predicted: np.ndarray, given: float | None) -> float:
    """The record's zero [m or N]: given, or the mean of what the prediction leaves."""
    return float(np.mean(measured - predicted)) if given is None else given


def as_weights(noise: Sequence[float], used: Sequence[bool]) -> Any:
    """1/noise of the records used, 0 of the others, shape (records,)."""
    return np.array([1.0 / sigma if use else 0.0 for sigma, use in zip(noise, used, strict=True)])
