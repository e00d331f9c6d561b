"""A run with its derivatives, to second order, in both modes and under `vmap`: the one place where JAX meets the steps.

The steps are found without derivatives (`forward_pass`).  Their derivatives by every parameter that varies are found
for all steps together (`sensitivities`), as whole arrays.  JAX sees a function whose derivative is an array times a
direction; the derivative of that array is the array of second order times a direction.  So forward and reverse mode
nest in any order, and directions asked for together share all but that product.

`ruled_call` is a JAX primitive with a derivative rule of its own.  `jax.custom_jvp` does not keep a rule whose
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
from .step_table import KNOWN_COLUMNS, LoopState, Row, TakenSteps, read
from .system import AbstractHybridSystem
from .tiles import read_by_blocks, tiled

Result = TypeVar("Result")

Rule: TypeAlias = Callable[[tuple[Any, ...], tuple[Any, ...]], tuple[Any, Any]]
"""A function from arguments and tangents to a result and its tangents; the tangent of what does not vary is None."""


def ruled_call(function: Callable[..., Result], rule: Rule, *args: Tree) -> Result:
    """`function(*args)`, a pytree of arrays, whose derivatives follow from `rule`.

    **Arguments:** `args` are pytrees, of which the arrays may vary.  Neither `function` nor `rule` may hold traced
    arrays that are not among them.
    """
    arrays, static = eqx.partition(args, eqx.is_array)
    leaves, structure = jax.tree.flatten(arrays)
    whole = lambda leaves: eqx.combine(jax.tree.unflatten(structure, leaves), static)
    types = [jax.ShapeDtypeStruct(t.shape, t.dtype, weak_type=t.weak_type) for t in map(jax.typeof, leaves)]
    # Within a transformation JAX has an empty mesh for none, and would trace every inner `jit` once more for that.
    with jax.sharding.use_abstract_mesh(jax.sharding.get_abstract_mesh()):
        call, result = jax.make_jaxpr(lambda *leaves: function(*whole(leaves)), return_shape=True)(*types)

    def jvp(primals: Sequence[Array], tangents: Sequence[Any]) -> tuple[Sequence[Array], Sequence[Any]]:
        varied = [None if type(tangent) is ad.Zero else tangent for tangent in tangents]
        out, out_dot = rule(whole(primals), jax.tree.unflatten(structure, varied))
        out, out_dot = jax.tree.leaves(out), jax.tree.leaves(out_dot, is_leaf=lambda leaf: leaf is None)
        none = [ad.Zero(jax.typeof(leaf).to_tangent_aval()) for leaf in out]
        return out, [zero if dot is None else dot for zero, dot in zip(none, out_dot, strict=True)]

    found = _CALL.bind(*leaves, call=jaxpr_as_fun(call), types=tuple(call.out_avals), jvp=jvp)
    return jax.tree.unflatten(jax.tree.structure(result), found)


def _lane_by_lane(
    leaves: Sequence[Array], axes: Sequence[int | None], **call: Any
) -> tuple[Sequence[Array], Sequence[int]]:
    mapped = [jnp.moveaxis(leaf, axis, 0) for leaf, axis in zip(leaves, axes, strict=True) if axis is not None]

    def lane(mapped: list[Array]) -> list[Array]:
        these = iter(mapped)
        whole = [leaf if axis is None else next(these) for leaf, axis in zip(leaves, axes, strict=True)]
        return _CALL.bind(*whole, **call)

    found = lax.map(lane, mapped)
    return found, [0] * len(found)


# What is called is a function, not the traced program itself: newer versions of JAX want rules of their own for
# primitives that hold one.
_CALL = Primitive("pdssjax_run")
_CALL.multiple_results = True
_CALL.def_impl(lambda *leaves, call, **_: jax.jit(call)(*leaves))
_CALL.def_abstract_eval(lambda *leaves, types, **_: list(types))
ad.primitive_jvps[_CALL] = lambda primals, tangents, *, jvp, **_: jvp(primals, tangents)
batching.primitive_batchers[_CALL] = _lane_by_lane
mlir.register_lowering(_CALL, mlir.lower_fun(lambda *leaves, call, **_: call(*leaves), multiple_results=True))


Starts: TypeAlias = Sequence[Float[Array, " rows"]]
"""The numbers with which steps start, an array each: origin, local time and every component of the state."""

_HIGHEST = 2
"""Order of the highest derivatives there are."""


class RunDerivatives(NamedTuple):
    """Results of a run with their derivatives, from order 0 on; the axes of the parameters come last."""

    starts: tuple[tuple[Float[Array, "rows *parameters"], ...], ...]
    """`starts[i][n]`: derivative of order i of number n of the `Starts`.

    Those of every step, or first of the step that opened the repeated period and then of the steps of the times, zeros
    for times that are not read.  Separate arrays, since a reader seldom needs all.
    """
    end: tuple[Float[Array, "start *parameters"], ...]
    """Origin, local time and state where the run stopped."""
    outputs: tuple[tuple[Float[Array, "rows kept *shape"], ...], ...]
    """The components kept: of every step its polynomials, `outputs[i][0]` of order i in the parameters; or their values
    at the times, `outputs[i][j]` of order i in the parameters and j in the time."""


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


def differentiable_run(
    system: AbstractHybridSystem,
    times: Float[Array, " m"] | None,
    extent: RunExtent,
    accuracy: Accuracy,
    keep: Keep,
) -> tuple[Starts, Float[Array, " start"], Float[Array, "..."], RunFacts]:
    """A run of `system`, differentiable in its floating-point leaves and in the `times` [s].

    **Returns:** the starts, the end, the components kept, and what has no derivative.  Where `times` is None starts and
    polynomials, shape (room, kept, coefficients), are those of every step.  Otherwise the starts are those of the
    repeated period and of the steps of the times, and the components are values, shape (m, kept); those of times
    beyond the wanted ones of the `extent` are unknown.
    """
    varied, fixed = eqx.partition(system, lambda _: False)
    derivatives, facts = _results_of_run((varied, fixed, times), 0, extent, accuracy, keep)
    return derivatives.starts[0], derivatives.end[0], derivatives.outputs[0][0], facts


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
    varied, fixed, times = inputs
    horizon, wanted, known = extent
    table, loop = find_steps(eqx.combine(varied, fixed), horizon, accuracy) if known is None else known
    size = table.shape[1] - KNOWN_COLUMNS
    carry, tile = differentiated_steps(varied, fixed, accuracy, keep, size, order)
    end = jnp.stack([loop.origin, loop.t_local, *loop.x])
    if times is None:
        ends, steps = tiled(tile, carry, table, loop.count)
        polynomials = tuple((derivative,) for derivative in steps.polynomials)
        starts = tuple(tuple(derivative[:, i] for i in range(size)) for derivative in (table, *steps.starts))
        return RunDerivatives(starts, (end, *ends), polynomials), RunFacts(read(table.T), jnp.zeros(0), loop)
    start = lambda rows: table[rows, 0] + table[rows, 1]
    run = loop.count, len(table), table[loop.period, 0], end[0] + end[1], loop.repeats
    row, laps = locate_times(start, *run, times)
    # The step that opened the repeated period comes first.
    rows = jnp.concatenate([loop.period[None], row])
    first = tuple(table[rows, i] for i in range(size))
    elapsed = time_since_starts(first, end, times, laps)

    def read_block(found: StepDerivatives, rows: Int[Array, " part"], elapsed: Float[Array, " part"]) -> Any:
        starts = [tuple(_rows_of(rows, derivative[:, i]) for i in range(size)) for derivative in found.starts]
        here = [_rows_of(rows, polynomials) for polynomials in found.polynomials]
        return starts, [[_at(here[i], elapsed, j) for j in range(order - i + 1)] for i in range(order + 1)]

    elapsed = jnp.concatenate([jnp.zeros(1), elapsed])
    ends, (starts, outputs) = read_by_blocks(tile, carry, table, loop.count, read_block, rows, 1 + wanted, elapsed)
    outputs = jax.tree.map(lambda a: a[1:], outputs)
    derivatives = RunDerivatives((first, *starts), (end, *ends), tuple(tuple(of_order) for of_order in outputs))
    return derivatives, RunFacts(read(table[rows[1:]].T), laps, loop)


def _run_derivatives_jvp(
    primals: tuple[RunInputs, RunExtent, Accuracy], tangents: tuple[RunInputs, Any, Any], order: int, keep: Keep
) -> tuple[tuple[RunDerivatives, RunFacts], tuple[RunDerivatives, Any]]:
    """The derivatives up to `order`, and their tangents, from the derivatives up to one order more."""
    if order == _HIGHEST:
        raise NotImplementedError(
            f"found a derivative of order {order + 1} of an integrated motion, expected at most {_HIGHEST}: "
            "use differences of the second derivatives."
        )
    (varied, fixed, times), extent, accuracy = primals
    (varied_dot, fixed_dot, times_dot), _, _ = tangents
    varied, fixed, direction, varied_before = _activate_tangents(varied, fixed, varied_dot, fixed_dot)
    if order + 1 == _HIGHEST:
        accuracy = _finer(accuracy)
    more, facts = _results_of_run((varied, fixed, times), order + 1, extent, accuracy, keep)
    orders = range(order + 1)

    def primal(derivative: Array, i: int) -> Array:
        """A derivative of order `i` by the parameters that varied before."""
        return _select_parameters(derivative, varied_before, i)

    def tangent(derivative: Array, i: int) -> Array:
        """The tangent of a derivative of order `i`, by the `derivative` of order i + 1."""
        # The direction comes first: of many that are mapped over, the results lie in order.
        return primal(jnp.tensordot(direction, derivative, axes=(0, -1)), i)

    starts_dot = tuple(tuple(tangent(number, i) for number in more.starts[i + 1]) for i in orders)
    end_dot = tuple(tangent(more.end[i + 1], i) for i in orders)
    if times is None:
        outputs = tuple((primal(more.outputs[i][0], i),) for i in orders)
        outputs_dot = tuple((tangent(more.outputs[i + 1][0], i),) for i in orders)
    else:
        elapsed = partial(time_since_starts, laps=facts.laps)
        times_dot = jnp.zeros_like(times) if times_dot is None else times_dot
        at = more.starts[0], more.end[0], times
        _, elapsed_dot = jax.jvp(elapsed, at, (starts_dot[0], end_dot[0], times_dot))

        def by_shift(i: int, j: int) -> Array:
            """What the time of an output since its step's start adds to the tangent."""
            return primal(more.outputs[i][j + 1], i) * elapsed_dot.reshape(-1, *(1,) * (i + 1))

        outputs = tuple(tuple(primal(more.outputs[i][j], i) for j in range(order - i + 1)) for i in orders)
        outputs_dot = tuple(
            tuple(tangent(more.outputs[i + 1][j], i) + by_shift(i, j) for j in range(order - i + 1)) for i in orders
        )
    starts = tuple(tuple(primal(number, i) for number in more.starts[i]) for i in orders)
    derivatives = RunDerivatives(starts, tuple(primal(more.end[i], i) for i in orders), outputs)
    derivatives_dot = RunDerivatives(starts_dot, end_dot, outputs_dot)
    return (derivatives, facts), (derivatives_dot, jax.tree.map(lambda _: None, facts))


