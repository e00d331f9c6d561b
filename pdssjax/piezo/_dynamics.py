"""The mechanics of a composed stack: from the aim of its ceramic to the motion of the platform.

    static        y = e
    first-order   tau y' + y = e
    modes         y = y_1 + … + y_n,   y_j'' + 2 xi_j w_j y_j' + w_j^2 y_j = g_j w_j^2 e   [ + F / m_j ]

The aim e(t) [m] is the sum of a memoryless part, the outputs of hysteresis and of creep.  Where the
voltage is a straight line it is a polynomial, ramps that set in as elements let go, and
exponentials; the response to each is known in closed form, and they add up.

The response of a lag and of a second-order system that begin at rest to t^k is found to rounding at any time:

    tau r' + r = t^k                    r_k = t^k h_k(t / tau),   h_k = 1 - k h_(k-1) / x
    r'' + 2 xi w r' + w^2 r = w^2 t^k   r_k = t^k h_k(w t, xi),   h_k = 1 - 2 xi k h_(k-1) / x - k (k - 1) h_(k-2) / x^2

The recurrences follow from r_k' = k r_(k-1).  Upwards from h_0 they multiply an error by k! / x^k, as the steady
solution, a polynomial, loses as many digits against the transient; downwards, where they sum the Taylor series, by
x^k / k!.  Where x^k = k! at the highest power asked for, neither has grown an error on its way, and there one takes
over from the other (W. Gautschi, SIAM Review 9(1), 1967).
"""

import abc
import math
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ..core import Scalar, ScalarLike
from ..integration import N, Term
from ._oscillator import accelerated, damped

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
    """The response of a system whose roots are a complex pair, or near each other, or both slow against 1 / t."""
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


_FAST = 1e4
"""Angular frequency [rad/s] that sets the scale between velocity and displacement where nothing oscillates."""

_NEAR = 1e-3
"""Product of time and difference of two rates below which their exponentials are taken from a series."""


class Aim(NamedTuple):
    """The displacement aimed at, from now on, while the voltage is a straight line."""

    polynomial: tuple[Scalar, ...]
    """Coefficients of 1, t, t^2, ... [m], [m/s], ..."""
    ramps: Float[Array, " n"]
    """Slopes [m/s] that are added once an element has let go."""
    begins: Float[Array, " n"]
    """When [s]."""
    amplitudes: Float[Array, " m"]
    """Amplitudes of the parts that decay as exp(-rate t) [m]."""
    rates: Float[Array, " m"]
    """[1/s]"""


class AbstractDynamics(eqx.Module):
    """States of the mechanics alone, a tuple of scalars; e, e' and e'' are the aim and its time derivatives."""

    @abc.abstractmethod
    def initial(self, aim: Scalar) -> tuple[Scalar, ...]:
        """The states at rest where the aim has long been `aim` [m]."""

    @abc.abstractmethod
    def rates(self, states: tuple[Term, ...], aim: Term, force: Term) -> tuple[Term, ...]:
        """Time derivatives of the states, with `force` [N] on the platform."""

    @abc.abstractmethod
    def platform(self, states: tuple[N, ...], aim: N, aim_rate: N) -> tuple[N, N]:
        """Displacement [m] and velocity [m/s]."""

    @abc.abstractmethod
    def acceleration(self, states: tuple[Term, ...], aim: Term, aim_rate: Term, aim_bend: Term) -> Term:
        """y'' [m/s2] without a force."""

    @abc.abstractmethod
    def advanced(self, states: tuple[Scalar, ...], aim: Aim, elapsed: ScalarLike) -> tuple[Scalar, ...]:
        """The states `elapsed` [s] later, exactly, without a force."""

    @abc.abstractmethod
    def scales(self) -> tuple[Scalar, ...]:
        """Displacement [m] that a unit of each state stands for."""

    @abc.abstractmethod
    def frequency_scale(self) -> Scalar:
        """The fastest angular frequency [rad/s] that matters."""

    def mass(self) -> Scalar:
        """Effective mass seen by a force on the platform [kg]; infinite where no force moves it."""
        return jnp.asarray(jnp.inf)


