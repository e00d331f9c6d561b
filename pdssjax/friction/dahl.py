"""Dahl friction (5.1-5.5): the stress-strain curve of a solid, with any exponent.

    F = s0 z,   z' = v p^n,   p = 1 - sign(v) F / f_c,

(5.2) with F = s0 z put in; n = 1 gives (5.5), and (5.3) once its lost factor s0 is back.
The exponent shapes the approach to f_c: exponential for n = 1, slower for n > 1 (ductile),
and after the finite distance f_c/(s0 (1 - n)) for n < 1 (brittle).  A flag therefore says
that F has reached f_c; it is set where p falls to 1e-8, which for n >= 1 changes nothing
that shows.  Rate-independent and without damping; drifts under an oscillating force.

P. R. Dahl, A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, 1968.
"""

from typing import ClassVar

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..integration import Term, constant, power
from ._search_ranges import lugre_ranges
from .base import AbstractFriction, State, Terms, deflection_scale

_SATURATED = 1e-8
"""The p at which F counts as f_c."""

_NEARLY_LINEAR = 1e-3
"""Below this log(1 - x) is taken from its series: the closed form divides by 1 - n, which may be 0."""

_TINY = 1e-32
"""Keeps p^2 from being 0, and is lost in it otherwise."""


class Dahl(AbstractFriction):
    """An elastic deflection z [m] that yields the more the nearer the force is to f_c; a flag tells saturation."""

    without_rate: ClassVar = {}

    sigma0: float = quantity(1.0e6, "N/m")
    """Stiffness s0 of the contact at rest [N/m]."""
    f_c: float = quantity(0.65, "N")
    """Coulomb force f_c [N]."""
    exponent: float = quantity(1.0, "", positive=False, low=0.0, optional=True)
    """Exponent n of the stress-strain curve."""

    def initial(self) -> State:
        return jnp.zeros(()), jnp.zeros(())

    def _room(self, z: Term, sign: ScalarLike) -> Term:
        """p: the part of the force that is left until saturation, between 0 and 2."""
        return z * (-sign * self.sigma0 / self.f_c) + 1.0

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        z, saturated = state
        room = self._room(z, sign) * (1.0 - saturated) + saturated
        # A square, because the actuator asks for the rate (times 0) at rest, too, where p may be anything.
        stretching = power(room * room + _TINY, 0.5 * self.exponent) * (1.0 - saturated)
        return v * stretching, 0

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        return self.sigma0 * state[0]

    def error_scale(self) -> State:
        return deflection_scale(self.f_c / self.sigma0), jnp.ones(())

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        target = force / self.sigma0
        return (target, state[1]), target - state[0]

    def guards(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        z, saturated = state
        room = self._room(z, sign) * (1.0 - saturated) + saturated
        # Along the path p^(1 - n) falls in a straight line, where p itself would only touch zero.
        straight = jnp.where(jnp.asarray(self.exponent) < 1.0, 1.0 - self.exponent, 1.0)
        # A step may end beyond, by its error; the square would hide that.
        short = jnp.where(constant(room) > 0.0, 1.0, -1.0)
        left = power(room * room + _TINY, 0.5 * straight) * short - _SATURATED**straight
        return (left * (1.0 - saturated) + saturated,)

    def after_event(self, state: State, v: Scalar, sign: ScalarLike, which: Scalar) -> State:
        return sign * self.f_c / self.sigma0 + 0.0 * state[0], jnp.ones_like(state[1])

    def on_reversal(self, state: State, sign: ScalarLike) -> State:
        z, _ = state
        return z, jnp.where(constant(self._room(z, sign)) > _SATURATED, 0.0, 1.0)

    def slide(self, state: State, v: Scalar, elapsed: Scalar, sign: ScalarLike) -> State:
        # p^(1 - n) falls in a straight line: p = p_0 (1 - (1 - n) q)^(1/(1 - n)), q = path s0/f_c p_0^(n - 1).
        z, saturated = state
        ended = saturated > 0.0
        room = jnp.where(ended, 1.0, jnp.maximum(jnp.asarray(constant(self._room(z, sign)), float), _SATURATED))
        brittleness = 1.0 - jnp.asarray(self.exponent, float)
        q = sign * v * elapsed * (self.sigma0 / self.f_c) * room**-brittleness
        x = brittleness * q
        series = -q * (1.0 + x * (1 / 2 + x * (1 / 3 + x * (1 / 4 + x * (1 / 5 + x / 6)))))
        nearly = jnp.abs(x) < _NEARLY_LINEAR
        curved = jnp.log1p(-jnp.where(nearly | (x >= 1.0), 0.5, x)) / jnp.where(nearly, 1.0, brittleness)
        left = room * jnp.exp(jnp.where(nearly, series, curved))
        reaches = ended | (x >= 1.0) | (left <= _SATURATED)
        limit = sign * self.f_c / self.sigma0
        moved = jnp.where(reaches, limit, limit * (1.0 - left))
        return jnp.where(ended, z, moved), jnp.where(reaches, 1.0, 0.0)

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        stiffness, _, force = lugre_ranges(mass, acceleration, rate)
        return {"sigma0": stiffness, "f_c": force, "exponent": (0.3, 3.0)}
