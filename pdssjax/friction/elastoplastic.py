"""Elastoplastic friction (5.11-5.15): LuGre with a stage that is purely elastic.

    z' = v (1 - alpha(z, v) sign(v) z / z_ss(v)),   F = s0 z + s1 z' + s2 v,
    z_ss = g(v)/s0,   g(v) = f_c + (f_s - f_c) exp(-(v/v_s)^2).

With u = sign(v) z, alpha is 0 up to u = z_ba (elastic; all of u < 0, too),
1/2 + 1/2 sin(pi (u - (z_ss + z_ba)/2)/(z_ss - z_ba)) from there to z_ss (elastic and
plastic), and 1 beyond (plastic).  (5.15) prints 0 in place of that 1, which would leave no
steady sliding; its sine has lost the pi to the outside of the brackets.  Because nothing
yields below z_ba, an oscillating force that stays below s0 z_ba does not make the contact
drift.  LuGre is alpha = 1 everywhere; z_ba = 0 alone does not give it, because alpha still
rises from 0.

z_ba is given as a part of the smallest z_ss, so that it is always legal.  Flags tell the
three regions.  Between the last two, alpha and its slope agree, and a small hysteresis in
the switch keeps rounding from being taken for events: alpha is off by 3e-10 at most.

P. Dupont, V. Hayward, B. Armstrong and F. Altpeter, IEEE Trans. Automatic Control 47(5), 2002.
"""

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..integration import Term, constant, cosine_and_sine
from ._stribeck_bristle import AbstractStribeckBristle
from ._stribeck_curve import stribeck_curve, stribeck_guard
from .base import State, Terms, deflection_scale

_HYSTERESIS = 1e-5
"""Part of z_ss - z_ba by which z has to pass z_ss before the region changes."""

_MIXING = 1e-7
"""How alpha bends counts as a displacement [m] of so much, over 1 - `elastic_part`, where steps are to resolve it."""


class Elastoplastic(AbstractStribeckBristle):
    """One bristle deflection z [m] that first only stretches; flags: mixed, plastic region, fast."""

    elastic_part: float = quantity(0.6, "", positive=False, low=0.0, high=1.0)
    """Breakaway displacement z_ba as a part of the smallest z_ss: s0 z_ba / min(f_c, f_s)."""

    def breakaway(self) -> ScalarLike:
        """Breakaway displacement z_ba [m]."""
        return self.elastic_part * self._least_yielding()

    def _steady(self, v: Term) -> Term:
        return stribeck_curve(v, self.f_c, self.f_s, self.v_s) * (1.0 / self.sigma0)

    def _mixing(self, u: Term, end: Term) -> tuple[Term, Term]:
        """Cosine and sine of the angle of alpha, with `end` the steady deflection z_ss [m]."""
        begin = self.breakaway()
        return cosine_and_sine((u - (end + begin) * 0.5) * jnp.pi / (end - begin))

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        z, mixed, plastic, _ = state
        u, end = z * sign, self._steady(v)
        _, sine = self._mixing(u, end)
        alpha = mixed * (sine * 0.5 + 0.5) + plastic
        return v - alpha * (v * u) / end, 0, 0, 0

    def extra_error_terms(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        # Towards steady sliding the deflection follows a logistic curve, which has poles beside the time axis.  What is
        # left of it soon is below any tolerance, but its derivatives grow in a step that comes near them.
        cosine, _ = self._mixing(state[0] * sign, self._steady(v))
        narrow = state[1] * cosine * (_MIXING / (1.0 - self.elastic_part))
        return (*super().extra_error_terms(state, v, sign), narrow)

    def error_scale(self) -> State:
        return deflection_scale(self._least_yielding()), jnp.ones(()), jnp.ones(()), jnp.ones(())

    def guards(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        z, mixed, plastic, fast = state
        u, begin, end = z * sign, self.breakaway(), self._steady(v)
        margin = (end - begin) * _HYSTERESIS
        is_yielding = (begin - u) * (1.0 - mixed - plastic) + (end + margin - u) * mixed + plastic
        recovers = (u - end + margin) * plastic + (1.0 - plastic)
        return is_yielding, recovers, stribeck_guard(fast, v, sign, self.v_s)

    def after_event(self, state: State, v: Scalar, sign: ScalarLike, which: Scalar) -> State:
        z, mixed, plastic, fast = state
        is_yielding = jnp.where(which == 0, 1.0, 0.0)
        region = which < 2
        mixes, flows = 1.0 - is_yielding * mixed, is_yielding * mixed
        return (
            z,
            jnp.where(region, mixes, mixed),
            jnp.where(region, flows, plastic),
            jnp.where(region, fast, 1.0 - fast),
        )

    def on_reversal(self, state: State, sign: ScalarLike) -> State:
        u = state[0] * sign
        plastic = jnp.where(u >= constant(self._steady(0.0)), 1.0, 0.0)
        mixed = jnp.where(u >= self.breakaway(), 1.0, 0.0) * (1.0 - plastic)
        return state[0], mixed, plastic, jnp.zeros_like(state[3])

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        return super().search_ranges(mass, acceleration, rate) | {"elastic_part": (0.2, 0.95)}
