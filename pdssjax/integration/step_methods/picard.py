"""Collocation at Chebyshev points, by Picard iteration: it needs only values of the field, which any code may give.

The step is a polynomial that satisfies the field's equation at every point, so that states between its ends, and
the events located on it, are as accurate as its end (C. W. Clenshaw and H. J. Norton, Computer Journal 6(1), 1963).
"""

from collections.abc import Callable, Sequence
from typing import ClassVar, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ...core import Scalar
from ..polynomials import Polynomials, basis
from ..taylor_series import Field, constant
from .base import AbstractStepMethod, KnownStep, Piece

_ITERATIONS = 24
"""Over the `span` of a step the error of a linear field falls to span^24/24!, which is rounding."""

_ROUNDING = 1e-14
"""Part of a component's size in a step below which its error is rounding, which no shorter step reduces."""


Collocated: TypeAlias = tuple[Float[Array, "nodes components"], Float[Array, " components"]]
"""A step as values at the points, and their largest change by the last iteration."""


class Picard(AbstractStepMethod):
    """Collocation at Chebyshev points of a given degree, for fields that are not stiff."""

    degree: int = eqx.field(static=True, default=14)
    velocity_noise: ClassVar[float] = 10.0
    second_derivative_factor: ClassVar[float] = 0.01

    @property
    def span(self) -> float:
        return 1.5

    def attempt(
        self,
        field: Field,
        t_local: Scalar,
        x: Sequence[Scalar],
        error_weights: Sequence[Scalar],
        remaining: Scalar,
        proposed_step: Scalar,
        opaque_one: Scalar,
    ) -> Piece:
        step_size = jnp.minimum(proposed_step, remaining)
        values, change = self._collocated(field, t_local, x, step_size)
        tail = jnp.max(jnp.abs((jnp.asarray(basis(self.degree).to_chebyshev) @ values)[-2:]), axis=0)
        scale = jnp.stack(error_weights)
        allowed = jnp.maximum(1.0 / scale, _ROUNDING * jnp.max(jnp.abs(values), axis=0))
        size = jnp.max(jnp.maximum(tail, change) / allowed)
        size = jnp.where(jnp.isfinite(size), size, 1e30)
        factor = jnp.clip(0.8 * (size + 1e-30) ** (-1.0 / self.degree), 0.1, 20.0)
        accepted = size <= 1.0
        grown = jnp.where(
            accepted & (step_size < proposed_step),
            jnp.maximum(proposed_step, step_size * factor),
            step_size * factor,
        )
        return Piece(self._polynomials(values, step_size, x), step_size, accepted, grown)

    def expand(
        self, step: Callable[..., KnownStep], *rows: Float[Array, "rows ..."]
    ) -> list[Float[Array, "coefficients rows"]]:
        def again(*row: Float[Array, "..."]) -> Polynomials:
            known = step(*row)
            values, _ = self._collocated(known.field, known.t_local, known.x, known.step_size)
            return self._polynomials(values, known.step_size, known.x)

        return [jnp.stack(coefficients) for coefficients in jax.vmap(again)(*rows)]

    def _collocated(self, field: Field, t_local: Scalar, x: Sequence[Scalar], step_size: Scalar) -> Collocated:
        points = basis(self.degree)
        start = jnp.stack(x)
        times = t_local + step_size * points.nodes

        def rates(time: Scalar, state: Float[Array, " components"]) -> Float[Array, " components"]:
            return jnp.stack([jnp.asarray(constant(rate), float) for rate in field(time, tuple(state))])

        def iterate(_: int, last: Collocated) -> Collocated:
            values = start + step_size * (jnp.asarray(points.integral) @ jax.vmap(rates)(times, last[0]))
            return values, jnp.max(jnp.abs(values - last[0]), axis=0)

        first = jnp.broadcast_to(start, (self.degree + 1, len(x))), jnp.zeros_like(start)
        return lax.fori_loop(0, _ITERATIONS, iterate, first)

    def _polynomials(
        self, values: Float[Array, "nodes components"], step_size: Scalar, x: Sequence[Scalar]
    ) -> Polynomials:
        # A step of no length stays at its start; the powers of a tiny length would not be finite.
        unit = jnp.where(step_size > 1e-18, step_size, 1.0)
        powers = basis(self.degree).powers(values) / unit ** jnp.arange(self.degree + 1.0)[:, None]
        powers = jnp.where(step_size > 1e-18, powers, 0.0)
        return [[x[i], *(powers[k, i] for k in range(1, self.degree + 1))] for i in range(len(x))]
