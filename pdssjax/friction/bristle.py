"""Bristle friction: N bonds that stretch, snap, and form again elsewhere.

    F = (s0/N) (z_1 + … + z_N) + s2 v,   z_i' = v,

and where |z_i| reaches delta_s the bond snaps and forms again with the stretch
sign(v) delta_s r, 0 <= r < 1.  The original draws r from a uniform distribution.  Here the
k-th snap of a run takes r = frac(k (sqrt(5) - 1)/2), which fills the interval just as
evenly but is the same in every run, so that the force is a function of the parameters that
can be differentiated.  k is counted among the state.

A bond lives from r delta_s to delta_s, so that the mean stretch in sliding is 2/3 delta_s:
delta_s = 3 f_c/(2 s0) follows here from the mean force.  The undisturbed bonds are spread
evenly over half of the range, -delta_s/2 to delta_s/2.  The force is a saw with about 2 N teeth
for each delta_s of slip, every one an event: slow to simulate.  The original has no damping
at rest; s2 is an addition, 0 if left out.

D. A. Haessig and B. Friedland, ASME Journal of Dynamic Systems, Measurement, and Control
113(3), 1991.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jax import lax

from ..core import Scalar, ScalarLike, quantity
from ..integration import Term, constant
from ._search_ranges import lugre_ranges
from .base import AbstractFriction, State, Terms, deflection_scale

_GOLDEN = 0.5 * (5.0**0.5 - 1.0)


class Bristle(AbstractFriction):
    """The stretches z_i [m] of N bonds, and as a flag the count of those that have snapped."""

    without_rate: ClassVar = {"sigma2": 0.0}

    sigma0: float = quantity(1.0e6, "N/m")
    """Stiffness s0 of all bonds together [N/m]."""
    f_c: float = quantity(0.55, "N")
    """Mean force of sliding [N]."""
    sigma2: float = quantity(0.0, "N s/m", positive=False, low=0.0, optional=True)
    """Viscous friction s2 [N s/m]."""
    bristles: int = eqx.field(static=True, default=20)
    """Number of bonds N."""

    def longest(self) -> ScalarLike:
        """delta_s: the stretch at which a bond snaps [m]."""
        return 1.5 * self.f_c / self.sigma0

    def initial(self) -> State:
        spread = (jnp.arange(self.bristles) + 0.5) / self.bristles - 0.5
        stretches = self.longest() * spread
        return (*(stretches[i] for i in range(self.bristles)), jnp.zeros(()))

    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        return (*(v for _ in state[:-1]), 0)

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        return sum(state[1:-1], state[0]) * (self.sigma0 / self.bristles) + self.sigma2 * v

    def error_scale(self) -> State:
        return *(deflection_scale(self.longest()) for _ in range(self.bristles)), jnp.ones(())

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        displacement = force / self.sigma0 - sum(state[1:-1], state[0]) / self.bristles
        return (*(z + displacement for z in state[:-1]), state[-1]), displacement

    def under_load(self, force: Scalar) -> State:
        sign = jnp.where(force >= 0.0, 1.0, -1.0)

        def stretched(_: int, state: State) -> State:
            missing = sign * (force - constant(self.force(state, 0.0, sign))) / self.sigma0
            room = jnp.stack([jnp.asarray(constant(left), float) for left in self.guards(state, 0.0, sign)])
            first = jnp.argmin(room)
            way = sign * jnp.minimum(missing, room[first])
            held = (*(z + way for z in state[:-1]), state[-1])
            snapped = self.after_event(held, jnp.zeros(()), sign, first)
            return tuple(jnp.where(room[first] < missing, a, b) for a, b in zip(snapped, held, strict=True))

        # Bonds snap one by one on the way; after several times their number the force has been at its largest.
        return lax.fori_loop(0, 4 * self.bristles, stretched, self.initial())

    def guards(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        return tuple(self.longest() - z * sign for z in state[:-1])

    def after_event(self, state: State, v: Scalar, sign: ScalarLike, which: Scalar) -> State:
        count = state[-1] + 1.0
        formed = sign * self.longest() * jnp.mod(count * _GOLDEN, 1.0)
        stretches = (jnp.where(which == i, formed, z) for i, z in enumerate(state[:-1]))
        return (*stretches, count)

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        stiffness, damping, force = lugre_ranges(mass, acceleration, rate)
        return {"sigma0": stiffness, "f_c": force, "sigma2": damping}
