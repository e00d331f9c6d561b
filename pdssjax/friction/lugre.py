"""LuGre friction (5.8-5.10): bristles with a Stribeck curve and viscous friction.

    z' = v - s0 |v| z / g(v),   F = s0 z + s1 z' + s2 v,
    g(v) = f_c + (f_s - f_c) exp(-(v/v_s)^2).

Steady sliding takes sign(v) g(v) + s2 v; at rest the contact is a spring s0 with a damper
s1 + s2.  A bounded force that swings below breakaway about a bias makes it creep (drift).
With f_s >= f_c it cannot create energy if and only if s1 (f_s - f_c) <= s2 f_c; without
viscous friction that leaves f_s = f_c, the simplified law.

C. Canudas de Wit et al., IEEE Trans. Automatic Control 40(3), 1995; on passivity
N. Barabanov and R. Ortega, IEEE Trans. Automatic Control 45(4), 2000.
"""

from typing import ClassVar

import jax.numpy as jnp

from ..core import Scalar, ScalarLike
from ..integration import Term
from ._relaxation import relax
from ._stribeck_bristle import AbstractStribeckBristle
from ._stribeck_curve import stribeck_curve, stribeck_guard
from .base import State, Terms, deflection_scale


class LuGre(AbstractStribeckBristle):
    """One mean bristle deflection z [m], whose limit depends on the velocity; a flag tells fast sliding."""

    flags_shape_force: ClassVar = False

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        level = stribeck_curve(v, self.f_c, self.f_s, self.v_s)
        return v - v * state[0] * (self.sigma0 * sign) / level, 0

    def error_scale(self) -> State:
        return deflection_scale(self._least_yielding()), jnp.ones(())

    def guards(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        return (stribeck_guard(state[1], v, sign, self.v_s),)

    def after_event(self, state: State, v: Scalar, sign: ScalarLike, which: Scalar) -> State:
        return state[0], 1.0 - state[1]

    def on_reversal(self, state: State, sign: ScalarLike) -> State:
        return state[0], jnp.zeros_like(state[1])

    def slide(self, state: State, v: Scalar, elapsed: Scalar, sign: ScalarLike) -> State:
        level = jnp.asarray(stribeck_curve(v, self.f_c, self.f_s, self.v_s), float)
        return relax(state[0], sign * level / self.sigma0, self.sigma0 / level * (sign * v * elapsed)), state[1]
