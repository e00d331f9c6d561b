"""How far estimates lie from what was measured apart: the pull.

An estimate p combines the told value t, of standard error s, with the records, and is correlated with it:

    var(p - t) = var(p) + s^2 - 2 cov(p, t),    cov(p, t) = v

v is the variance that p has where residuals are as large as the noise given: the estimate follows t by v / s^2.  Where
they are, var(p) = v, and the pull is (p - t) / sqrt(s^2 - var(p)), as in fits with constraints in particle physics
(L. Demortier and L. Lyons, Everything you always wanted to know about pulls, CDF/ANAL/PUBLIC/5776, 2002).
"""

import math

from ..study import MeasuredApart

_SEEN = 0.1
"""Standard deviation of the difference over the standard error told, below which the records tell next to nothing: the
error of the estimate is 99.5 % of that told, or more."""


def measured_apart(told: tuple[float, float], value: float, variance: float, by_noise: float) -> MeasuredApart:
    """What was `told` of a parameter, number and standard error, beside its estimate; all in its unit.

    **Arguments:** the estimate's `value` and `variance`, NaN where not known, and its variance `by_noise` as given.
    """
    number, error = told
    difference = variance + error**2 - 2.0 * by_noise
    seen = difference > (_SEEN * error) ** 2
    return MeasuredApart(number, error, (value - number) / math.sqrt(difference) if seen else math.nan)
