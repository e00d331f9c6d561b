"""Arithmetic of power series, enough to expand a vector field along its solution.

A `Series` holds the coefficients c0, c1, … of c0 + c1 h + c2 h^2 + …, each computed when it
is first asked for.  Sums, products, quotients and the elementary functions below follow from
the usual recurrences (R. E. Moore, Interval Analysis, 1966, chapter 11), and with them the
Taylor series of the solution of x' = f(t, x), one coefficient after the other.  A coefficient that is known to
vanish is the integer 0, and costs nothing.

Every rule `(k, itself, operands, numbers)` gives coefficient k of the series `itself` from its operands, which are
series, and its numbers.  It is written so that `taylor_loop` can use it for a traced k, too: it asks for
coefficients 0 and k, and for the sum of the products between them.
"""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Protocol, Self, TypeAlias, TypeVar, overload

import jax.numpy as jnp

from ..core import Count, InputError, Scalar, ScalarLike
from .tracing import plus, times

Order: TypeAlias = int | Count
"""The order of a coefficient; traced within the loop of `taylor_loop`."""

Weight: TypeAlias = Callable[[int], ScalarLike]
"""The weight of a term of a sum, by its index."""


class Coefficients(Protocol):
    """What a rule asks of a series: coefficients 0 and k, and the sum of the products between them."""

    def __getitem__(self, k: Order, /) -> ScalarLike: ...

    def inner_products(self, other: Self, k: Order, weight: Weight | None = None) -> ScalarLike: ...


Operands: TypeAlias = tuple[Coefficients, ...]
Numbers: TypeAlias = tuple[ScalarLike, ...]

Rule: TypeAlias = Callable[[Order, Coefficients, Operands, Numbers], ScalarLike]
"""(k, itself, operands, numbers) to coefficient k of the series `itself`; the integer 0 is known to vanish."""


class Series:
    """A power series; combines with series and with scalars by + - * /."""

    __array_ufunc__ = None  # let numpy scalars on the left defer to the methods below

    def __init__(self, rule: Rule, operands: "tuple[Series, ...]" = (), numbers: Numbers = ()):
        self.rule = rule
        self.operands = operands
        self.numbers = numbers
        self._known: list[ScalarLike] = []
        self._products: dict[int, Series] = {}

    def __getitem__(self, k: Order) -> ScalarLike:
        while len(self._known) <= k:
            self._known.append(self.rule(len(self._known), self, self.operands, self.numbers))
        return self._known[k]

    def append(self, coefficient: ScalarLike) -> None:
        """The next coefficient, from outside."""
        self._known.append(coefficient)

    def inner_products(self, other: "Series", k: Order, weight: Weight | None = None) -> ScalarLike:
        """The sum of weight(i) self[i] other[k - i] over 0 < i < k."""
        terms = (_times(self[i], other[k - i]) for i in range(1, k))
        if weight is not None:
            terms = (_times(term, weight(i)) for i, term in enumerate(terms, start=1))
        return total(terms)

    def __add__(self, other: "Term") -> "Series":
        return Series(sum_rule, (self, other)) if isinstance(other, Series) else Series(shift_rule, (self,), (other,))

    def __neg__(self) -> "Series":
        return self * (-1.0)

    def __sub__(self, other: "Term") -> "Series":
        return self + other * (-1.0)

    def __rsub__(self, other: "Term") -> "Series":
        return self * (-1.0) + other

    def __mul__(self, other: "Term") -> "Series":
        if not isinstance(other, Series):
            return Series(scale_rule, (self,), (other,))
        # Products of the same two series, whatever their factors, are computed once.
        for x, y in ((self, other), (other, self)):
            if x.rule is scale_rule:
                return (x.operands[0] * y) * x.numbers[0]
            if id(y) in x._products:
                return x._products[id(y)]
        self._products[id(other)] = product = Series(product_rule, (self, other))
        return product

    def __truediv__(self, other: "Term") -> "Series":
        return Series(quotient_rule, (self, other)) if isinstance(other, Series) else self * (1.0 / other)

    def __rtruediv__(self, other: ScalarLike) -> "Series":
        return polynomial([other]) / self

    __radd__ = __add__
    __rmul__ = __mul__


Term: TypeAlias = Series | ScalarLike
"""A component of a field: a power series in the time, or a number; the integer 0 is known to vanish."""

N = TypeVar("N", Scalar, Term)
"""Numbers where numbers are given, else components of a field."""

N_co = TypeVar("N_co", covariant=True)
"""A component of a state: a number, or a component of a field."""

Field: TypeAlias = Callable[[Term, Sequence[Term]], Sequence[Term]]
"""(t, x) to the time derivative of x, component by component."""


def polynomial(coefficients: Sequence[ScalarLike]) -> Series:
    """The series that ends with the last of `coefficients`, lowest first."""
    return Series(polynomial_rule, (), tuple(coefficients))


def unknown(start: ScalarLike) -> Series:
    """A series of which the first coefficient is known; the others are appended."""
    series = Series(unknown_rule)
    series.append(start)
    return series


def is_zero(x: object) -> bool:
    """The integer 0, which marks what is known to vanish."""
    return isinstance(x, int) and x == 0


def constant(x: Term) -> ScalarLike:
    """The value of a series at its start; a number is its own."""
    return x[0] if isinstance(x, Series) else x


@overload
def exp(x: Series) -> Series: ...
@overload
def exp(x: ScalarLike) -> Scalar: ...
def exp(x: Term) -> Term:
    """e to the power x, of a series or of a number: y' = x' y."""
    return Series(exp_rule, (x,)) if isinstance(x, Series) else jnp.exp(x)


