"""Generalized Maxwell slip friction: four springs in parallel, each on a block that can slip.

    F = k_1 z_1 + … + k_4 z_4 + s2 v,
    sticking: z_i' = v, until sign(v) k_i z_i reaches a_i s(v);
    slipping: k_i z_i' = C (sign(v) a_i - k_i z_i / s(v)), until v passes through zero,
    a_i = W_i / W,   W = W_1 + … + W_4,   s(v) = W (r + (1 - r) exp(-(v/v_s)^2)),

with the breakaway forces W_i and r the part of W that is left in fast sliding.  Steady
sliding takes sign(v) s(v) + s2 v, which the slipping elements approach with the time s/C:
frictional lag.  Before all elements slip, the force remembers every turning point that no
larger motion has wiped out (nonlocal memory), and an oscillating force below breakaway
does not make the contact drift.

Without weakening (r = 1) every element obeys Coulomb's law behind a spring and nothing can
create energy.  With it, an element that slows down is pulled back to the larger force at
the rate C, however short the way, and that is not proved.  The data do not tell which element
is which: any order of them gives the same force.

F. Al-Bender, V. Lampaert and J. Swevers, IEEE Trans. Automatic Control 50(11), 2005.
"""

from typing import ClassVar

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantity
from ..integration import N, Term, constant
from ._relaxation import relax
from ._search_ranges import lugre_ranges, stribeck_range
from ._stribeck_curve import stribeck_curve, stribeck_guard
from .base import AbstractFriction, State, Terms, deflection_scale

_COUNT = 4

_SEEN = 3e-4
"""The Stribeck curve as a displacement [m]: how well a step resolves it, and with it the breakaway of an element."""

_ROUNDING = 1e-12
"""Part of its breakaway force by which an element at its limit may seem short of it."""


