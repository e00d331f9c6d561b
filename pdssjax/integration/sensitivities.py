"""First and second derivatives of the steps of the forward pass, computed side by side.

Every step is differentiated about its own start, and a linear recurrence joins the steps.  Where an event ends a step
its end moves with the parameters; that shift is the saltation (docs/numerics.md), here without a matrix of its own.
To second order the time of the event, its slope and the jump are differentiated again.

Derivatives are whole arrays, by every parameter that moves: a linear map of them is all that JAX has to transpose or
to map over, whatever directions are asked for.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from ..core import Scalar, Truth
from .accuracy import Accuracy
from .polynomials import horner
from .step_end import end_to_first_order, end_to_second_order, event_shift_of, exact_end
from .step_methods.base import AbstractStepMethod, KnownStep
from .step_table import KNOWN_COLUMNS, read
from .system import (
    AbstractHybridSystem,
    field_of,
    initial_state_and_mode,
    unflattener,
)
from .taylor_loop import computed_once
from .tiles import Tile

Keep: TypeAlias = tuple[int, ...]
"""Components of the state of which the polynomials are kept."""

Ends: TypeAlias = tuple[Float[Array, "begin *parameters"], ...]
"""Derivatives of a step's end by the parameters, of first order on."""

_PAIRS = 64
"""Pairs of parameters by which second derivatives are taken side by side: bounds the memory."""

_LOST, _LOST_ANYWAY = 3e-4, 1e-9
"""What may be dropped of second derivatives with the last of a motion that has settled: a part of them, and so much
[m] for relative changes of the parameters by 1.  Of 700 drawn actuators three drop 5e-3 of them or more, the others at
most 2e-4 or less than that length."""


class StepDerivatives(NamedTuple):
    """Derivatives of the steps of a tile; the axes of the parameters come last."""

    begins: tuple[Float[Array, "rows begin *parameters"], ...]
    """Derivatives of origin, local time and state, from first order on."""
    polynomials: tuple[Float[Array, "rows kept coefficients *parameters"], ...]
    """Themselves, and their derivatives."""


def differentiated_steps(
    moving: AbstractHybridSystem,
    fixed: AbstractHybridSystem,
    accuracy: Accuracy,
    keep: Keep,
    size: int,
    order: int,
) -> tuple[Ends, Tile[Ends, StepDerivatives]]:
    """Derivatives of the first step's begin by the `moving` leaves of the system, and what takes them through a tile.

    **Arguments:** `size` is how many numbers begin a step; `order` is that of the highest derivatives, up to 2.
    """
    parameters, rebuilt = ravel_pytree(moving)
    method, tolerance = accuracy.method, jnp.asarray(accuracy.tolerance, float)
    weights = jnp.outer(parameters, parameters)

    def started(parameters: Float[Array, " parameters"]) -> Float[Array, " begin"]:
        leaves = jax.tree.leaves(initial_state_and_mode(eqx.combine(rebuilt(parameters), fixed))[0])
        return jnp.concatenate([jnp.zeros(size - len(leaves)), jnp.stack(leaves)])

    def join(
        before: Ends, step: tuple[Truth, Float[Array, "begin begin"], tuple[Float[Array, "begin *parameters"], ...]]
    ) -> tuple[Ends, Ends]:
        real, matrix, gained = step
        moved = [_contracted(matrix, derivative) + added for derivative, added in zip(before, gained, strict=True)]
        return tuple(jnp.where(real, new, old) for new, old in zip(moved, before, strict=True)), before

    def tile(
        ends: Ends, rows: Float[Array, "rows columns"], real: Bool[Array, " rows"]
    ) -> tuple[Ends, StepDerivatives]:
        if order == 0:
            return ends, StepDerivatives((), (_expanded(eqx.combine(moving, fixed), method, tolerance, keep, rows),))
        polynomials, (end, inner) = _linearised(moving, fixed, method, tolerance, keep, rows)
        of_begin = end[..., :size]
        first, (begins,) = lax.scan(join, ends[:1], (real, of_begin, (end[..., size:],)))
        slopes = jax.vmap(_contracted)(inner[..., :size], begins) + inner[..., size:]
        if order == 1:
            return first, StepDerivatives((begins,), (polynomials, slopes))
        unit = jnp.broadcast_to(jnp.eye(parameters.size), (len(rows), parameters.size, parameters.size))
        along = jnp.concatenate([begins, unit], axis=1)
        end_bends, bends = _second_derivatives(moving, fixed, method, tolerance, keep, rows, along)
        second, (begin_bends,) = lax.scan(join, ends[1:], (real, of_begin, (end_bends,)))
        bends = bends + jax.vmap(_contracted)(inner[..., :size], begin_bends)
        follows = jnp.concatenate([begin_bends[1:], second[0][None]])[:, [2 + component for component in keep]]
        lost = _lost_in_settling(rows, bends * weights, follows * weights)
        known = jnp.where(lost & real, jnp.nan, 1.0).min()
        second = tuple(known * derivative for derivative in second)
        return (*first, *second), StepDerivatives((begins, known * begin_bends), (polynomials, slopes, known * bends))

    derivatives: list[Callable[[Float[Array, " parameters"]], Array]] = [started]
    for _ in range(order):
        derivatives.append(jax.jacfwd(derivatives[-1]))
    return tuple(derivative(parameters) for derivative in derivatives[1:]), tile