def _finer(accuracy: Accuracy) -> Accuracy:
    """For second derivatives: each order of derivatives loses digits."""
    factor = accuracy.method.second_derivative_factor
    tolerances = {name: factor * getattr(accuracy, name) for name in ("tolerance", "settle_tolerance")}
    return dataclasses.replace(accuracy, **tolerances)


def _activate_tangents(
    varied: Any, fixed: Any, varied_dot: Any, fixed_dot: Any
) -> tuple[Any, Any, Float[Array, " parameters"], Bool[np.ndarray, " parameters"]]:
    """The varied and the fixed leaves once those with tangents vary, the direction, and which of it varied before."""
    is_none = lambda leaf: leaf is None
    joining, fixed = eqx.partition(fixed, jax.tree.map(lambda dot: dot is not None, fixed_dot, is_leaf=is_none))
    direction, varied_before = [jnp.zeros(0)], [np.zeros(0, bool)]
    leaves = [jax.tree.leaves(tree, is_leaf=is_none) for tree in (varied, varied_dot, joining, fixed_dot)]
    for old, old_dot, new, new_dot in zip(*leaves, strict=True):
        if old is not None or new is not None:
            leaf, tangent = (new, new_dot) if old is None else (old, old_dot)
            direction.append(jnp.ravel(jnp.zeros(jnp.shape(leaf)) if tangent is None else tangent))
            varied_before.append(np.full(jnp.size(leaf), old is not None))
    return eqx.combine(varied, joining), fixed, jnp.concatenate(direction), np.concatenate(varied_before)


