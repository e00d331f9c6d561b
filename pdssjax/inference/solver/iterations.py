"""The loop of a least-squares solver: one compiled iteration after the other, apart from problem and method."""

from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import equinox as eqx
import numpy as np
import optimistix as optx
from jaxtyping import Array, Float

from ...core import Truth
from .ending import Ending

Solver: TypeAlias = optx.AbstractLeastSquaresSolver[Any, Any, Any, Any]
"""Whatever its own point and state are."""

SolverState: TypeAlias = Any
"""That of the solver, which has an `ending` and a count of `iterations`."""

ResidualFunction: TypeAlias = Callable[[Any, Any], Any]
"""(point, args) to the residuals and what goes with them."""


@eqx.filter_jit
def iterate(
    solver: Solver,
    residual: ResidualFunction,
    point: Float[Array | np.ndarray, " p"],
    args: Float[Array | np.ndarray, " records"],
    options: dict[str, Float[np.ndarray, " p"]],
    state: SolverState,
) -> tuple[Float[Array | np.ndarray, " p"], SolverState, Truth]:
    """One iteration of `solver` on `residual(point, args)`: point and state after it, and whether it was the last."""
    point, state, _ = solver.step(residual, point, args, options, state, frozenset())
    over, _ = solver.terminate(residual, point, args, options, state, frozenset())
    return point, state, over


def iterates(
    solver: Solver,
    residual: ResidualFunction,
    point: Float[Array | np.ndarray, " p"],
    args: Float[Array | np.ndarray, " records"],
    options: dict[str, Float[np.ndarray, " p"]],
    state: SolverState,
    limit: int,
) -> Iterator[tuple[Float[Array | np.ndarray, " p"], SolverState]]:
    """Point and state after every iteration, until the solver ends or has linearised `limit` times.

    At least one iteration is made.  An ending that the solver has begun to check is checked to its end.
    """
    while True:
        point, state, over = iterate(solver, residual, point, args, options, state)
        yield point, state
        if over or (int(state.iterations) >= limit and int(state.ending) == Ending.RUNNING):
            return