class GeneralizedMaxwellSlip(AbstractFriction):
    """The stretches z_1 … z_4 [m] of the springs, flags that tell which elements slip, and fast sliding."""

    without_rate: ClassVar = {"weakened": 1.0, "sigma2": 0.0}

    stiffness_1: float = quantity(4.0e5, "N/m")
    """Stiffness k_1 of the first element [N/m]."""
    stiffness_2: float = quantity(3.0e5, "N/m")
    """Stiffness k_2 of the second element [N/m]."""
    stiffness_3: float = quantity(2.0e5, "N/m")
    """Stiffness k_3 of the third element [N/m]."""
    stiffness_4: float = quantity(1.0e5, "N/m")
    """Stiffness k_4 of the fourth element [N/m]."""
    strength_1: float = quantity(0.06, "N")
    """Breakaway force W_1 of the first element [N]."""
    strength_2: float = quantity(0.14, "N")
    """Breakaway force W_2 of the second element [N]."""
    strength_3: float = quantity(0.2, "N")
    """Breakaway force W_3 of the third element [N]."""
    strength_4: float = quantity(0.25, "N")
    """Breakaway force W_4 of the fourth element [N]."""
    weakened: float = quantity(0.85, "")
    """Part r of the breakaway force that is left in fast sliding; above 1, friction grows with the velocity."""
    v_s: float = quantity(1e-3, "m/s")
    """Stribeck velocity v_s [m/s]."""
    attraction: float = quantity(3.0e3, "N/s")
    """Attraction rate C with which slipping elements approach the sliding force [N/s]."""
    sigma2: float = quantity(0.0, "N s/m", positive=False, low=0.0, optional=True)
    """Viscous friction s2 [N s/m]."""

    def initial(self) -> State:
        return tuple(jnp.zeros(()) for _ in range(2 * _COUNT + 1))

    def _stiffnesses(self) -> tuple[float, float, float, float]:
        return self.stiffness_1, self.stiffness_2, self.stiffness_3, self.stiffness_4

    def _strengths(self) -> tuple[float, float, float, float]:
        return self.strength_1, self.strength_2, self.strength_3, self.strength_4

    def _elements(self, state: tuple[N, ...]) -> list[tuple[N, N, float, float]]:
        """Stretch [m], flag of slipping, stiffness [N/m] and breakaway force [N] of each element."""
        return list(zip(state[:_COUNT], state[_COUNT:-1], self._stiffnesses(), self._strengths(), strict=True))

    def _remaining(self, v: Term) -> Term:
        """s(v) / W."""
        return stribeck_curve(v, self.weakened, 1.0, self.v_s)

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        total = sum(self._strengths())
        level = self._remaining(v) * total
        rates = []
        for z, slips, k, w in self._elements(state):
            attracted = (sign * w / total - z * k / level) * (self.attraction / k)
            rates.append(v * (1.0 - slips) + attracted * slips)
        return (*rates, *(0 for _ in range(_COUNT + 1)))

    def extra_error_terms(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        return (self._remaining(v) * _SEEN,)

    def _elastic(self, state: Terms) -> Term:
        forces = [z * k for z, k in zip(state[:_COUNT], self._stiffnesses(), strict=True)]
        return sum(forces[1:], forces[0])

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        return self._elastic(state) + self.sigma2 * v

    def error_scale(self) -> State:
        springs = zip(self._stiffnesses(), self._strengths(), strict=True)
        return *(deflection_scale(w / k) for k, w in springs), *(jnp.ones(()) for _ in range(_COUNT + 1))

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        displacement = (force - constant(self._elastic(state))) / sum(self._stiffnesses())
        return (*(z + displacement for z in state[:_COUNT]), *state[_COUNT:]), displacement

    def under_load(self, force: Scalar) -> State:
        # Spring by spring stretches up to its block's slipping: a concave force, so that Newton's method comes from
        # below, and is there after as many steps as there are elements.
        springs = [(k, w / k) for k, w in zip(self._stiffnesses(), self._strengths(), strict=True)]
        sign = jnp.where(force >= 0.0, 1.0, -1.0)
        stretch = jnp.zeros(())
        for _ in range(_COUNT):
            carried = sum(k * jnp.minimum(stretch, longest) for k, longest in springs)
            stiffness = sum(jnp.where(stretch < longest, k, 0.0) for k, longest in springs)
            holds = stiffness > 0.0
            stretch += jnp.where(holds, (sign * force - carried) / jnp.where(holds, stiffness, 1.0), 0.0)
        stretches = (sign * jnp.minimum(stretch, longest) for _, longest in springs)
        return (*stretches, *self.initial()[_COUNT:])

    def guards(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        remaining = self._remaining(v)
        elements = (
            (remaining * w - z * (sign * k)) * (1.0 - slips) + slips for z, slips, k, w in self._elements(state)
        )
        return (*elements, stribeck_guard(state[-1], v, sign, self.v_s))

    def after_event(self, state: State, v: Scalar, sign: ScalarLike, which: Scalar) -> State:
        slips = (jnp.where(which == i, 1.0, flag) for i, flag in enumerate(state[_COUNT:-1]))
        fast = jnp.where(which == _COUNT, 1.0 - state[-1], state[-1])
        return (*state[:_COUNT], *slips, fast)

    def on_reversal(self, state: State, sign: ScalarLike) -> State:
        springs = zip(state[:_COUNT], self._stiffnesses(), self._strengths(), strict=True)
        slips = [jnp.where(sign * k * z < w * (1.0 - _ROUNDING), 0.0, 1.0) for z, k, w in springs]
        return (*state[:_COUNT], *slips, jnp.zeros_like(state[-1]))

    def slide(self, state: State, v: Scalar, elapsed: Scalar, sign: ScalarLike) -> State:
        # An element that lets go does so at the stretch that slipping elements tend to, and stays there.
        remaining = jnp.asarray(constant(self._remaining(v)), float)
        decay = self.attraction / (remaining * sum(self._strengths())) * elapsed
        stretches, flags = [], []
        for z, slips, k, w in self._elements(state):
            limit, reach = remaining * w / k, sign * (z + v * elapsed)
            sticking = sign * jnp.minimum(reach, limit)
            stretches.append(jnp.where(slips > 0.0, relax(z, sign * limit, decay), sticking))
            flags.append(jnp.where((slips > 0.0) | (reach >= limit), 1.0, 0.0))
        return (*stretches, *flags, state[-1])

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        stiffness, damping, force = lugre_ranges(mass, acceleration, rate)
        ranges = {"sigma2": damping}
        for i in range(1, _COUNT + 1):
            # Early elements stiff and weak, late ones soft and strong: one order out of many.
            rising, falling = 0.1 * i, 0.1 * (_COUNT + 1 - i)
            ranges[f"stiffness_{i}"] = stiffness[0] * falling, stiffness[1] * falling
            ranges[f"strength_{i}"] = force[0] * rising, force[1] * rising
        ranges["weakened"] = (0.4, 1.0)
        ranges["v_s"] = stribeck_range(acceleration, rate)
        ranges["attraction"] = (0.1 * rate * force[0], 10.0 * rate * force[1])
        return ranges