def _select_parameters(derivative: Array, varied_before: Bool[np.ndarray, " parameters"], order: int) -> Array:
    """The part of a derivative that belongs to the parameters that `varied_before`, along each of its last axes."""
    if varied_before.all():
        return derivative
    for axis in range(derivative.ndim - order, derivative.ndim):
        derivative = jnp.take(derivative, np.flatnonzero(varied_before), axis)
    return derivative


def locate_times(
    start: Callable[[Int[Array, " m"]], Float[Array, " m"]],
    count: Count,
    room: int,
    opening: Scalar,
    stop: Scalar,
    repeats: Truth,
    times: Float[Array, " m"],
) -> tuple[Int[Array, " m"], Float[Array, " m"]]:
    """The step in which each of the `times` [s] lies, and how often the last period was repeated before it.

    **Arguments:** `start` gives the times [s] at which some of the `count` steps start, in order, and there is `room`
    for so many; the last period lies between `opening` and `stop` [s].  Nothing here has a derivative.
    """
    opening, stop, times = lax.stop_gradient((opening, stop, times))
    cycle = jnp.where(repeats, stop - opening, 1.0)
    laps = jnp.where(repeats, jnp.maximum(jnp.floor((times - stop) / cycle) + 1.0, 0.0), 0.0)
    within = times - laps * cycle

    def halve(_: Count, ends: tuple[Int[Array, " m"], Int[Array, " m"]]) -> tuple[Int[Array, " m"], Int[Array, " m"]]:
        low, high = ends
        middle = (low + high) // 2
        later = lax.stop_gradient(start(middle)) > within
        return jnp.where(later, low, middle), jnp.where(later, middle, high)

    # A table has far more room than steps: a comparison with all of it takes longer than all else here.  The number of
    # halvings is static: JAX cannot differentiate another loop in all nested modes, even where nothing varies.
    first = jnp.zeros(times.shape, int)
    return lax.fori_loop(0, room.bit_length(), halve, (first, first + count))[0], laps