class Static(AbstractDynamics):
    """The platform is where the ceramic aims."""

    def initial(self, aim: Scalar) -> tuple[Scalar, ...]:
        return ()

    def rates(self, states: tuple[Term, ...], aim: Term, force: Term) -> tuple[Term, ...]:
        return ()

    def platform(self, states: tuple[N, ...], aim: N, aim_rate: N) -> tuple[N, N]:
        return aim, aim_rate

    def acceleration(self, states: tuple[Term, ...], aim: Term, aim_rate: Term, aim_bend: Term) -> Term:
        return aim_bend

    def advanced(self, states: tuple[Scalar, ...], aim: Aim, elapsed: ScalarLike) -> tuple[Scalar, ...]:
        return ()

    def scales(self) -> tuple[Scalar, ...]:
        return ()

    def frequency_scale(self) -> Scalar:
        return jnp.asarray(_FAST)


class FirstOrder(AbstractDynamics):
    """A lag: an amplifier that charges the stack, or mechanics damped so much that one root is all that shows."""

    time_constant: ScalarLike
    """tau [s]"""

    def initial(self, aim: Scalar) -> tuple[Scalar, ...]:
        return (aim,)

    def rates(self, states: tuple[Term, ...], aim: Term, force: Term) -> tuple[Term, ...]:
        return ((aim - states[0]) * (1.0 / self.time_constant),)

    def platform(self, states: tuple[N, ...], aim: N, aim_rate: N) -> tuple[N, N]:
        return states[0], (aim - states[0]) * (1.0 / self.time_constant)

    def acceleration(self, states: tuple[Term, ...], aim: Term, aim_rate: Term, aim_bend: Term) -> Term:
        rate = 1.0 / self.time_constant
        return (aim_rate - (aim - states[0]) * rate) * rate

    def advanced(self, states: tuple[Scalar, ...], aim: Aim, elapsed: ScalarLike) -> tuple[Scalar, ...]:
        rate = 1.0 / self.time_constant
        level, *curve = aim.polynomial
        follows = lag_response(jnp.asarray(rate * elapsed, float), len(curve))
        late = jnp.maximum(elapsed - aim.begins, 0.0)
        ramps = jnp.sum(aim.ramps * late * lag_response(rate * late, 1)[1])
        decays = jnp.sum(aim.amplitudes * rate * _between(rate, aim.rates, elapsed))
        curved = _value([c * h for c, h in zip(curve, follows[1:], strict=True)], elapsed) * elapsed
        return (level + (states[0] - level) * jnp.exp(-rate * elapsed) + curved + ramps + decays,)

    def scales(self) -> tuple[Scalar, ...]:
        return (jnp.ones(()),)

    def frequency_scale(self) -> Scalar:
        return jnp.asarray(1.0 / self.time_constant, float)


class Mode(NamedTuple):
    """One mode of a stack."""

    share: ScalarLike
    """Gain from the aim to the mode [1]."""
    frequency: ScalarLike
    """w [rad/s]"""
    damping: ScalarLike
    """xi [1], any above 0."""
    mass: ScalarLike
    """Effective mass of the mode seen by a force on the platform [kg]."""


