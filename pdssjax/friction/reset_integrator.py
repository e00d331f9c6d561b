"""Reset integrator friction: one bond that stretches, then is dragged along.

    p' = v, but 0 where |p| = p0 and v would stretch it further,
    F = (1 + a) s0 p + beta p' while |p| < p0,   F = s0 p0 sign(v) while it is dragged.

Sliding takes f_c = s0 p0, from which p0 follows here; breaking away takes (1 + a) f_c, and
the force drops by a f_c when it does.  Below that nothing yields, so the contact never
drifts, and it is rate-independent but for beta.  The contact turns stiff again at once
when a slide is reversed: there the force rises by a f_c.

D. A. Haessig and B. Friedland, ASME Journal of Dynamic Systems, Measurement, and Control
113(3), 1991.
"""

from typing import ClassVar

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..integration import Term
from ._search_ranges import lugre_ranges
from .base import AbstractFriction, State, Terms, deflection_scale

_ROUNDING = 1e-12
"""Part of p0 by which a bond at its limit may seem short of it."""


class ResetIntegrator(AbstractFriction):
    """The stretch p [m] of a bond, and a flag that tells whether it is dragged along."""

    without_rate: ClassVar = {"beta": 0.0}

    sigma0: float = quantity(1.0e6, "N/m")
    """Stiffness s0 that goes with the sliding force [N/m]; the contact at rest has (1 + a) s0."""
    f_c: float = quantity(0.55, "N")
    """Sliding force s0 p0 [N]."""
    a: float = quantity(0.2, "", positive=False, low=0.0)
    """Stiction gradient a: the part by which breaking away takes more than sliding."""
    beta: float = quantity(45.0, "N s/m", positive=False, low=0.0)
    """Damping beta of the stretching bond [N s/m]."""

    def initial(self) -> State:
        return jnp.zeros(()), jnp.zeros(())

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        _, dragged = state
        return v * (1.0 - dragged), 0

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        p, dragged = state
        stiction = (1.0 - dragged) * self.a
        return self.sigma0 * p * (stiction + 1.0) + self.beta * self.rate(state, v, sign)[0]

    def error_scale(self) -> State:
        return deflection_scale(self.f_c / self.sigma0), jnp.ones(())

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        p, dragged = state
        target = force / (self.sigma0 * (1.0 + (1.0 - dragged) * self.a))
        return (target, dragged), target - p

    def guards(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        p, dragged = state
        return ((self.f_c / self.sigma0 - p * sign) * (1.0 - dragged) + dragged,)

    def after_event(self, state: State, v: Scalar, sign: ScalarLike, which: Scalar) -> State:
        return sign * self.f_c / self.sigma0 + 0.0 * state[0], jnp.ones_like(state[1])

    def on_reversal(self, state: State, sign: ScalarLike) -> State:
        p, _ = state
        limit = self.f_c / self.sigma0
        return p, jnp.where(p * sign < limit * (1.0 - _ROUNDING), 0.0, 1.0)

    def slide(self, state: State, v: Scalar, elapsed: Scalar, sign: ScalarLike) -> State:
        p, dragged = state
        limit, reach = self.f_c / self.sigma0, sign * (p + v * elapsed)
        ends = (dragged > 0.0) | (reach >= limit)
        stretched = jnp.where(dragged > 0.0, p, sign * jnp.minimum(reach, limit))
        return stretched, jnp.where(ends, 1.0, 0.0)

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        stiffness, damping, force = lugre_ranges(mass, acceleration, rate)
        return {"sigma0": stiffness, "f_c": force, "a": (0.01, 1.0), "beta": damping}
