"""Direction-dependent simplified LuGre friction (5.20-5.22), in two readings.

With index a for v >= 0 and b for v < 0:

- deflection state, the thesis's Simulink diagram to the letter:
      z' = v - s0 |v| z / F_SS,   F = s0 z + s1 z',
  where s0, s1 and F_SS all switch with the sign of v, so that F jumps at v = 0;
- force state: f = s0 z is carried instead,
      f' = s0 (v - |v| f / F_SS),   F = f + s1 (v - |v| f / F_SS),
  continuous at v = 0.

Neither is passive once s0a and s0b differ: a bristle that is loaded at the softer stiffness
and unloaded at the stiffer one gives back more than it took.  With s0a > s0b the deflection
state creates energy where the bristle swings on the side z < 0 and loses it on the other;
the force state does the opposite, as its energy at a given force is f^2/(2 s0).  Under a
constant load that keeps it on that side, the deflection state therefore never comes to
rest: it settles on a limit cycle.

W. Zhang's group, thesis, section 5.2.7; C. Canudas de Wit et al., IEEE Trans. Automatic
Control 40(3), 1995, for the LuGre model.
"""

from typing import Literal

import equinox as eqx
import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..integration import Term
from ._relaxation import relax
from ._search_ranges import lugre_ranges
from .base import AbstractFriction, State, Terms, deflection_scale


class AnisotropicLuGre(AbstractFriction):
    """Bristles whose stiffness, damping and breakaway force depend on the direction."""

    sigma0_a: float = quantity(1.1484e6, "N/m")
    """Bristle stiffness s0a for v >= 0 [N/m]."""
    sigma0_b: float = quantity(0.953789e6, "N/m")
    """Bristle stiffness s0b for v < 0 [N/m]."""
    sigma1_a: float = quantity(54.4, "N s/m", may_vanish=True)
    """Bristle damping s1a for v >= 0 [N s/m]."""
    sigma1_b: float = quantity(38.9, "N s/m", may_vanish=True)
    """Bristle damping s1b for v < 0 [N s/m]."""
    f_ss_a: float = quantity(0.7964, "N")
    """Breakaway force F_SSa for v >= 0 [N]."""
    f_ss_b: float = quantity(0.5458, "N")
    """Breakaway force F_SSb for v < 0 [N]."""
    state: Literal["deflection", "force"] = eqx.field(static=True, default="deflection")
    """Which quantity the contact state holds: the deflection z [m] or the elastic force f [N]."""

    def _branch(self, sign: ScalarLike) -> tuple[Scalar, Scalar, Scalar]:
        forward = sign > 0
        return (
            jnp.where(forward, self.sigma0_a, self.sigma0_b),
            jnp.where(forward, self.sigma1_a, self.sigma1_b),
            jnp.where(forward, self.f_ss_a, self.f_ss_b),
        )

    def initial(self) -> State:
        return (jnp.zeros(()),)

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        s0, _, f_ss = self._branch(sign)
        (carried,) = state
        if self.state == "deflection":
            return (v - s0 * sign / f_ss * (v * carried),)
        return (s0 * (v - sign / f_ss * (v * carried)),)

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        s0, s1, f_ss = self._branch(sign)
        (carried,) = state
        elastic = s0 * carried if self.state == "deflection" else carried
        return elastic + s1 * (v - sign / f_ss * (v * elastic))

    def error_scale(self) -> State:
        yielding = jnp.minimum(jnp.asarray(self.f_ss_a / self.sigma0_a, float), self.f_ss_b / self.sigma0_b)
        return (deflection_scale(yielding) * self._displacement(),)

    def _displacement(self) -> Scalar:
        """The displacement that one unit of the state stands for [m]."""
        # An error of the force displaces the most where the contact is softer.
        softest = jnp.minimum(jnp.asarray(self.sigma0_a, float), self.sigma0_b)
        return jnp.ones(()) if self.state == "deflection" else 1.0 / softest

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        return self.equilibrium_after(state, force, force)

    def equilibrium_after(self, state: State, force: Scalar, sign: ScalarLike) -> tuple[State, Scalar]:
        s0, _, _ = self._branch(sign)
        target = force / s0 if self.state == "deflection" else force
        return (target,), (target - state[0]) * self._displacement()

    def slide(self, state: State, v: Scalar, elapsed: Scalar, sign: ScalarLike) -> State:
        s0, _, f_ss = self._branch(sign)
        steady = sign * f_ss / s0 if self.state == "deflection" else sign * f_ss
        return (relax(state[0], steady, s0 / f_ss * (sign * v * elapsed)),)

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        stiffness, damping, force = lugre_ranges(mass, acceleration, rate)
        return {
            "sigma0_a": stiffness,
            "sigma0_b": stiffness,
            "sigma1_a": damping,
            "sigma1_b": damping,
            "f_ss_a": force,
            "f_ss_b": force,
        }
