"""Taylor series as a solver of diffrax, for fields written with `jax.numpy`.

The coefficients of the solution of y' = f(t, y) follow one from the other: f of the series so far is the derivative
of the next one.  `jax.experimental.jet` expands f along the series.  The step's time runs from 0 to 1, so that the
coefficients are displacements over the step and neither overflow nor vanish.
"""

# What diffrax passes are pytrees, of which the checker knows nothing.
# pyright: reportUnknownParameterType=false, reportIncompatibleMethodOverride=false
# pyright: reportIncompatibleVariableOverride=false, reportUnnecessaryIsInstance=false

from collections.abc import Callable
from typing import ClassVar, TypeAlias

import diffrax
import equinox as eqx
import jax
import jax.numpy as jnp
from jax import lax
from jax.experimental.jet import jet
from jax.extend.core import Primitive
from jaxtyping import Array, Bool, Float, PyTree

from ..core import InputError, Scalar, ScalarLike, Tree, require_float64
from .polynomials import horner

State: TypeAlias = PyTree[Float[Array, "..."]]
"""Whatever is integrated."""

Coefficients: TypeAlias = PyTree[Float[Array, "coefficients ..."]]
"""Coefficients of a step, lowest first, in the fraction of the step that has passed."""


class TaylorInterpolation(diffrax.AbstractLocalInterpolation):
    """The step's own polynomial, as exact between its ends as at them."""

    t0: ScalarLike
    t1: ScalarLike
    coefficients: Coefficients

    def evaluate(self, t0: ScalarLike, t1: ScalarLike | None = None, left: bool = True) -> State:
        """The state at `t0`, or what it changes by from `t0` to `t1`."""
        at = lambda time: jax.tree.map(lambda rows: horner(list(rows), self._share(time)), self.coefficients)
        return at(t0) if t1 is None else jax.tree.map(jnp.subtract, at(t1), at(t0))

    def _share(self, time: ScalarLike) -> Scalar:
        span = jnp.asarray(self.t1 - self.t0)
        return jnp.where(span == 0.0, 0.0, (time - self.t0) / jnp.where(span == 0.0, 1.0, span))


class TaylorSolver(diffrax.AbstractAdaptiveSolver[None]):
    """Taylor series of any order as a solver for `diffrax.diffeqsolve`.

        solver = pdssjax.TaylorSolver(order=22)
        control = diffrax.PIDController(rtol=1e-12, atol=1e-12)
        found = diffrax.diffeqsolve(diffrax.ODETerm(field), solver, 0.0, 20.0, 1e-3, y0, stepsize_controller=control)

    The state is any pytree of floating-point arrays, and the field may use what `jax.experimental.jet` can expand:
    arithmetic, elementary functions, products of matrices, `jnp.where`; it should be smooth, or kinks shorten the
    steps.  Meant for small tolerances: a step costs `order` expansions of the field, but of Van der Pol's equation
    (mu = 5, tolerance 1e-12) it accepts 99 where Dopri8 accepts 503.  Output between the steps is the step's
    own polynomial.  Explicit: no method for stiff systems.

    **Raises:** `InputError` where `order` is below 2, the state holds anything but arrays in double precision, or JAX
    works in single precision, and `NotImplementedError` for a field with an operation that cannot be expanded, such as
    a loop.
    """

    order_: int = eqx.field(static=True)
    term_structure: ClassVar[Tree] = diffrax.ODETerm
    interpolation_cls: ClassVar[Callable[..., TaylorInterpolation]] = TaylorInterpolation

    def __init__(self, order: int = 22):
        if not isinstance(order, int) or isinstance(order, bool) or order < 2:
            raise InputError(f"TaylorSolver: order: found {order!r:.80}, expected a whole number of at least 2.")
        self.order_ = order

    def order(self, terms: Tree) -> int:
        """The order of the series; the error estimate, its last term, falls with the same power of the step."""
        return self.order_

    def init(self, terms: Tree, t0: ScalarLike, t1: ScalarLike, y0: State, args: Tree) -> None:
        """Keep nothing from one step to the next.

        **Raises:** `InputError` for a state that is not of real numbers in double precision.
        """
        require_float64("TaylorSolver")
        for leaf in jax.tree.leaves(y0):
            if jnp.result_type(leaf) != jnp.float64:
                raise InputError(
                    f"TaylorSolver: y0: found an array of {jnp.result_type(leaf)}, expected real arrays of float64."
                )

    def step(
        self,
        terms: Tree,
        t0: ScalarLike,
        t1: ScalarLike,
        y0: State,
        args: Tree,
        solver_state: None,
        made_jump: bool | Bool[Array, ""],
    ) -> tuple[State, State, dict[str, Coefficients], None, diffrax.RESULTS]:
        """The series over one step; its last term is the error estimate, in the units of the state."""
        control = terms.contr(t0, t1)
        share = jnp.asarray(t1 - t0)

        def field(passed: Scalar, y: State) -> State:
            return terms.vf_prod(t0 + share * passed, y, args, control)

        coefficients = taylor_of(field, y0, self.order_)
        y1 = jax.tree.map(lambda rows: horner(list(rows), 1.0), coefficients)
        error = jax.tree.map(lambda rows: jnp.abs(rows[-1]), coefficients)
        return y1, error, {"coefficients": coefficients}, None, diffrax.RESULTS.successful

    def func(self, terms: Tree, t0: ScalarLike, y0: State, args: Tree) -> Tree:
        return terms.vf(t0, y0, args)


