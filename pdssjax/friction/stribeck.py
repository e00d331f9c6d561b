"""Coulomb, static, Stribeck and viscous friction: the classical map from velocity to force.

    F = sign(v) g(v) + sigma2 v,   g(v) = f_c + (f_s - f_c) exp(-|v/v_s|^delta),

and |F| <= f_s at v = 0, where the contact sticks.  No memory, no compliance.  delta = 2 is
the Gaussian curve of (5.10), delta = 1 Tustin's exponential.  |x|^delta has no Taylor
series at x = 0 unless delta is an even number, so x^2 (x^2 + e^2)^(delta/2 - 1) stands for it, with e = 1e-3:
exact for delta = 2, and else different only where |v| is a few thousandths of v_s.

H. Olsson et al., European Journal of Control 4(3), 1998, section 3.1; B. Armstrong-Hélouvry,
P. Dupont and C. Canudas de Wit, Automatica 30(7), 1994.
"""

from typing import ClassVar

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..integration import Term, exp, power
from ._search_ranges import lugre_ranges, stribeck_range
from ._stribeck_curve import CURVE, stribeck_guard
from .base import AbstractFriction, State, Terms

_ROUNDING = 1e-3
"""e: the part of v_s below which the tip of the curve is rounded."""

_BEYOND = 3.0
"""Multiple of e at which a step that begins at rest ends.

Where v grows as t^2, only every fourth coefficient of a rounded tip's series is large, and the last
two need not be among them: the step would go on far beyond the radius of convergence.
"""

_FLAT = 16.0
"""|v/v_s|^delta from which on the curve is flat enough to end a step there: see `stribeck_guard`."""


class Stribeck(AbstractFriction):
    """A force that depends on the velocity alone, largest where motion begins; sticks at rest.

    Its state is two flags: of fast sliding, and of a beginning on the rounded tip, for which delta = 2 has no need.
    """

    at_rest: ClassVar = "set-valued"
    flags_shape_force: ClassVar = False

    f_c: float = quantity(0.55, "N")
    """Coulomb force f_c, of fast sliding without its viscous part [N]."""
    f_s: float = quantity(0.65, "N")
    """Static force f_s, at which motion begins [N]; below f_c, friction grows with the velocity."""
    v_s: float = quantity(1e-3, "m/s")
    """Stribeck velocity v_s [m/s]."""
    sigma2: float = quantity(0.0, "N s/m", positive=False, low=0.0, optional=True)
    """Viscous friction sigma2 [N s/m]."""
    delta: float = quantity(2.0, "", optional=True)
    """Exponent delta of the Stribeck curve."""

    def initial(self) -> State:
        return jnp.zeros(()), jnp.zeros(())

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        return 0, 0

    def _weakening(self, v: Term) -> Term:
        """exp(-|v/v_s|^delta), 1 at rest and 0 far out."""
        x = v * (1.0 / self.v_s)
        square = x * x
        exponent = square * power(square + _ROUNDING**2, 0.5 * self.delta - 1.0)
        return exp(exponent * (-1.0))

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        level = self._weakening(v) * (self.f_s - self.f_c) + self.f_c
        return level * sign + v * self.sigma2

    def extra_error_terms(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        return (self._weakening(v) * CURVE,)

    def error_scale(self) -> State:
        return jnp.ones(()), jnp.ones(())

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        return state, jnp.zeros(())

    def guards(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        fast, tip = state
        far = power(_FLAT, 1.0 / self.delta)
        ends = (v * (-sign / self.v_s) + _BEYOND * _ROUNDING) * tip + (1.0 - tip)
        return stribeck_guard(fast, v, sign, self.v_s, far), ends

    def after_event(self, state: State, v: Scalar, sign: ScalarLike, which: Scalar) -> State:
        fast, tip = state
        return jnp.where(which == 0, 1.0 - fast, fast), jnp.where(which == 1, 0.0, tip)

    def on_reversal(self, state: State, sign: ScalarLike) -> State:
        return jnp.zeros(()), jnp.where(self.delta == 2.0, 0.0, 1.0)

    def slide(self, state: State, v: Scalar, elapsed: Scalar, sign: ScalarLike) -> State:
        return state  # flags, which the force does not look at

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        _, damping, force = lugre_ranges(mass, acceleration, rate)
        return {
            "f_c": force,
            "f_s": force,
            "v_s": stribeck_range(acceleration, rate),
            "sigma2": damping,
            "delta": (0.5, 3.0),
        }
