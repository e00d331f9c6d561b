"""A run with its derivatives, to second order, in both modes and under `vmap`: the one place where JAX meets the steps.

The steps are found without derivatives (`forward_pass`).  Their derivatives by every parameter that moves are found
side by side (`sensitivities`), as whole arrays.  What JAX is told is a function whose derivative is an array times a
direction; the derivative of that array is the array of second order times a direction.  So forward and reverse mode
nest in any order, and directions asked for together share all but that product.

`ruled_call` is a JAX primitive with a derivative rule of its own.  `jax.custom_jvp` is not enough for a rule whose
derivative is wanted, too: where JAX takes a loop apart to transpose it, it drops the rule and differentiates what the
function does (`lax.map` in forward over reverse mode).  A primitive keeps its rule.  Under `vmap` lanes run one after
the other: side by side every lane of an adaptive loop waits for the one with most steps, and each `lax.cond` computes
both of its sides.
"""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.extend.core import Primitive, jaxpr_as_fun
from jax.interpreters import ad, batching, mlir
from jaxtyping import Array, Bool, Float, Int

from ..core import Count, Scalar, Tree, Truth
from .accuracy import Accuracy
from .forward_pass import find_steps
from .polynomials import horner
from .sensitivities import Keep, StepDerivatives, differentiated_steps
from .step_table import KNOWN_COLUMNS, LoopState, Row, Table, TakenSteps, read
from .system import AbstractHybridSystem
from .tiles import read_by_blocks, tiled

Result = TypeVar("Result")

Rule: TypeAlias = Callable[[tuple[Any, ...], tuple[Any, ...]], tuple[Any, Any]]
"""A function from arguments and tangents to a result and its tangents; a tangent of None does not move."""

_FlatRule: TypeAlias = Callable[
    [Sequence[Array], Sequence[Array | None]], tuple[Sequence[Array], Sequence[Array | None]]
]