def time_since_starts(
    starts: Starts, end: Float[Array, " start"], times: Float[Array, " m"], laps: Float[Array, " m"]
) -> Float[Array, " m"]:
    """Time [s] from the start of the step of each of the `times` [s], after so many repetitions of the period.

    **Arguments:** the first of the starts opens the period that is repeated, and the `end` ends it; the others are
    those of the steps of the times.
    """
    origin, t_local, *_ = starts
    period = end[0] + end[1] - origin[0]
    within = times - laps * jnp.where(laps > 0, period, 1.0)
    return jnp.maximum(within - (origin[1:] + t_local[1:]), 0.0)


def _rows_of(rows: Int[Array, " m"], block: Float[Array, "rows *shape"]) -> Float[Array, "m *shape"]:
    """The given rows of a block, its first or last for those of another block."""
    return block[jnp.clip(rows, 0, len(block) - 1)]


def _at(
    polynomials: Float[Array, "m kept coefficients *parameters"], elapsed: Float[Array, " m"], order: int
) -> Float[Array, "m kept *parameters"]:
    """Derivatives of some order by the time, of polynomials `elapsed` [s] after their start."""
    factor = lambda k: float(np.prod(np.arange(k - order + 1, k + 1)))
    coefficients = [factor(k) * polynomials[:, :, k] for k in range(order, polynomials.shape[2])]
    return horner(coefficients, elapsed.reshape(-1, *(1,) * (coefficients[0].ndim - 1)))