def _lost_in_settling(
    rows: Float[Array, "rows columns"],
    bends: Float[Array, "rows kept coefficients parameters parameters"],
    follows: Float[Array, "rows kept parameters parameters"],
) -> Bool[Array, " rows"]:
    """Whether with the last of a motion more of the second derivatives is dropped than it may be.

    A contact that comes to rest by ever smaller sticking and slipping can multiply its sensitivity at each by more
    than the motion shrinks: then the second derivatives grow as the motion dies out, and do not exist in the limit.

    **Arguments:** second derivatives of the kept components by relative changes of the parameters: of the polynomials,
    and those with which the next step begins.
    """
    step = read(rows.T)
    ends = horner([bends[:, :, k] for k in range(bends.shape[2])], step.duration[:, None, None, None])
    norm = lambda of_rows: jnp.sqrt(jnp.sum(of_rows**2, axis=(1, 2, 3)))
    return step.becomes_settled & (norm(follows - ends) > _LOST_ANYWAY + _LOST * norm(follows))


def _contracted(a: Float[Array, "*left inner"], b: Float[Array, "inner *right"]) -> Float[Array, "..."]:
    """The sum over the last axis of `a` and the first of `b`; not a dot product, which XLA would not fuse."""
    left, right = a.ndim - 1, b.ndim - 1
    return jnp.sum(a.reshape(*a.shape, *(1,) * right) * b.reshape(*(1,) * left, *b.shape), axis=left)


# These are compiled functions of their own so that they are traced once, however often loops and transformations
# look at them.
@eqx.filter_jit
def _expanded(
    system: AbstractHybridSystem,
    method: AbstractStepMethod,
    tolerance: Scalar,
    keep: Keep,
    rows: Float[Array, "rows columns"],
) -> Float[Array, "rows kept coefficients"]:
    """The polynomials of the steps `rows`, shape (rows, components kept, degree + 1)."""
    polynomials = method.expand(lambda row: _known_step(system, tolerance, row), rows)
    return _kept(polynomials, keep)


