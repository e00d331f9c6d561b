"""Bliman and Sorine's second-order friction: a fast Dahl element less a slow one.

    z_1' = v - |v| z_1/(eta eps),   z_2' = v - |v| z_2/eps,
    F = f_1 z_1/(eta eps) - f_2 z_2/eps,   0 < eta <= 1,

a linear system of second order in the path |x| = int |v| dt, driven by sign(v): F depends on
the path, not on how fast it is travelled.  Moved from rest, F overshoots: it is largest
after the path eta eps/(1 - eta) ln(f_1/(eta f_2)) and then falls to f_c = f_1 - f_2.  This
is stiction that needs no Stribeck curve.  f_c, f_2, eps and eta are the parameters; f_1 =
f_c + f_2, so that friction always brakes in the end.  With f_1 >= f_2 and eta <= 1 the law
cannot create energy in a motion that begins with z_1 = z_2 = 0: as a system in the path its transfer
function f_1/(1 + eta eps p) - f_2/(1 + eps p) is positive real.

f_2 = 0 leaves the first-order model, which is Dahl's with n = 1 and s0 = f_c/(eta eps).

P.-A. Bliman and M. Sorine, Easy-to-use realistic dry friction models for automatic control,
3rd European Control Conference, 1995.
"""

import math
from typing import ClassVar

import jax.numpy as jnp
from jax import lax

from ..core import Scalar, ScalarLike, quantity
from ..integration import Term
from ._relaxation import relax
from ._search_ranges import lugre_ranges
from .base import AbstractFriction, State, Terms, deflection_scale

_NEWTON = 30
"""Steps of Newton's method, more than ever counted: near its peak the force is flat."""


class BlimanSorine(AbstractFriction):
    """Two deflections z_1, z_2 [m], a fast and a slow one, that pull against each other."""

    without_rate: ClassVar = {}

    f_c: float = quantity(0.55, "N")
    """Force f_1 - f_2 of steady sliding [N]."""
    f_2: float = quantity(0.3, "N", positive=False, low=0.0)
    """Strength f_2 of the slow element [N], which makes the overshoot; 0 is the first-order model."""
    epsilon: float = quantity(3e-6, "m")
    """Path eps over which the slow element forgets [m]."""
    eta: float = quantity(0.2, "", high=math.nextafter(1.0, 2.0))
    """Ratio eta of the fast element's path to the slow one's."""

    def initial(self) -> State:
        return jnp.zeros(()), jnp.zeros(())

    def _stiffnesses(self) -> tuple[float, float]:
        return (self.f_c + self.f_2) / (self.eta * self.epsilon), self.f_2 / self.epsilon

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        fast, slow = state
        path = v * (sign / self.epsilon)
        return v - path * fast * (1.0 / self.eta), v - path * slow

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        k_1, k_2 = self._stiffnesses()
        return k_1 * state[0] - k_2 * state[1]

    def error_scale(self) -> State:
        return deflection_scale(self.eta * self.epsilon), deflection_scale(self.epsilon)

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        k_1, k_2 = self._stiffnesses()
        fast, slow = state
        displacement = (force - k_1 * fast + k_2 * slow) / (k_1 - k_2)
        return (fast + displacement, slow + displacement), displacement

    def under_load(self, force: Scalar) -> State:
        # Along the path from rest the force is concave up to its peak, so that Newton's method comes from below.
        lengths = jnp.stack([jnp.asarray(self.eta * self.epsilon, float), jnp.asarray(self.epsilon, float)])
        strengths = jnp.stack([jnp.asarray(self.f_c + self.f_2, float), -jnp.asarray(self.f_2, float)])
        sign = jnp.where(force >= 0.0, 1.0, -1.0)

        def improved(_: int, path: Scalar) -> Scalar:
            left = jnp.exp(-path / lengths)
            slope = jnp.sum(strengths / lengths * left)
            rises = slope > 0.0
            missing = sign * force - jnp.sum(strengths * (1.0 - left))
            return path + jnp.where(rises, missing / jnp.where(rises, slope, 1.0), 0.0)

        path = lax.fori_loop(0, _NEWTON, improved, jnp.zeros(()))
        fast, slow = sign * lengths * (1.0 - jnp.exp(-path / lengths))
        return fast, slow

    def slide(self, state: State, v: Scalar, elapsed: Scalar, sign: ScalarLike) -> State:
        path = sign * v * elapsed
        lengths = self.eta * self.epsilon, self.epsilon
        fast, slow = (relax(z, sign * length, path / length) for z, length in zip(state, lengths, strict=True))
        return fast, slow

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        stiffness, _, force = lugre_ranges(mass, acceleration, rate)
        return {
            "f_c": force,
            "f_2": force,
            "epsilon": (force[0] / stiffness[0], 10.0 * force[1] / stiffness[0]),
            "eta": (0.05, 0.8),
        }
