"""How far estimates lie from what was measured apart: the pull.

An estimate p combines the told value t, of standard error s, with the records, and is correlated with it:

    var(p - t) = var(p) + s^2 - 2 cov(p, t)

cov(p, t) is s^2 times how far the estimate follows t.  Where residuals are as large as the noise given and all is
fitted at once it is var(p), and the pull is (p - t) / sqrt(s^2 - var(p)), as in fits with constraints in particle
physics (L. Demortier and L. Lyons, Everything you always wanted to know about pulls, CDF/ANAL/PUBLIC/5776, 2002).
"""

import math

from ..study import MeasuredApart

_SEEN = 0.1
"""Standard deviation of the difference over the standard error told, below which the records tell next to nothing: the
error of the estimate is 99.5 % of that told, or more."""


def measured_apart(told: tuple[float, float], value: float, variance: float, covariance: float) -> MeasuredApart:
    """What was `told` of a parameter, number and standard error, beside its estimate; all in its unit.

    **Arguments:** the estimate's `value` and `variance`, NaN where not known, and its `covariance` with what was told.
    """
    number, error = told
    difference = variance + error**2 - 2.0 * covariance
    seen = difference > (_SEEN * error) ** 2
    return MeasuredApart(number, error, (value - number) / math.sqrt(difference) if seen else math.nan)
