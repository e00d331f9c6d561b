"""Base of LuGre and its relatives: one mean bristle that yields at a Stribeck curve."""

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..integration import Term
from ._search_ranges import lugre_ranges, stribeck_range
from ._stribeck_curve import CURVE, stribeck_curve
from .base import AbstractFriction, State, Terms


class AbstractStribeckBristle(AbstractFriction):
    """A mean bristle that yields at the Stribeck curve: the parameters that LuGre and its relatives share.

    The deflection z [m] is the first of the state; F = s0 z + s1 z' + s2 v.  That a step resolves the curve is
    said here; the flag of fast sliding, with its `stribeck_guard`, is the member's.
    """

    sigma0: float = quantity(1.0e6, "N/m")
    """Bristle stiffness s0 [N/m]."""
    sigma1: float = quantity(45.0, "N s/m", may_vanish=True)
    """Bristle damping s1 [N s/m]."""
    sigma2: float = quantity(0.0, "N s/m", positive=False, low=0.0, optional=True)
    """Viscous friction s2 [N s/m]."""
    f_c: float = quantity(0.55, "N")
    """Coulomb force f_c, of fast sliding without its viscous part [N]."""
    f_s: float = quantity(0.65, "N")
    """Static force f_s, of infinitely slow sliding [N]; below f_c, friction grows with the velocity."""
    v_s: float = quantity(1e-3, "m/s")
    """Stribeck velocity v_s [m/s]."""

    def initial(self) -> State:
        return tuple(jnp.zeros(()) for _ in self.error_scale())

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        return self.sigma0 * state[0] + self.sigma1 * self.rate(state, v, sign)[0] + self.sigma2 * v

    def extra_error_terms(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        return (stribeck_curve(v, 0.0, CURVE, self.v_s),)

    def _least_yielding(self) -> Scalar:
        """The smallest deflection of steady sliding [m]."""
        return jnp.minimum(jnp.asarray(self.f_c, float), self.f_s) / self.sigma0

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        target = force / self.sigma0
        return (target, *state[1:]), target - state[0]

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        stiffness, damping, force = lugre_ranges(mass, acceleration, rate)
        return {
            "sigma0": stiffness,
            "sigma1": damping,
            "sigma2": damping,
            "f_c": force,
            "f_s": force,
            "v_s": stribeck_range(acceleration, rate),
        }
