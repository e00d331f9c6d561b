"""95 % intervals by standard errors: symmetric on the scale of the fit, and no further than parameters may lie."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ..parameter_transform import ParameterTransform
from .students_t import half_width_95


def linear_intervals(
    at: Float[np.ndarray, " p"],
    deviation: Float[np.ndarray, " p"],
    freedom: Float[np.ndarray, " p"],
    free: ParameterTransform,
    bounds: Mapping[str, tuple[float, float]],
) -> dict[str, tuple[float, float]]:
    """By path the interval [SI] around the point `at`, NaN where the `deviation` is; both on the fit's scale.

    It has the width of Student's t by the degrees of `freedom` of the noise that a deviation rests on.

    An end that would lie beyond one of the `bounds` [SI] of its parameter is that bound: the truth does not, so that
    the interval holds it as often.
    """
    half = half_width_95(freedom) * np.nan_to_num(deviation)
    ends = free.in_si(at - half), free.in_si(at + half)
    out = {}
    for path, low, high, known in zip(free.paths, *ends, np.isfinite(deviation), strict=True):
        least, most = bounds[path]
        out[path] = (max(float(low), least), min(float(high), most)) if known else (float("nan"), float("nan"))
    return out
