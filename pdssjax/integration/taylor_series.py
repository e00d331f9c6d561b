"""Arithmetic of power series, enough to expand a vector field along its solution.

A `Series` holds the coefficients c0, c1, … of c0 + c1 h + c2 h^2 + …, each computed when it
is first asked for.  Sums, products, quotients and the elementary functions below follow from
the usual recurrences (R. E. Moore, Interval Analysis, 1966, chapter 11), and with them the
Taylor series of the solution of x' = f(t, x), one coefficient after the other.  A coefficient that is known to
vanish is the integer 0, and costs nothing.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax.numpy as jnp


class Series:
    """A power series; combines with series and with scalars by + - * /."""

    __array_ufunc__ = None  # let numpy scalars on the left defer to the methods below

    def __init__(self, rule: Callable[[int], Any], opaque_one: Any = None, costly: bool = False):
        self._rule = rule
        self._known: list[Any] = []
        self.opaque_one = opaque_one
        """1 in a way that the compiler cannot know, or None; goes on to whatever is made of the series."""
        self._costly = costly and opaque_one is not None

    def __getitem__(self, k: int) -> Any:
        while len(self._known) <= k:
            coefficient = self._rule(len(self._known))
            # A division is done once; without it XLA repeats the whole recurrence in every place that needs it.
            self._known.append(
                coefficient / self.opaque_one if self._costly and not is_zero(coefficient) else coefficient
            )
        return self._known[k]

    def __add__(self, other):
        if isinstance(other, Series):
            return Series(lambda k: _plus(self[k], other[k]), _opaque_one(self, other))
        return Series(lambda k: _plus(self[0], other) if k == 0 else self[k], self.opaque_one)

    def __neg__(self):
        return self * (-1.0)

    def __sub__(self, other):
        return self + other * (-1.0)

    def __rsub__(self, other):
        return self * (-1.0) + other

    def __mul__(self, other):
        if isinstance(other, Series):
            rule = lambda k: _total(_times(self[i], other[k - i]) for i in range(k + 1))
            return Series(rule, _opaque_one(self, other), costly=True)
        return Series(lambda k: _times(self[k], other), self.opaque_one)

    def __truediv__(self, other):
        if not isinstance(other, Series):
            return self * (1.0 / other)

        def rule(k):
            known = _total(_times(quotient[i], other[k - i]) for i in range(k))
            return _times(_plus(self[k], _times(known, -1.0)), 1.0 / other[0])

        quotient = Series(rule, _opaque_one(self, other), costly=True)
        return quotient

    def __rtruediv__(self, other):
        return polynomial([other]) / self

    __radd__ = __add__
    __rmul__ = __mul__


def _opaque_one(x: Series, y: Series) -> Any:
    return y.opaque_one if x.opaque_one is None else x.opaque_one


def polynomial(coefficients: Sequence[Any], opaque_one: Any = None) -> Series:
    """The series that ends with the last of `coefficients`, lowest first; may still grow."""
    return Series(lambda k: coefficients[k] if k < len(coefficients) else 0, opaque_one)


def is_zero(x: Any) -> bool:
    """The integer 0, which marks what is known to vanish."""
    return isinstance(x, int) and x == 0


def constant(x: Any) -> Any:
    """The value of a series at its start; a number is its own."""
    return x[0] if isinstance(x, Series) else x


def exp(x: Any) -> Any:
    """e to the power x, of a series or of a number: y' = x' y."""
    if not isinstance(x, Series):
        return jnp.exp(x)

    def rule(k):
        if k == 0:
            return jnp.exp(jnp.asarray(x[0], float))
        return _times(_total(_times(_times(x[i], y[k - i]), float(i)) for i in range(1, k + 1)), 1.0 / k)

    y = Series(rule, x.opaque_one, costly=True)
    return y


def power(x: Any, exponent: Any) -> Any:
    """x to a real power, of a series or of a number, for x > 0: x y' = exponent x' y."""
    if not isinstance(x, Series):
        return jnp.exp(exponent * jnp.log(x))

    def rule(k):
        if k == 0:
            return jnp.exp(exponent * jnp.log(jnp.asarray(x[0], float)))
        terms = (_times(_times(x[i], y[k - i]), i * (exponent + 1.0) - k) for i in range(1, k + 1))
        return _times(_total(terms), 1.0 / (k * x[0]))

    y = Series(rule, x.opaque_one, costly=True)
    return y


def cosine_and_sine(x: Any) -> tuple[Any, Any]:
    """The cosine and the sine of a series or of a number, which need each other: c' = -x' s, s' = x' c."""
    if not isinstance(x, Series):
        return jnp.cos(x), jnp.sin(x)

    def rule(start, other, sign):
        def coefficient(k):
            if k == 0:
                return start(jnp.asarray(x[0], float))
            total = _total(_times(_times(x[i], other()[k - i]), float(i)) for i in range(1, k + 1))
            return _times(total, sign / k)

        return coefficient

    cosine = Series(rule(jnp.cos, lambda: sine, -1.0), x.opaque_one, costly=True)
    sine = Series(rule(jnp.sin, lambda: cosine, 1.0), x.opaque_one, costly=True)
    return cosine, sine


def taylor_coefficients(
    field: Callable, time: Any, state: Sequence[Any], order: int, opaque_one: Any, divide: bool = False
) -> list[list[Any]]:
    """Taylor coefficients of the solution of x' = field(t, x) through `state` at `time`.

    **Arguments:** `field(t, x)` takes a `Series` for the time and a list of them for the
    state, and returns a list of series or scalars, using + - * / and the functions above; the
    integer 0 for what is constant.  `opaque_one` is 1 in a
    way that the compiler cannot know: dividing by it makes each order a vector computed
    once, where XLA would otherwise repeat cheap scalars in every place that needs them.

    With `divide` the products within an order are computed once, too: that is compiled faster, and
    runs faster side by side, but slower alone.

    **Returns:** for each component a list of `order + 1` coefficients.
    """
    known = [[x] for x in state]
    inner = opaque_one if divide else None
    rates = field(polynomial([time, 1.0], inner), [polynomial(c, inner) for c in known])
    for k in range(order):
        orders = [rate[k] if isinstance(rate, Series) else (rate if k == 0 else 0) for rate in rates]
        moving = [i for i, c in enumerate(orders) if not is_zero(c)]
        for i, coefficients in enumerate(known):
            if i not in moving:
                coefficients.append(0)
        if moving:
            vector = jnp.stack([jnp.asarray(orders[i], float) for i in moving]) / ((k + 1) * opaque_one)
            for place, i in enumerate(moving):
                known[i].append(vector[place])
    return known


def weighted(x: Any, weight: Any) -> Any:
    """`x` times a number; what is known to vanish stays so."""
    return 0 if is_zero(x) else x * weight


def _plus(x: Any, y: Any) -> Any:
    return y if is_zero(x) else x if is_zero(y) else x + y


def _times(x: Any, y: Any) -> Any:
    return 0 if is_zero(x) or is_zero(y) else x * y


def _total(terms) -> Any:
    total = 0
    for term in terms:
        total = _plus(total, term)
    return total
