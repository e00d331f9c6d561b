"""The loop of a least-squares solver: one compiled iteration after the other, apart from problem and method."""

from collections.abc import Callable, Iterator
from typing import Any

import equinox as eqx
import optimistix as optx
from jaxtyping import Array, Float

from .ending import Ending


@eqx.filter_jit
def iterate(
    solver: optx.AbstractLeastSquaresSolver,
    residual: Callable,
    point: Float[Array, " p"],
    args: Any,
    options: Any,
    state,
) -> tuple[Float[Array, " p"], Any, Any]:
    """One iteration of `solver` on `residual(point, args)`: point and state after it, and whether it was the last."""
    point, state, _ = solver.step(residual, point, args, options, state, frozenset())
    over, _ = solver.terminate(residual, point, args, options, state, frozenset())
    return point, state, over


def iterates(
    solver: optx.AbstractLeastSquaresSolver, residual: Callable, point: Any, args: Any, options: Any, state, limit: int
) -> Iterator[tuple[Float[Array, " p"], Any]]:
    """Point and state after every iteration, until the solver ends or has linearised `limit` times.

    At least one iteration is made.  An ending that the solver has begun to check is checked to its end.
    """
    while True:
        point, state, over = iterate(solver, residual, point, args, options, state)
        yield point, state
        if over or (int(state.iterations) >= limit and int(state.ending) == Ending.RUNNING):
            return
