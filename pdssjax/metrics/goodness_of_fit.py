"""How well a prediction matches a record."""

import numpy as np
from jaxtyping import Float


def rmse(measured: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"]) -> float:
    """Root mean square of the residuals, in the unit of the data."""
    return float(np.sqrt(np.mean((measured - predicted) ** 2)))


def error_index(measured: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"]) -> float:
    """The thesis's error index (4.14), sqrt(sum (measured - predicted)^2 / (n - 1)), in the unit of the data."""
    return float(np.sqrt(np.sum((measured - predicted) ** 2) / (len(measured) - 1)))


def r_squared(measured: Float[np.ndarray, " n"], predicted: Float[np.ndarray, " n"]) -> float:
    """Share of the measured variance that the prediction explains."""
    return float(1.0 - np.mean((measured - predicted) ** 2) / np.var(measured))