class Modal(AbstractDynamics):
    """Second-order systems side by side; pairs (y_j, y_j')."""

    modes: tuple[Mode, ...]

    def initial(self, aim: Scalar) -> tuple[Scalar, ...]:
        return tuple(x for mode in self.modes for x in (mode.share * aim, jnp.zeros(())))

    def rates(self, states: tuple[Term, ...], aim: Term, force: Term) -> tuple[Term, ...]:
        found: list[Term] = []
        for mode, y, w in self._pairs(states):
            pushed = accelerated(y, w, aim * mode.share, mode.frequency, mode.damping)
            found += [w, pushed + force * (1.0 / mode.mass)]
        return tuple(found)

    def platform(self, states: tuple[N, ...], aim: N, aim_rate: N) -> tuple[N, N]:
        y, w = states[0], states[1]
        for j in range(2, len(states), 2):
            y, w = y + states[j], w + states[j + 1]
        return y, w

    def acceleration(self, states: tuple[Term, ...], aim: Term, aim_rate: Term, aim_bend: Term) -> Term:
        total: Term = 0.0
        for mode, y, w in self._pairs(states):
            total = accelerated(y, w, aim * mode.share, mode.frequency, mode.damping) + total
        return total

    def advanced(self, states: tuple[Scalar, ...], aim: Aim, elapsed: ScalarLike) -> tuple[Scalar, ...]:
        found: list[Scalar] = []
        late = jnp.maximum(elapsed - aim.begins, 0.0)
        for mode, y, w in self._pairs(states):
            level, *curve = (mode.share * c for c in aim.polynomial)
            damping = jnp.asarray(mode.damping, float)
            follows = oscillator_response(jnp.asarray(mode.frequency * elapsed, float), damping, len(curve))
            stiff = 1.0 - 2.0 * mode.damping / mode.frequency * aim.rates + (aim.rates / mode.frequency) ** 2
            decays = mode.share * aim.amplitudes / stiff
            free, speed = damped(
                y - level - jnp.sum(decays), w + jnp.sum(aim.rates * decays), mode.frequency, mode.damping, elapsed
            )
            curved = _value([c * h for c, h in zip(curve, follows[1:], strict=True)], elapsed) * elapsed
            slope = _value([k * c * h for k, (c, h) in enumerate(zip(curve, follows, strict=False), start=1)], elapsed)
            fades = decays * jnp.exp(-aim.rates * elapsed)
            ramps = mode.share * aim.ramps
            begun, moving = oscillator_response(mode.frequency * late, damping, 1)[::-1]
            found += [
                level + curved + free + jnp.sum(fades) + jnp.sum(ramps * late * begun),
                slope + speed - jnp.sum(aim.rates * fades) + jnp.sum(ramps * moving),
            ]
        return tuple(found)

    def scales(self) -> tuple[Scalar, ...]:
        return tuple(x for mode in self.modes for x in (jnp.ones(()), jnp.asarray(1.0 / mode.frequency, float)))

    def frequency_scale(self) -> Scalar:
        # That of the mode that moves the platform: the others are over before it has begun to.
        return jnp.asarray(self.modes[0].frequency, float)

    def mass(self) -> Scalar:
        return jnp.asarray(1.0 / sum(1.0 / mode.mass for mode in self.modes), float)

    def _pairs(self, states: tuple[N, ...]) -> list[tuple[Mode, N, N]]:
        return [(mode, states[2 * j], states[2 * j + 1]) for j, mode in enumerate(self.modes)]


def shifted_powers(coefficients: tuple[ScalarLike, ...], at: ScalarLike, slope: ScalarLike) -> tuple[Scalar, ...]:
    """Coefficients of 1, t, t^2, ... of the sum of c_k v^k, k from 0 on, where v = `at` + `slope` t."""
    degree = len(coefficients) - 1
    found = []
    for power in range(degree + 1):
        terms = [coefficients[k] * math.comb(k, power) * at ** (k - power) for k in range(power, degree + 1)]
        found.append(jnp.asarray(sum(terms) * slope**power, float))
    return tuple(found)


def _value(polynomial: list[Scalar], t: ScalarLike) -> Scalar:
    total = jnp.zeros(())
    for coefficient in reversed(polynomial):
        total = total * t + coefficient
    return total


def _between(rate: ScalarLike, rates: Float[Array, " m"], t: ScalarLike) -> Float[Array, " m"]:
    """(exp(-rates t) - exp(-rate t)) / (rate - rates), which is t exp(-rate t) where they agree."""
    x = (rate - rates) * t
    near = jnp.abs(x) < _NEAR
    safe = jnp.where(near, 1.0, x)
    slow, fast = jnp.exp(-rates * t), jnp.exp(-rate * t)
    series = slow * (1.0 - x * (1.0 / 2 - x * (1.0 / 6 - x / 24)))
    return t * jnp.where(near, series, (slow - fast) / safe)
