"""Student's t: how wide a 95 % interval is where the noise that its error rests on was estimated.

The variance of a parameter is a sum of shares V_k, each of records whose noise is known from n_k degrees of freedom.
It is distributed nearly as chi-square over nu is, of

    nu = (sum V_k)^2 / sum(V_k^2 / n_k)

degrees of freedom (F. E. Satterthwaite, Biometrics Bulletin 2(6), 1946; B. L. Welch, Biometrika 34, 1947): exactly so
where one record, or the noise of all, tells all of it.  Noise that is given has infinitely many.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

NORMAL_95 = 1.959964
"""Half width of a 95 % interval in standard errors, where the noise is known."""


def half_width_95(freedom: Float[np.ndarray, "..."] | float) -> Float[np.ndarray, "..."]:
    """Half width of a 95 % interval in standard errors, by the degrees of `freedom` of their estimate."""
    from scipy.special import stdtrit

    return np.where(np.isfinite(freedom), stdtrit(freedom, 0.975), NORMAL_95)


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
