"""Simplified LuGre friction (5.20-5.21): the isotropic case of the thesis's law.

    z' = v - s0 |v| z / F_SS,   F = s0 z + s1 z'

Thesis, section 5.2.7, after C. Canudas de Wit et al., IEEE Trans. Automatic Control
40(3), 1995, in the limit of small velocities.
"""

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..integration import Term
from ._relaxation import relax
from ._search_ranges import lugre_ranges
from .base import AbstractFriction, State, Terms, deflection_scale


class SimplifiedLuGre(AbstractFriction):
    """One mean bristle deflection z [m] carries the contact force."""

    sigma0: float = quantity(1.0e6, "N/m")
    """Bristle stiffness s0 [N/m]."""
    sigma1: float = quantity(45.0, "N s/m", may_vanish=True)
    """Bristle damping s1 [N s/m]."""
    f_ss: float = quantity(0.65, "N")
    """Breakaway force F_SS [N]."""

    def initial(self) -> State:
        return (jnp.zeros(()),)

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        return (v - self.sigma0 * sign / self.f_ss * (v * state[0]),)

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        return self.sigma0 * state[0] + self.sigma1 * self.rate(state, v, sign)[0]

    def error_scale(self) -> State:
        return (deflection_scale(self.f_ss / self.sigma0),)

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        target = force / self.sigma0
        return (target,), target - state[0]

    def slide(self, state: State, v: Scalar, elapsed: Scalar, sign: ScalarLike) -> State:
        exponent = self.sigma0 / self.f_ss * (sign * v * elapsed)
        return (relax(state[0], sign * self.f_ss / self.sigma0, exponent),)

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        stiffness, damping, force = lugre_ranges(mass, acceleration, rate)
        return {
            "sigma0": stiffness,
            "sigma1": damping,
            "f_ss": force,
        }
