"""Any adaptive one-step solver of diffrax as a step method."""

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, TypeAlias

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ...core import Scalar, Truth
from ..polynomials import Polynomials, basis
from ..taylor_series import Field, constant
from .base import AbstractStepMethod, KnownStep, Piece

Solver: TypeAlias = diffrax.AbstractSolver[Any]
"""A solver with a state of any type."""


class OneStep(AbstractStepMethod):
    """Any diffrax solver with an error estimate, for example `OneStep(diffrax.Kvaerno5())`.

    The dense output is rewritten as a polynomial of degree `degree`, exactly where that is
    at least its own.  The root finder of an implicit solver works to a hundredth of the tolerance.
    """

    solver: Solver = diffrax.Tsit5()
    degree: int = eqx.field(static=True, default=8)
    velocity_noise: ClassVar[float] = 10.0
    second_derivative_factor: ClassVar[float] = 0.01

    @property
    def span(self) -> float:
        # Explicit Runge-Kutta methods are stable up to 2.5 and more; implicit ones damp every decaying component.
        return np.inf if isinstance(self._inner(), diffrax.AbstractImplicitSolver) else 2.5

    def __check_init__(self):
        if not isinstance(self.solver, diffrax.AbstractAdaptiveSolver | diffrax.HalfSolver):
            raise ValueError(
                f"`solver` must estimate its error, but {type(self.solver).__name__} does not. "
                "Try diffrax.HalfSolver around it."
            )

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
        polynomials, error, ok = self._step(field, t_local, x, error_weights, step_size)
        size = jnp.max(jnp.abs(error))
        size = jnp.where(ok & jnp.isfinite(size), size, 1e10)
        order = self.solver.order(diffrax.ODETerm(lambda t, y, args: y)) or 1
        factor = jnp.clip(0.9 * (size + 1e-30) ** (-1.0 / (order + 1.0)), 0.1, 5.0)
        accepted = size <= 1.0
        grown = jnp.where(
            accepted & (step_size == remaining),
            jnp.maximum(proposed_step, step_size * factor),
            step_size * factor,
        )
        return Piece(polynomials, step_size, accepted, grown)

    def expand(
        self, step: Callable[..., KnownStep], *rows: Float[Array, "rows ..."]
    ) -> list[Float[Array, "coefficients rows"]]:
        polynomials = jax.vmap(lambda *row: self._step(*step(*row))[0])(*rows)
        return [jnp.stack(coefficients) for coefficients in polynomials]

    def _step(
        self, field: Field, t_local: Scalar, x: Sequence[Scalar], error_weights: Sequence[Scalar], step_size: Scalar
    ) -> tuple[Polynomials, Float[Array, " components"], Truth]:
        scale = jnp.stack(error_weights)

        def scaled(time: Any, state: Float[Array, " components"], args: object) -> Float[Array, " components"]:
            rates = field(t_local + time * step_size, tuple(state / scale))
            return jnp.stack([constant(rate) for rate in rates]) * scale * step_size

        term, solver = diffrax.ODETerm(scaled), self._with_tight_root_finder()
        start = jnp.stack(x) * scale
        begin, end = jnp.zeros_like(t_local), jnp.ones_like(t_local)
        solver_state = solver.init(term, begin, end, start, None)
        _, error, dense, _, result = solver.step(term, begin, end, start, None, solver_state, False)
        inner = solver.interpolation_cls(t0=begin, t1=end, **dense)
        points = basis(self.degree)
        values = jax.vmap(inner.evaluate)(jnp.asarray(points.nodes) + 0.0 * t_local)
        # The solver's time runs from 0 to 1.
        unit = jnp.where(step_size > 0, step_size, 1.0)
        coefficients = points.powers(values) / scale / unit ** jnp.arange(self.degree + 1.0)[:, None]
        polynomials: Polynomials = [[coefficients[k, i] for k in range(self.degree + 1)] for i in range(len(x))]
        return polynomials, error, result == diffrax.RESULTS.successful

    def _inner(self) -> Any:
        return self.solver.solver if isinstance(self.solver, diffrax.HalfSolver) else self.solver

    def _with_tight_root_finder(self) -> Any:
        solver: Any = _differentiable(self.solver)
        if isinstance(solver, diffrax.HalfSolver):
            solver = eqx.tree_at(lambda s: s.solver, solver, _differentiable(solver.solver))
        if not isinstance(solver, diffrax.AbstractImplicitSolver):
            return solver
        kind = type(solver.root_finder)
        if issubclass(kind, diffrax.VeryChord):
            # It fails where an exact first guess leaves it nothing but rounding, unless that is below 1e-13 of
            # `atol`.  What counts as solved is `kappa * atol`, so both are shifted.
            precise = kind(rtol=0.0, atol=1e6, kappa=1e-8, norm=optx.max_norm)
        else:
            precise = kind(rtol=1e-12, atol=1e-2, norm=optx.max_norm)
        return eqx.tree_at(lambda s: s.root_finder, solver, precise)


def _differentiable(solver: Any) -> Any:
    """The solver with its loop over the stages open to forward as well as to reverse mode."""
    if getattr(solver, "scan_kind", "") is not None:
        return solver
    return eqx.tree_at(lambda s: s.scan_kind, solver, "bounded", is_leaf=lambda leaf: leaf is None)