@overload
def power(x: Series, exponent: ScalarLike) -> Series: ...
@overload
def power(x: ScalarLike, exponent: ScalarLike) -> Scalar: ...
def power(x: Term, exponent: ScalarLike) -> Term:
    """x to a real power, of a series or of a number, for x > 0: x y' = exponent x' y."""
    return Series(power_rule, (x,), (exponent,)) if isinstance(x, Series) else jnp.exp(exponent * jnp.log(x))


def cosine_and_sine(x: Term) -> tuple[Term, Term]:
    """The cosine and the sine of a series or of a number, which need each other: c' = -x' s, s' = x' c."""
    if not isinstance(x, Series):
        return jnp.cos(x), jnp.sin(x)
    cosine, sine = Series(cosine_rule), Series(sine_rule)
    cosine.operands, sine.operands = (x, sine), (x, cosine)
    return cosine, sine


@contextlib.contextmanager
def expanding(what: str) -> Iterator[None]:
    """Say what series can pass where `what` a user wrote cannot take them, by an `InputError`."""
    try:
        yield
    except (TypeError, AttributeError) as error:
        raise InputError(
            f"{what}: found what a Taylor series cannot pass ({error!s:.120}), expected + - * / and the functions exp, "
            "power and cosine_and_sine of pdssjax.integration in place of ** and of those of jax.numpy."
        ) from error


def taylor_coefficients(
    field: Field, time: ScalarLike, state: Sequence[ScalarLike], order: int, opaque_one: Scalar
) -> list[list[ScalarLike]]:
    """Taylor coefficients of the solution of x' = field(t, x) through `state` at `time`.

    **Arguments:** `field(t, x)` takes a `Series` for the time and a list of them for the
    state, and returns a list of series or scalars, using + - * / and the functions above; the
    integer 0 for what is constant.  `opaque_one` is 1 in a
    way that the compiler cannot know: as a factor it makes each order a vector computed
    once, where XLA would otherwise repeat cheap scalars in every place that needs them.

    **Returns:** for each component a list of `order + 1` coefficients.
    """
    known = [unknown(x) for x in state]
    with expanding("the field that is integrated"):
        rates = field(polynomial([time, 1.0]), known)
    for k in range(order):
        orders = [rate[k] if isinstance(rate, Series) else (rate if k == 0 else 0) for rate in rates]
        varying = [i for i, c in enumerate(orders) if not is_zero(c)]
        part = 1.0 / (k + 1) * opaque_one
        vector = jnp.stack([jnp.asarray(orders[i], float) for i in varying]) * part if varying else None
        for i, series in enumerate(known):
            series.append(vector[varying.index(i)] if vector is not None and i in varying else 0)
    return [[series[k] for k in range(order + 1)] for series in known]


def polynomial_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    return numbers[k] if k < len(numbers) else 0


def unknown_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    raise IndexError(f"found no coefficient {k} of the solution yet, expected one below it")


def sum_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    x, y = operands
    return _plus(x[k], y[k])


def shift_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    return _plus(operands[0][k], numbers[0] if is_zero(k) else 0)


def scale_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    return _times(operands[0][k], numbers[0])


def product_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    x, y = operands
    if is_zero(k):
        return _times(x[0], y[0])
    return total((_times(x[0], y[k]), x.inner_products(y, k), _times(x[k], y[0])))


def quotient_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    x, y = operands
    known = 0 if is_zero(k) else _plus(_times(itself[0], y[k]), itself.inner_products(y, k))
    return _times(_plus(x[k], _times(known, -1.0)), 1.0 / y[0])


def exp_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    (x,) = operands
    return jnp.exp(jnp.asarray(x[0], float)) if is_zero(k) else _times(_slopes(k, x, itself), 1.0 / k)


def power_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    (x,), (exponent,) = operands, numbers
    if is_zero(k):
        return jnp.exp(exponent * jnp.log(jnp.asarray(x[0], float)))
    past = x.inner_products(itself, k, lambda i: i * (exponent + 1.0) - k)
    return _times(_plus(past, _times(_times(x[k], itself[0]), k * exponent)), 1.0 / (k * x[0]))


def cosine_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    x, sine = operands
    return jnp.cos(jnp.asarray(x[0], float)) if is_zero(k) else _times(_slopes(k, x, sine), -1.0 / k)


def sine_rule(k: Order, itself: Coefficients, operands: Operands, numbers: Numbers) -> ScalarLike:
    x, cosine = operands
    return jnp.sin(jnp.asarray(x[0], float)) if is_zero(k) else _times(_slopes(k, x, cosine), 1.0 / k)


def _slopes(k: Order, x: Coefficients, y: Coefficients) -> ScalarLike:
    """The sum of i x[i] y[k - i] over 0 < i <= k."""
    return _plus(x.inner_products(y, k, lambda i: i * 1.0), _times(_times(x[k], y[0]), k * 1.0))


def weighted(x: Term, weight: ScalarLike) -> Term:
    """`x` times a number; what is known to vanish stays so."""
    return 0 if is_zero(x) else x * weight


def _plus(x: ScalarLike, y: ScalarLike) -> ScalarLike:
    return y if is_zero(x) else x if is_zero(y) else plus(x, y)


def _times(x: ScalarLike, y: ScalarLike) -> ScalarLike:
    return 0 if is_zero(x) or is_zero(y) else times(x, y)


def total(terms: Iterable[ScalarLike]) -> ScalarLike:
    """The sum of terms of which some are known to vanish."""
    found = 0
    for term in terms:
        found = _plus(found, term)
    return found