class _StepsOfTile(NamedTuple):
    """The steps of a tile as functions of their inputs: the numbers that begin each, then the parameters."""

    inputs: Float[Array, "rows inputs"]
    known: Float[Array, "rows known"]
    restored: Callable[[Array, Array], tuple[AbstractHybridSystem, Float[Array, " columns"]]]
    """System and row of one step, from its inputs and what is known of it."""
    step: Callable[[Array, Array], KnownStep]

    def side_by_side(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """`function(system, row, *found)` of every row, as a function of all inputs and of what was found of each."""
        of_row = lambda inputs, known, *found: function(*self.restored(inputs, known), *found)
        return lambda inputs, *found: jax.vmap(of_row)(inputs, self.known, *found)


def _steps_of_tile(
    moving: AbstractHybridSystem,
    fixed: AbstractHybridSystem,
    tolerance: Scalar,
    rows: Float[Array, "rows columns"],
) -> _StepsOfTile:
    size = rows.shape[1] - KNOWN_COLUMNS
    parameters, rebuilt = ravel_pytree(moving)

    def restored(
        inputs: Float[Array, " inputs"], known: Float[Array, " known"]
    ) -> tuple[AbstractHybridSystem, Float[Array, " columns"]]:
        system = eqx.combine(rebuilt(inputs[size:]), fixed)
        return system, jnp.concatenate([inputs[:size], known])

    def step(inputs: Float[Array, " inputs"], known: Float[Array, " known"]) -> KnownStep:
        system, row = restored(inputs, known)
        return _known_step(system, tolerance, row)

    inputs = jnp.concatenate([rows[:, :size], jnp.broadcast_to(parameters, (len(rows), parameters.size))], axis=1)
    return _StepsOfTile(inputs, rows[:, size:], restored, step)


@eqx.filter_jit
def _linearised(
    moving: AbstractHybridSystem,
    fixed: AbstractHybridSystem,
    method: AbstractStepMethod,
    tolerance: Scalar,
    keep: Keep,
    rows: Float[Array, "rows columns"],
) -> tuple[Float[Array, "rows kept coefficients"], Any]:
    """The polynomials of the steps `rows`, and the Jacobians of their ends and polynomials.

    With respect to the begin and every `moving` parameter of the system.
    """
    steps = _steps_of_tile(moving, fixed, tolerance, rows)
    step_size, duration = steps.known[:, 2], steps.known[:, 3]

    def flow(inputs: Float[Array, "rows inputs"]) -> tuple[Any, Any]:
        polynomials = method.expand(steps.step, inputs, steps.known)
        shown = _kept(polynomials, keep)
        # Always true, also where a number is not finite.
        true = ~(step_size[0] < 0.0)
        # One after the other: to stack them takes as long as to expand the steps.
        x = computed_once(true, lambda polynomials: [horner(list(p), duration) for p in polynomials], polynomials)
        x = computed_once(true, steps.side_by_side(exact_end), inputs, x)
        shift = computed_once(true, steps.side_by_side(event_shift_of), inputs, x)
        return (steps.side_by_side(end_to_first_order)(inputs, x, shift), shown), shown

    # The rows do not know of each other: one direction serves them all.
    inputs = steps.inputs
    along = lambda direction: jax.jvp(flow, (inputs,), (jnp.broadcast_to(direction, inputs.shape),), has_aux=True)
    _, slopes, polynomials = jax.vmap(along, out_axes=(None, -1, None))(jnp.eye(inputs.shape[1]))
    return polynomials, slopes


@eqx.filter_jit
def _second_derivatives(
    moving: AbstractHybridSystem,
    fixed: AbstractHybridSystem,
    method: AbstractStepMethod,
    tolerance: Scalar,
    keep: Keep,
    rows: Float[Array, "rows columns"],
    along: Float[Array, "rows inputs parameters"],
) -> tuple[
    Float[Array, "rows begin parameters parameters"], Float[Array, "rows kept coefficients parameters parameters"]
]:
    """Second derivatives of the ends and polynomials of the steps `rows`, along pairs of directions of their inputs."""
    steps = _steps_of_tile(moving, fixed, tolerance, rows)

    def flow(inputs: Float[Array, "rows inputs"]) -> tuple[Array, Array]:
        polynomials = method.expand(steps.step, inputs, steps.known)
        each = jnp.stack([coefficients.T for coefficients in polynomials], axis=1)
        return steps.side_by_side(end_to_second_order)(inputs, each), _kept(polynomials, keep)

    def bend(pair: tuple[Array, Array]) -> tuple[Array, Array]:
        slope = lambda inputs: jax.jvp(flow, (inputs,), (along[..., pair[0]],))[1]
        return jax.jvp(slope, (steps.inputs,), (along[..., pair[1]],))[1]

    count = along.shape[-1]
    first, second = np.triu_indices(count)
    bends = lax.map(bend, (jnp.asarray(first), jnp.asarray(second)), batch_size=min(_PAIRS, max(len(first), 1)))
    place = np.zeros((count, count), int)
    place[first, second] = place[second, first] = np.arange(len(first))
    whole = lambda upper: jnp.moveaxis(upper[place], (0, 1), (-2, -1))
    return whole(bends[0]), whole(bends[1])


def _kept(
    polynomials: Sequence[Float[Array, "coefficients rows"]], keep: Keep
) -> Float[Array, "rows kept coefficients"]:
    """The components `keep` of the polynomials of many rows, shape (rows, components kept, degree + 1)."""
    return jnp.stack([polynomials[i].T for i in keep], axis=1)


def _known_step(system: AbstractHybridSystem, tolerance: Scalar, row: Float[Array, " columns"]) -> KnownStep:
    """A step of the table, as methods want it."""
    step = read(row)
    unflatten = unflattener(system)
    field = field_of(system, system.segment(step.index), unflatten, step.mode)
    scales = lax.stop_gradient(system.error_scale(unflatten(step.begin)))
    units = [scale / tolerance for scale in jax.tree.leaves(scales)]
    return KnownStep(field, step.t_local, list(step.begin), units, step.step_size)
