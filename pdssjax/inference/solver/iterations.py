"""The loop of a fit: Levenberg-Marquardt steps driven from Python, between calls of what is compiled once.

The residual is compiled as one function for values and one for values with the Jacobian, whoever calls them; what the
solver makes of them is small.  Within `optimistix.least_squares` the same solver compiles everything together.
"""

from collections.abc import Iterator
from typing import NamedTuple, Protocol, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ...core import Tree, kept_jit
from .levenberg_marquardt import BoundedLevenbergMarquardt, Judgement, ResidualFunction, linearised
from .lm_state import Ending, LMState, Vector
from .trust_region import Bounds, Trial, first_point, second_point, trial_point

Point: TypeAlias = Float[Array | np.ndarray, " p"]

Linearised: TypeAlias = tuple[tuple[Float[Array, " n"], Tree], tuple[Float[Array, "n p"], Tree]]
"""The residuals and what goes with them, and the Jacobian of each of the two."""


class Evaluations(Protocol):
    """Compiled evaluations of a residual: its values alone, and its values with the Jacobian."""

    def values(self, point: Point) -> tuple[Float[Array, " n"], Tree]:
        """The residuals, and what goes with them."""
        ...

    def linearised(self, point: Point) -> Linearised:
        """The outputs of `values`, and the Jacobian of each of the two."""
        ...


class FunctionEvaluations(NamedTuple):
    """Compiled evaluations of any `function(point, args)` that JAX can trace."""

    function: ResidualFunction
    args: Tree

    def values(self, point: Point) -> tuple[Float[Array, " n"], Tree]:
        return _values(self.function, point, self.args)

    def linearised(self, point: Point) -> Linearised:
        return _linearised(self.function, point, self.args)


class Run(NamedTuple):
    """The constants of a run of the solver: all but its point and state."""

    solver: BoundedLevenbergMarquardt
    evaluations: Evaluations
    bounds: Bounds


def iterate(run: Run, point: Point, state: LMState) -> tuple[Point, LMState, bool]:
    """One iteration: point and state after it, and whether it was the last."""
    solver, evaluations, bounds = run
    trial, first, last = _plan_trial(solver, point, bounds, state)
    step, found = trial.proposal.step, state.residual
    if trial.bending or trial.checking:
        found = evaluations.values(first)[0]
        step, last = _bend_step(point, bounds, state, trial, found)  # pyright: ignore[reportArgumentType]
    judged = _judge(solver, point, bounds, state, trial, step, (found, evaluations.values(last)[0]))
    if not bool(judged.accepted):
        return point, judged.state, _is_over(judged.state)
    after = _move(solver, bounds, state, trial, judged, *evaluations.linearised(judged.proposed))
    return judged.proposed if bool(after.accepted) else point, after, _is_over(after)


def iterates(run: Run, point: Point, state: LMState, limit: int) -> Iterator[tuple[Point, LMState]]:
    """Point and state after every iteration, until the solver ends or has linearised `limit` times.

    At least one iteration is made.  An ending that the solver has begun to check is checked to its end.
    """
    while True:
        point, state, over = iterate(run, point, state)
        yield point, state
        if over or (int(state.iterations) >= limit and int(state.ending) == Ending.RUNNING):
            return


def _is_over(state: LMState) -> bool:
    ending, checked = np.asarray(state.ending), np.asarray(state.checked)  # compared by NumPy, which compiles nothing
    return bool(BoundedLevenbergMarquardt.is_over(ending, checked))  # pyright: ignore[reportArgumentType]


def begin(run: Run, point: Point, residual: Tree, others: Tree) -> LMState:
    """The state before anything is evaluated, for a `residual` of that shape and `others` that go with it."""
    shapes = jax.tree.map(lambda leaf: jax.ShapeDtypeStruct(leaf.shape, leaf.dtype), (residual, others))
    return _blank(run.solver, np.asarray(point), run.bounds, *shapes)


@kept_jit
def _blank(solver: BoundedLevenbergMarquardt, point: Point, bounds: Bounds, residual: Tree, others: Tree) -> LMState:
    return solver.init(lambda point, args: (point, None), point, None, bounds, residual, others, frozenset())


@kept_jit
def _values(function: ResidualFunction, point: Point, args: Tree) -> tuple[Float[Array, " n"], Tree]:
    return function(point, args)


@kept_jit
def _linearised(function: ResidualFunction, point: Point, args: Tree) -> Linearised:
    return linearised(function, jnp.asarray(point), args)


@kept_jit
def _plan_trial(
    solver: BoundedLevenbergMarquardt, point: Point, bounds: Bounds, state: LMState
) -> tuple[Trial, Vector, Vector]:
    """The trial, its first point (a probe or one end of a difference), and the end of its straight step."""
    point = jnp.asarray(point)
    trial = solver.trial(point, bounds, state)
    straight = trial_point(point, trial.proposal.step, trial.proposal, bounds)
    return trial, first_point(point, bounds, trial), jnp.where(state.unevaluated, point, straight)


@kept_jit
def _judge(
    solver: BoundedLevenbergMarquardt,
    point: Point,
    bounds: Bounds,
    state: LMState,
    trial: Trial,
    step: Vector,
    ends: tuple[Float[Array, " n"], Float[Array, " n"]],
) -> Judgement:
    return solver.judge(jnp.asarray(point), bounds, state, trial, step, jnp.stack(ends))


_bend_step, _move = kept_jit(second_point), kept_jit(BoundedLevenbergMarquardt.moved_state)
