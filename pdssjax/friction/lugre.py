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

import jax.numpy as jnp

from ..quantity import quantity
from .base import AbstractFriction, lugre_ranges, stribeck_curve, stribeck_guard, stribeck_range


class LuGre(AbstractFriction):
    """One mean bristle deflection z [m], whose limit depends on the velocity; a flag tells fast sliding."""

    sigma0: float = quantity(1.0e6, "N/m")
    """Bristle stiffness s0 [N/m]."""
    sigma1: float = quantity(45.0, "N s/m")
    """Bristle damping s1 [N s/m]."""
    sigma2: float = quantity(0.0, "N s/m", positive=False, low=0.0, optional=True)
    """Viscous friction s2 [N s/m]."""
    f_c: float = quantity(0.55, "N")
    """Coulomb force f_c, of fast sliding without its viscous part [N]."""
    f_s: float = quantity(0.65, "N")
    """Static force f_s, of infinitely slow sliding [N]; below f_c, friction grows with the velocity."""
    v_s: float = quantity(1e-3, "m/s")
    """Stribeck velocity v_s [m/s]."""

    def initial(self):
        return jnp.zeros(()), jnp.zeros(())

    def rate(self, state, v, sign):
        level = stribeck_curve(v, self.f_c, self.f_s, self.v_s)
        return v - v * state[0] * (self.sigma0 * sign) / level, 0

    def force(self, state, v, sign):
        return self.sigma0 * state[0] + self.sigma1 * self.rate(state, v, sign)[0] + self.sigma2 * v

    def length(self):
        return jnp.ones(()), jnp.ones(())

    def relaxed(self, state, force):
        target = force / self.sigma0
        return (target, state[1]), target - state[0]

    def guards(self, state, v, sign):
        return (stribeck_guard(state[1], v, sign, self.v_s),)

    def passed(self, state, v, sign, which):
        return state[0], 1.0 - state[1]

    def turned(self, state, sign):
        return state[0], jnp.zeros_like(state[1])

    @classmethod
    def plausible(cls, mass, acceleration, rate):
        stiffness, damping, force = lugre_ranges(mass, acceleration, rate)
        return {
            "sigma0": stiffness,
            "sigma1": damping,
            "sigma2": damping,
            "f_c": force,
            "f_s": force,
            "v_s": stribeck_range(acceleration, rate),
        }