def taylor_of(field: Callable[[Scalar, State], State], y0: State, order: int) -> Coefficients:
    """Coefficients of the solution of y' = field(t, y) through `y0` at t = 0, shape (order + 1, ...) a leaf.

    **Raises:** `NotImplementedError` for what `jax.experimental.jet` cannot expand.
    """
    leaves, structure = jax.tree.flatten(y0)
    leaves = [jnp.asarray(leaf) for leaf in leaves]
    zero = jnp.zeros((), jnp.result_type(*leaves))

    def flat(time: Scalar, *y: Array) -> list[Array]:
        out = jax.tree.leaves(field(time, jax.tree.unflatten(structure, y)))
        return [jnp.asarray(rate, leaf.dtype) for rate, leaf in zip(out, y, strict=True)]

    def rates(rows: list[Array]) -> list[Array]:
        """Coefficients 0 to order - 1 of the field along the series."""
        terms = [[row[k] for k in range(1, order)] for row in rows]
        clock = [zero + 1.0, *[zero] * (order - 2)]
        begin, series = jet(
            flat, (zero, *(row[0] for row in rows)), (clock[: order - 1], *terms), factorial_scaled=False
        )
        return [jnp.stack([first, *rest]) for first, rest in zip(begin, series, strict=True)]

    def one_more(rows: list[Array], k: Array) -> tuple[list[Array], None]:
        found = rates(rows)
        return [row.at[k + 1].set(rate[k] / (k + 1.0)) for row, rate in zip(rows, found, strict=True)], None

    begin = [jnp.zeros((order + 1, *leaf.shape), leaf.dtype).at[0].set(leaf) for leaf in leaves]
    try:
        rows, _ = lax.scan(one_more, begin, jnp.arange(order))
    except (NotImplementedError, KeyError) as error:
        # Where it has no rule jet looks one up all the same.
        if isinstance(error, KeyError) and not isinstance(error.args[0], Primitive):
            raise
        raise NotImplementedError(
            f"TaylorSolver: the field has an operation that jax.experimental.jet cannot expand ({error}). Expected "
            "smooth functions of jax.numpy; solvers such as diffrax.Dopri8 take any."
        ) from error
    return jax.tree.unflatten(structure, rows)
