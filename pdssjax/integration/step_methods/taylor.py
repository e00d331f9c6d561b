"""Taylor series of the solution: no step is ever rejected."""

from collections.abc import Callable, Sequence
from typing import ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ...core import Scalar
from ..step_length import resolved_radius
from ..taylor_loop import Record, looped_coefficients, recorded
from ..taylor_series import Field, taylor_coefficients
from .base import AbstractStepMethod, KnownStep, Piece


class Taylor(AbstractStepMethod):
    """Taylor series of a given order; step control after À. Jorba and M. Zou,
    Experimental Mathematics 14(1), 2005."""

    order: int = eqx.field(static=True, default=22)
    noise: ClassVar[float] = 0.0

    @property
    def span(self) -> float:
        # Inside the circle of this radius in the left half-plane the series of e^z is at most 1.01: radius 4.1 at
        # order 12, 5.5 at order 16.  Of higher orders it is larger, but terms as large as e^|z| cancel there, and
        # rounding in derivatives grows with them.
        return min(self.order / 3.0, 6.0)

    def attempt(
        self,
        field: Field,
        t_local: Scalar,
        x: Sequence[Scalar],
        units: Sequence[Scalar],
        remaining: Scalar,
        proposed_step: Scalar,
        opaque_one: Scalar,
    ) -> Piece:
        series = taylor_coefficients(field, t_local, x, self.order, opaque_one)
        step_radius = jnp.minimum(resolved_radius(series, units), remaining) / opaque_one
        # Always accepted: a series that is not finite would not be so the next time either.
        return Piece(series, step_radius, jnp.ones((), bool), step_radius)

    def expand(
        self, step: Callable[..., KnownStep], *rows: Float[Array, "rows ..."]
    ) -> list[Float[Array, "coefficients rows"]]:
        def opened(*row: Float[Array, "..."]) -> tuple[Record, Scalar]:
            start = step(*row)
            return recorded(start.field, start.t_local, start.x), 1.0 + 0.0 * start.step_radius

        record, opaque_one = jax.vmap(opened)(*rows)
        return looped_coefficients(record, self.order, opaque_one)
