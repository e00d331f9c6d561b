"""How a lag and a second-order system that begin at rest follow t^k, to rounding at any time.

    tau r' + r = t^k                    r_k = t^k h_k(t / tau),   h_k = 1 - k h_(k-1) / x
    r'' + 2 xi w r' + w^2 r = w^2 t^k   r_k = t^k h_k(w t, xi),   h_k = 1 - 2 xi k h_(k-1) / x - k (k - 1) h_(k-2) / x^2

The recurrences follow from r_k' = k r_(k-1).  Upwards from h_0 they multiply an error by k! / x^k, as the steady
solution, a polynomial, loses as many digits against the transient; downwards, where they sum the Taylor series, by
x^k / k!.  Where x^k = k! at the highest power asked for, neither has grown an error on its way, and there one takes
over from the other (W. Gautschi, SIAM Review 9(1), 1967).
"""

import math
from collections.abc import Callable
from functools import partial

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._oscillator import damped

Response = list[Float[Array, "*n"]]
"""h_0, h_1, ..."""

_SPLIT = 1.02
"""Damping ratio from which one root is at least half as large again as the other, and the response that of two lags."""


def lag_response(x: Float[Array, "*n"], degree: int) -> Response:
    """h_0 to h_degree of a lag at x = t / tau, from 0 on."""
    return _evaluated(partial(_first_order, degree), x)


def oscillator_response(x: Float[Array, "*n"], damping: Float[Array, ""], degree: int) -> Response:
    """h_0 to h_degree of a second-order system at x = w t, from 0 on, for any damping ratio above 0."""
    return _evaluated(partial(_second_order, degree), x, jnp.broadcast_to(damping, x.shape))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def _evaluated(response: Callable[..., Response], *numbers: Float[Array, "*n"]) -> Response:
    return response(*numbers)


@_evaluated.defjvp
def _tangent(
    response: Callable[..., Response], numbers: tuple[Array, ...], tangents: tuple[Array, ...]
) -> tuple[Response, Response]:
    """One run of the recurrences for each number, however many columns a Jacobian has."""
    total = [jnp.zeros(())] * len(jax.eval_shape(response, *numbers))
    for i, tangent in enumerate(tangents):
        alone = tuple(jnp.full_like(number, i == j) for j, number in enumerate(numbers))
        slopes = jax.jvp(response, numbers, alone)[1]
        total = [t + slope * tangent for t, slope in zip(total, slopes, strict=True)]
    return response(*numbers), total


def _first_order(degree: int, x: Float[Array, "*n"]) -> Response:
    limit, first = _limit(degree)
    early, small, large = _sides(x, limit)
    series = [jnp.zeros_like(x)]
    for k in range(first, 0, -1):
        series.insert(0, small / k * (1.0 - series[0]))
    steady = [-jnp.expm1(-large)]
    for k in range(1, degree + 1):
        steady.append(1.0 - k / large * steady[-1])
    return [jnp.where(early, s, t) for s, t in zip(series, steady, strict=False)]


def _second_order(degree: int, x: Float[Array, "*n"], damping: Float[Array, "*n"]) -> Response:
    apart = jnp.where(damping > _SPLIT, damping, 2.0)
    faster = apart + jnp.sqrt(apart**2 - 1.0)
    # Early on the two lags cancel, and the series sees to both roots.
    split = (damping > _SPLIT) & (x * faster > 1.0)
    near = _one_frequency(degree, x, jnp.where(split, 1.0, damping))
    slow, fast = _first_order(degree, x / faster), _first_order(degree, x * faster)
    far = [(faster**2 * s - f) / (faster**2 - 1.0) for s, f in zip(slow, fast, strict=True)]
    return [jnp.where(split, f, n) for f, n in zip(far, near, strict=True)]


def _one_frequency(degree: int, x: Float[Array, "*n"], damping: Float[Array, "*n"]) -> Response:
    """That of a system whose roots are a complex pair, or near each other, or both slow against 1 / t."""
    limit, first = _limit(degree)
    early, small, large = _sides(x, limit)
    series = [jnp.zeros_like(x), jnp.zeros_like(x)]
    for k in range(first, 1, -1):
        push = small**2 / (k * (k - 1)) * (1.0 - series[1])
        series.insert(0, push - 2.0 * damping * small / (k - 1) * series[0])
    missing, speed = damped(-jnp.ones_like(large), jnp.zeros_like(large), 1.0, damping, large)
    steady = [1.0 + missing]
    steady.append(1.0 - (2.0 * damping * steady[0] + speed) / large)
    for k in range(2, degree + 1):
        steady.append(1.0 - 2.0 * damping * k / large * steady[-1] - k * (k - 1) / large**2 * steady[-2])
    return [jnp.where(early, s, t) for s, t in zip(series, steady[: degree + 1], strict=False)]


def _limit(degree: int) -> tuple[float, int]:
    """The x at which the recurrences take turns, and the power from which the series is summed there, to rounding."""
    limit = math.factorial(degree) ** (1.0 / degree) if degree else 1.0
    power, term = degree, 1.0
    while term > 1e-19:
        power += 1
        term *= limit / power
    return limit, power


def _sides(x: Float[Array, "*n"], limit: float) -> tuple[Bool[Array, "*n"], Array, Array]:
    """Whether x is below the limit, and for either recurrence an x that it can take."""
    early = x < limit
    return early, jnp.where(early, x, 0.0), jnp.where(early, limit, x)
