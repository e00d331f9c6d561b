"""Where residuals are linearised to learn how they bend around a point."""

import numpy as np
from jaxtyping import Float

from .quadratic_end import factors
from .second_order import Linearisation

PROBED = 0.05
"""How far from the point its curvature is probed, in half widths of the linear intervals."""


def standard_errors(
    optimum: Linearisation, threshold: float | Float[np.ndarray, " p"], reach: float
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "p p"]]:
    """Half widths of the linear intervals, none longer than can be followed; and a scale: J scale is orthonormal.

    The `threshold` is that of all parameters, or one each.
    What changes nothing as far as it can be followed has an axis of its own, as long as that: together with others,
    which singular vectors of equal values would mix it with, it would shorten theirs.
    """
    told = reach * np.linalg.norm(optimum.jacobian, axis=0) > np.sqrt(threshold)
    scale = np.diag(np.where(told, 0.0, reach))
    if told.any():
        _, singular, rows, norms = factors(optimum.jacobian[:, told])
        axes = (rows / singular[:, None]).T / norms[:, None]
        axes = axes * np.minimum(1.0, reach / np.maximum(np.max(np.abs(axes), axis=0), 1e-300))
        scale[np.ix_(told, np.flatnonzero(told)[: singular.size])] = axes
    return np.minimum(np.linalg.norm(scale, axis=1) * np.sqrt(threshold), reach), scale


def probe_places(
    at: Float[np.ndarray, " p"],
    sizes: Float[np.ndarray, " p"],
    scale: Float[np.ndarray, "p p"],
    bounds: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
) -> list[Float[np.ndarray, " p"]]:
    """A place a parameter: each goes a little along the valley in which that one would leave the point."""
    places = []
    for index in range(at.size):
        along = scale @ scale[index]
        step = PROBED * along * (sizes[index] / max(abs(along[index]), 1e-300))
        ahead, behind = (np.clip(at + sign * step, *bounds) for sign in (1.0, -1.0))
        places.append(ahead if np.abs(ahead - at).max() >= np.abs(behind - at).max() else behind)
    return [place for place in places if np.any(place != at)]
