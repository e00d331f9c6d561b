"""Coulomb friction: a force of one size against the motion, and whatever holds at rest.

    F = f_c sign(v) for v != 0,   |F| <= f_c for v = 0.

Set-valued at v = 0, where the contact sticks until the force that would hold it leaves
[-f_c, f_c].  No memory and no compliance: before it slips nothing moves.  Use it for slips
that are long compared with the presliding displacement.

H. Olsson et al., European Journal of Control 4(3), 1998, section 3.1.
"""

from typing import ClassVar

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..integration import Term
from ._search_ranges import lugre_ranges
from .base import AbstractFriction, State, Terms


class Coulomb(AbstractFriction):
    """A constant force against the motion; sticks at rest."""

    at_rest: ClassVar = "set-valued"

    without_rate: ClassVar = {}

    f_c: float = quantity(0.65, "N")
    """Coulomb force f_c [N]."""

    def initial(self) -> State:
        return ()

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        return ()

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        return self.f_c * sign

    def error_scale(self) -> State:
        return ()

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        return (), jnp.zeros(())

    def slide(self, state: State, v: Scalar, elapsed: Scalar, sign: ScalarLike) -> State:
        return ()

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        _, _, force = lugre_ranges(mass, acceleration, rate)
        return {"f_c": force}
