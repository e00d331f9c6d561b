"""95 % intervals by standard errors: how wide by Student's t, and no further than parameters may lie.

The variance of a parameter is a sum of shares V_k, each of records whose noise is known from n_k degrees of freedom.
It is distributed nearly as chi-square over nu is, of

    nu = (sum V_k)^2 / sum(V_k^2 / n_k)

degrees of freedom (F. E. Satterthwaite, Biometrics Bulletin 2(6), 1946; B. L. Welch, Biometrika 34, 1947): exactly so
where one record, or the noise of all, tells all of it.  Noise that is given has infinitely many.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from ..parameter_transform import ParameterTransform
from ..problem import Problem

NORMAL_95 = 1.959964
"""Half width of a 95 % interval in standard errors, where the noise is known."""


def half_width_95(freedom: Float[np.ndarray, "..."] | float) -> Float[np.ndarray, "..."]:
    """Half width of a 95 % interval in standard errors, by the degrees of `freedom` of their estimate."""
    known = np.isfinite(freedom)
    if not np.any(known):
        return np.full(np.shape(freedom), NORMAL_95)
    from scipy.special import stdtrit  # an eighth of a second

    return np.where(known, stdtrit(freedom, 0.975), NORMAL_95)


def effective_freedom(
    variance: Float[np.ndarray, " p"],
    shares: Sequence[Float[np.ndarray, " p"]],
    freedom: Sequence[float] | Float[np.ndarray, " k"],
    pooled: Sequence[bool] | Bool[np.ndarray, " k"],
) -> Float[np.ndarray, " p"]:
    """Degrees of freedom of the `variance` of each parameter; infinite where it is not known, or all noise is.

    **Arguments:** the `shares` that records have in it, and from how many degrees of `freedom` the noise of each is
    known; `pooled` are records whose noise is known from all of them together, with the same freedom.
    """
    together = sum((share for share, use in zip(shares, pooled, strict=True) if use), np.zeros(variance.size))
    uncertain = together**2 / max((n for n, use in zip(freedom, pooled, strict=True) if use), default=np.inf)
    for share, degrees, use in zip(shares, freedom, pooled, strict=True):
        if not use:
            uncertain = uncertain + share**2 / degrees
    known = np.isfinite(variance) & (uncertain > 0.0)
    return np.where(known, variance**2 / np.where(known, uncertain, 1.0), np.inf)


def record_factors(problem: Problem, factor: float) -> Float[np.ndarray, " records"]:
    """The `factor` for records whose noise is given, 1 for the others."""
    return np.array([1.0 if record.noise is None else factor for record in problem.records])


def row_factors(problem: Problem, factor: float) -> Float[np.ndarray, " n"]:
    """The factors of all residuals; what was measured apart has the error given, whatever the samples are off by."""
    sizes = [record.time.size for record in problem.records]
    return np.append(np.repeat(record_factors(problem, factor), sizes), np.ones(len(problem.residual.prior.paths)))


def linear_intervals(
    at: Float[np.ndarray, " p"],
    deviation: Float[np.ndarray, " p"],
    freedom: Float[np.ndarray, " p"],
    free: ParameterTransform,
    bounds: Mapping[str, tuple[float, float]],
) -> dict[str, tuple[float, float]]:
    """The interval [SI] around the point `at`, by path, NaN where the `deviation` is; both on the fit's scale.

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