def ruled_call(function: Callable[..., Result], rule: Rule, *args: Tree) -> Result:
    """`function(*args)`, a pytree of arrays, whose derivatives follow from `rule`.

    **Arguments:** `args` are pytrees, of which the arrays may move.  Neither `function` nor `rule` may hold traced
    arrays that are not among them.
    """
    arrays, static = eqx.partition(args, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    whole = lambda leaves: eqx.combine(jax.tree.unflatten(structure, leaves), static)
    types = [jax.ShapeDtypeStruct(t.shape, t.dtype, weak_type=t.weak_type) for t in map(jax.typeof, leaves)]
    call, result = jax.make_jaxpr(lambda *leaves: function(*whole(leaves)), return_shape=True)(*types)

    def flat_rule(
        primals: Sequence[Array], tangents: Sequence[Array | None]
    ) -> tuple[Sequence[Array], Sequence[Array | None]]:
        out, out_dot = rule(whole(primals), jax.tree.unflatten(structure, tangents))
        return jax.tree.leaves(out), jax.tree.leaves(out_dot, is_leaf=lambda leaf: leaf is None)

    found = _CALL.bind(*leaves, call=jaxpr_as_fun(call), types=tuple(call.out_avals), rule=flat_rule)
    return jax.tree.unflatten(jax.tree.structure(result), found)


_CALL = Primitive("pdssjax_run")
_CALL.multiple_results = True


# What is called is a function, not the traced program itself: newer versions of JAX want rules of their own for
# primitives that hold one.
_Call: TypeAlias = Callable[..., list[Array]]
_Types: TypeAlias = tuple[Any, ...]
"""The abstract value of each result, in a class of its own."""


def _computed(*leaves: Array, call: _Call, types: _Types, rule: _FlatRule) -> list[Array]:
    return call(*leaves)


def _differentiated(
    primals: Sequence[Array], tangents: Sequence[Any], *, call: _Call, types: _Types, rule: _FlatRule
) -> tuple[Sequence[Array], Sequence[Any]]:
    moves = [None if type(tangent) is ad.Zero else tangent for tangent in tangents]
    out, out_dot = rule(primals, moves)
    none = [ad.Zero(jax.typeof(leaf).to_tangent_aval()) for leaf in out]
    return out, [zero if dot is None else dot for zero, dot in zip(none, out_dot, strict=True)]


def _lane_by_lane(
    leaves: Sequence[Array], axes: Sequence[int | None], *, call: _Call, types: _Types, rule: _FlatRule
) -> tuple[Sequence[Array], Sequence[int]]:
    mapped = [jnp.moveaxis(leaf, axis, 0) for leaf, axis in zip(leaves, axes, strict=True) if axis is not None]

    def lane(mapped: list[Array]) -> list[Array]:
        these = iter(mapped)
        whole = [leaf if axis is None else next(these) for leaf, axis in zip(leaves, axes, strict=True)]
        return _CALL.bind(*whole, call=call, types=types, rule=rule)

    found = lax.map(lane, mapped)
    return found, [0] * len(found)


_CALL.def_impl(lambda *leaves, call, types, rule: jax.jit(call)(*leaves))
_CALL.def_abstract_eval(lambda *leaves, call, types, rule: list(types))
ad.primitive_jvps[_CALL] = _differentiated
batching.primitive_batchers[_CALL] = _lane_by_lane
mlir.register_lowering(_CALL, mlir.lower_fun(_computed, multiple_results=True))


Begins: TypeAlias = Sequence[Float[Array, " rows"]]
"""The numbers with which steps begin, an array each: origin, local time and every component of the state."""

_HIGHEST = 2
"""Order of the highest derivatives there are."""


class RunDerivatives(NamedTuple):
    """Results of a run with their derivatives up to some order; the axes of the parameters come last."""

    begins: tuple[tuple[Float[Array, "rows *parameters"], ...], ...]
    """Origin, local time and each component of the state where steps begin: of every step, or where the repeated period
    opened and then where the steps of the times begin, zeros for those that are not read.  Apart, since who reads them
    seldom needs all."""
    end: tuple[Float[Array, "begin *parameters"], ...]
    """Origin, local time and state where the run stopped."""
    shown: tuple[tuple[Float[Array, "rows kept *shape"], ...], ...]
    """The components kept.  Of every step its polynomials; or their values at the times, and derivatives of these by
    the time since the step's begin: `shown[i][j]` is of order i in the parameters and j in the time."""


class RunFacts(NamedTuple):
    """Results of a run without derivatives."""

    steps: Row
    """Rows of every step, or of the steps of the times."""
    laps: Float[Array, " m"]
    """How often the repeated period has passed before each of the times."""
    loop: LoopState


class RunExtent(NamedTuple):
    """How far a run goes, and is read."""

    horizon: Scalar
    """When it ends [s]."""
    wanted: Count
    """How many of the times are read."""
    steps: TakenSteps | None = None
    """Its steps where they are known, for systems of the same numbers; None: they are found."""


def steps_of(
    system: AbstractHybridSystem, horizon: Scalar, accuracy: Accuracy, keep: Keep
) -> tuple[Begins, Float[Array, " begin"], Float[Array, "room kept coefficients"], RunFacts]:
    """The begin and the polynomials of every step to the `horizon` [s], the end of the run, and what else is known."""
    extent = RunExtent(horizon, jnp.zeros((), int))
    derivatives, facts = _results_of_run((*_all_fixed(system), None), 0, extent, accuracy, keep)
    return derivatives.begins[0], derivatives.end[0], derivatives.shown[0][0], facts


def components_at(
    system: AbstractHybridSystem, times: Float[Array, " m"], extent: RunExtent, accuracy: Accuracy, keep: Keep
) -> tuple[Begins, Float[Array, " begin"], Float[Array, "m kept"], RunFacts]:
    """The begins of the repeated period and of the steps of `times` [s]; the end; the components kept at the times.

    What belongs to times beyond those of the `extent` is unknown.
    """
    derivatives, facts = _results_of_run((*_all_fixed(system), times), 0, extent, accuracy, keep)
    return derivatives.begins[0], derivatives.end[0], derivatives.shown[0][0], facts


def _all_fixed(system: AbstractHybridSystem) -> tuple[Any, Any]:
    return eqx.partition(system, lambda _: False)


RunInputs: TypeAlias = tuple[Any, Any, Float[Array, " m"] | None]
"""The leaves of a system by which derivatives are taken, the other ones, and the times [s]; None: of every step."""


def _results_of_run(
    inputs: RunInputs, order: int, extent: RunExtent, accuracy: Accuracy, keep: Keep
) -> tuple[RunDerivatives, RunFacts]:
    """The results of a run: those with derivatives, up to `order`, and those without."""
    function = partial(_run_derivatives, order=order, keep=keep)
    return ruled_call(function, partial(_run_derivatives_jvp, order=order, keep=keep), inputs, extent, accuracy)


def _run_derivatives(
    inputs: RunInputs, extent: RunExtent, accuracy: Accuracy, order: int, keep: Keep
) -> tuple[RunDerivatives, RunFacts]:
    moving, fixed, times = inputs
    horizon, wanted, known = extent
    table, loop = find_steps(eqx.combine(moving, fixed), horizon, accuracy) if known is None else known
    size = table.shape[1] - KNOWN_COLUMNS
    carry, tile = differentiated_steps(moving, fixed, accuracy, keep, size, order)
    end = end_of(loop)
    if times is None:
        ends, steps = tiled(tile, carry, table, loop.count)
        shown = tuple((polynomials,) for polynomials in steps.polynomials)
        begins = tuple(tuple(of_order[:, i] for i in range(size)) for of_order in (table, *steps.begins))
        return RunDerivatives(begins, (end, *ends), shown), RunFacts(read(table.T), jnp.zeros(0), loop)
    rows, laps = _located(table, loop, times)
    begun = tuple(table[rows, i] for i in range(size))
    elapsed = since_begins(begun, end, laps, times)

    def seen(found: StepDerivatives, rows: Int[Array, " part"], elapsed: Float[Array, " part"]) -> Any:
        begins = [tuple(_rows_of(rows, derivative[:, i]) for i in range(size)) for derivative in found.begins]
        here = [_rows_of(rows, polynomials) for polynomials in found.polynomials]
        return begins, [[_at(here[i], elapsed, j) for j in range(order - i + 1)] for i in range(order + 1)]

    elapsed = jnp.concatenate([jnp.zeros(1), elapsed])
    ends, (begins, shown) = read_by_blocks(tile, carry, table, loop.count, seen, rows, 1 + wanted, elapsed)
    shown = jax.tree.map(lambda a: a[1:], shown)
    derivatives = RunDerivatives((begun, *begins), (end, *ends), tuple(tuple(of_order) for of_order in shown))
    return derivatives, RunFacts(read(table[rows[1:]].T), laps, loop)


def _run_derivatives_jvp(
    primals: tuple[RunInputs, RunExtent, Accuracy], tangents: tuple[RunInputs, Any, Any], order: int, keep: Keep
) -> tuple[tuple[RunDerivatives, RunFacts], tuple[RunDerivatives, Any]]:
    if order == _HIGHEST:
        raise NotImplementedError(
            f"found a derivative of order {order + 1} of an integrated motion, expected at most {_HIGHEST}: "
            "use differences of the second derivatives."
        )
    (moving, fixed, times), extent, accuracy = primals
    (moving_dot, fixed_dot, times_dot), _, _ = tangents
    moving, fixed, direction, before = _activate_tangents(moving, fixed, moving_dot, fixed_dot)
    if order + 1 == _HIGHEST:
        accuracy = _finer(accuracy)
    more, facts = _results_of_run((moving, fixed, times), order + 1, extent, accuracy, keep)
    # Derivatives by what moved before, and their tangents along the direction.
    of = lambda derivative, i: _select_parameters(derivative, before, i)
    # The direction comes first: of many that are mapped over, the results lie in order.
    along = lambda derivative, i: of(jnp.tensordot(direction, derivative, axes=(0, -1)), i)
    orders = range(order + 1)
    each = lambda change, begins, i: tuple(change(component, i) for component in begins)
    begins_dot = tuple(each(along, more.begins[i + 1], i) for i in orders)
    end_dot = tuple(along(more.end[i + 1], i) for i in orders)
    if times is None:
        shown = tuple((of(more.shown[i][0], i),) for i in orders)
        shown_dot = tuple((along(more.shown[i + 1][0], i),) for i in orders)
    else:
        times_dot = jnp.zeros_like(times) if times_dot is None else times_dot
        since = lambda begins, end, times: since_begins(begins, end, facts.laps, times)
        elapsed_dot = jax.jvp(since, (more.begins[0], more.end[0], times), (begins_dot[0], end_dot[0], times_dot))[1]
        later = lambda i, j: of(more.shown[i][j + 1], i) * elapsed_dot.reshape(-1, *(1,) * (i + 1))
        shown = tuple(tuple(of(more.shown[i][j], i) for j in range(order - i + 1)) for i in orders)
        shown_dot = tuple(
            tuple(along(more.shown[i + 1][j], i) + later(i, j) for j in range(order - i + 1)) for i in orders
        )
    derivatives = RunDerivatives(
        tuple(each(of, more.begins[i], i) for i in orders), tuple(of(more.end[i], i) for i in orders), shown
    )
    return (derivatives, facts), (RunDerivatives(begins_dot, end_dot, shown_dot), jax.tree.map(lambda _: None, facts))


def _finer(accuracy: Accuracy) -> Accuracy:
    """For second derivatives: each order of derivatives loses digits."""
    factor = accuracy.method.second_derivative_factor
    tolerances = {name: factor * getattr(accuracy, name) for name in ("tolerance", "settle_tolerance")}
    return dataclasses.replace(accuracy, **tolerances)


def _activate_tangents(
    moving: Any, fixed: Any, moving_dot: Any, fixed_dot: Any
) -> tuple[Any, Any, Float[Array, " parameters"], Bool[np.ndarray, " parameters"]]:
    """The moving and the fixed leaves once more leaves move, the tangent direction, and which of it moved before."""
    is_none = lambda leaf: leaf is None
    joining, fixed = eqx.partition(fixed, jax.tree.map(lambda dot: dot is not None, fixed_dot, is_leaf=is_none))
    direction, moved_before = [jnp.zeros(0)], [np.zeros(0, bool)]
    leaves = [jax.tree.leaves(tree, is_leaf=is_none) for tree in (moving, moving_dot, joining, fixed_dot)]
    for moved, moved_dot, joined, joined_dot in zip(*leaves, strict=True):
        if moved is not None or joined is not None:
            leaf, tangent = (joined, joined_dot) if moved is None else (moved, moved_dot)
            direction.append(jnp.ravel(jnp.zeros(jnp.shape(leaf)) if tangent is None else tangent))
            moved_before.append(np.full(jnp.size(leaf), moved is not None))
    return eqx.combine(moving, joining), fixed, jnp.concatenate(direction), np.concatenate(moved_before)


def _select_parameters(derivative: Array, moved_before: Bool[np.ndarray, " parameters"], order: int) -> Array:
    """The part of a derivative that belongs to the parameters that `moved_before`, along each of its last axes."""
    if moved_before.all():
        return derivative
    for axis in range(derivative.ndim - order, derivative.ndim):
        derivative = jnp.take(derivative, np.flatnonzero(moved_before), axis)
    return derivative


def end_of(loop: LoopState) -> Float[Array, " begin"]:
    """Where a run ended, as a step's begin: origin, local time and state."""
    return jnp.stack([loop.origin, loop.t_local, *loop.x])


def _located(table: Table, loop: LoopState, times: Float[Array, " m"]) -> tuple[Int[Array, " m+1"], Float[Array, " m"]]:
    """The step with which the repeated period opened and those within which `times` [s] lie; and the laps."""
    end = end_of(loop)
    begin = lambda rows: table[rows, 0] + table[rows, 1]
    run = loop.count, len(table), table[loop.period, 0], end[0] + end[1], loop.repeats
    row, laps = locate_times(begin, *run, times)
    return jnp.concatenate([loop.period[None], row]), laps


def locate_times(
    begin: Callable[[Int[Array, " m"]], Float[Array, " m"]],
    count: Count,
    room: int,
    opening: Scalar,
    stop: Scalar,
    repeats: Truth,
    times: Float[Array, " m"],
) -> tuple[Int[Array, " m"], Float[Array, " m"]]:
    """The step in which each of the `times` [s] lies, and how often the last period was repeated before it.

    **Arguments:** `begin` tells the times [s] at which some of the `count` steps begin, in order, and there is `room`
    for so many; the last period lies between `opening` and `stop` [s].  Nothing here has a derivative.
    """
    opening, stop, times = lax.stop_gradient((opening, stop, times))
    cycle = jnp.where(repeats, stop - opening, 1.0)
    laps = jnp.where(repeats, jnp.maximum(jnp.floor((times - stop) / cycle) + 1.0, 0.0), 0.0)
    within = times - laps * cycle

    def halve(_: Count, ends: tuple[Int[Array, " m"], Int[Array, " m"]]) -> tuple[Int[Array, " m"], Int[Array, " m"]]:
        low, high = ends
        middle = (low + high) // 2
        later = lax.stop_gradient(begin(middle)) > within
        return jnp.where(later, low, middle), jnp.where(later, middle, high)

    # A table has far more room than steps: looking at all of it takes longer than all else here.  The halvings are of a
    # number that is known: JAX cannot differentiate another loop in all nested modes, even where nothing moves.
    first = jnp.zeros(times.shape, int)
    return lax.fori_loop(0, room.bit_length(), halve, (first, first + count))[0], laps


def since_begins(
    begins: Begins, end: Float[Array, " begin"], laps: Float[Array, " m"], times: Float[Array, " m"]
) -> Float[Array, " m"]:
    """Time [s] from the begin of the step of each of the `times` [s], after so many repetitions of the period.

    **Arguments:** the first of the begins opens the period that is repeated, and the `end` ends it.
    """
    origin, t_local, *_ = begins
    period = end[0] + end[1] - origin[0]
    within = times - laps * jnp.where(laps > 0, period, 1.0)
    return jnp.maximum(within - (origin[1:] + t_local[1:]), 0.0)


def _rows_of(rows: Int[Array, " m"], block: Float[Array, "rows *shape"]) -> Float[Array, "m *shape"]:
    """The given rows of a block, its first or last for those of another block."""
    return block[jnp.clip(rows, 0, len(block) - 1)]


def _at(
    polynomials: Float[Array, "m kept coefficients *parameters"], elapsed: Float[Array, " m"], order: int
) -> Float[Array, "m kept *parameters"]:
    """Derivatives of some order by the time, of polynomials `elapsed` [s] after their begin."""
    factor = lambda k: float(np.prod(np.arange(k - order + 1, k + 1)))
    coefficients = [factor(k) * polynomials[:, :, k] for k in range(order, polynomials.shape[2])]
    return horner(coefficients, elapsed.reshape(-1, *(1,) * (coefficients[0].ndim - 1)))
