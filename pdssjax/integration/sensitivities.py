"""First and second derivatives of the steps of the forward pass, of many steps at once.

Every step is differentiated about its own start, and a linear recurrence joins the steps.  Where an event ends a step
its end moves with the parameters; that shift is the saltation (docs/numerics.md), here without a matrix of its own.
To second order the time of the event, its slope and the jump are differentiated again.

Derivatives are whole arrays, by every parameter that varies: a linear map of them is all that JAX has to transpose or
to map over, whatever the directions.
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
from .system import AbstractHybridSystem, field_of, initial_state_and_mode, unflattener
from .tiles import Tile
from .tracing import computed_once

Keep: TypeAlias = tuple[int, ...]
"""Components of the state of which the polynomials are kept."""

Ends: TypeAlias = tuple[Float[Array, "start *parameters"], ...]
"""Derivatives of a step's end by the parameters, from first order on."""

_PAIRS = 64
"""Pairs of parameters by which second derivatives are taken at once: bounds the memory."""

_LOST, _LOST_ANYWAY = 3e-4, 1e-9
"""Second derivatives that may be lost with the last of a motion that has settled: a part of them, and a length [m] for
relative changes of the parameters by 1.  Of 700 random actuators three lose 5e-3 of them or more, the others at most
2e-4 or less than that length."""


class StepDerivatives(NamedTuple):
    """Derivatives of the steps of a tile; the axes of the parameters come last."""

    starts: tuple[Float[Array, "rows start *parameters"], ...]
    """Derivatives of origin, local time and state, from first order on."""
    polynomials: tuple[Float[Array, "rows kept coefficients *parameters"], ...]
    """From order 0 on: themselves, and their derivatives."""


class _Subject(NamedTuple):
    """The system whose steps are differentiated, and how."""

    varied: AbstractHybridSystem
    """The leaves by which derivatives are taken."""
    fixed: AbstractHybridSystem
    method: AbstractStepMethod
    tolerance: Scalar
    keep: Keep


def differentiated_steps(
    varied: AbstractHybridSystem,
    fixed: AbstractHybridSystem,
    accuracy: Accuracy,
    keep: Keep,
    size: int,
    order: int,
) -> tuple[Ends, Tile[Ends, StepDerivatives]]:
    """Derivatives of the first step's start by the `varied` leaves of the system, and the function of a tile.

    That function takes derivatives through the steps of a tile, and gives those of its steps.

    **Arguments:** `size` is how many numbers a step starts with; `order` is that of the highest derivatives, up to 2.
    """
    parameters, rebuilt = ravel_pytree(varied)
    subject = _Subject(varied, fixed, accuracy.method, jnp.asarray(accuracy.tolerance, float), keep)
    weights = jnp.outer(parameters, parameters)

    def first_start(parameters: Float[Array, " parameters"]) -> Float[Array, " start"]:
        leaves = jax.tree.leaves(initial_state_and_mode(eqx.combine(rebuilt(parameters), fixed))[0])
        return jnp.concatenate([jnp.zeros(size - len(leaves)), jnp.stack(leaves)])

    def join(
        before: Ends, step: tuple[Truth, Float[Array, "start start"], tuple[Float[Array, "start *parameters"], ...]]
    ) -> tuple[Ends, Ends]:
        real, matrix, gained = step
        after = [_contracted(matrix, derivative) + added for derivative, added in zip(before, gained, strict=True)]
        return tuple(jnp.where(real, new, old) for new, old in zip(after, before, strict=True)), before

    def tile(
        ends: Ends, rows: Float[Array, "rows columns"], real: Bool[Array, " rows"]
    ) -> tuple[Ends, StepDerivatives]:
        if order == 0:
            return ends, StepDerivatives((), (_expanded(subject, rows),))
        polynomials, (end, inner) = _linearised(subject, rows)
        by_start = end[..., :size]
        first, (starts,) = lax.scan(join, ends[:1], (real, by_start, (end[..., size:],)))
        slopes = jax.vmap(_contracted)(inner[..., :size], starts) + inner[..., size:]
        if order == 1:
            return first, StepDerivatives((starts,), (polynomials, slopes))
        unit = jnp.broadcast_to(jnp.eye(parameters.size), (len(rows), parameters.size, parameters.size))
        directions = jnp.concatenate([starts, unit], axis=1)
        end_bends, bends = _second_derivatives(subject, rows, directions)
        second, (start_bends,) = lax.scan(join, ends[1:], (real, by_start, (end_bends,)))
        bends = bends + jax.vmap(_contracted)(inner[..., :size], start_bends)
        next_bends = jnp.concatenate([start_bends[1:], second[0][None]])[:, [2 + component for component in keep]]
        lost = _lost_in_settling(rows, bends * weights, next_bends * weights)
        known = jnp.where(lost & real, jnp.nan, 1.0).min()
        second = tuple(known * derivative for derivative in second)
        return (*first, *second), StepDerivatives((starts, known * start_bends), (polynomials, slopes, known * bends))

    derivatives: list[Callable[[Float[Array, " parameters"]], Array]] = [first_start]
    for _ in range(order):
        derivatives.append(jax.jacfwd(derivatives[-1]))
    return tuple(derivative(parameters) for derivative in derivatives[1:]), tile


def _lost_in_settling(
    rows: Float[Array, "rows columns"],
    bends: Float[Array, "rows kept coefficients parameters parameters"],
    next_bends: Float[Array, "rows kept parameters parameters"],
) -> Bool[Array, " rows"]:
    """Whether too much of the second derivatives is dropped together with the last of a motion.

    A contact that comes to rest by ever smaller sticking and slipping can multiply its sensitivity at each by more
    than the motion shrinks: then the second derivatives grow as the motion dies out, and do not exist in the limit.

    **Arguments:** second derivatives of the kept components by relative changes of the parameters: of the polynomials,
    and at the start of the next step.
    """
    step = read(rows.T)
    ends = horner([bends[:, :, k] for k in range(bends.shape[2])], step.duration[:, None, None, None])
    norm = lambda of_rows: jnp.sqrt(jnp.sum(of_rows**2, axis=(1, 2, 3)))
    return step.becomes_settled & (norm(next_bends - ends) > _LOST_ANYWAY + _LOST * norm(next_bends))


def _contracted(a: Float[Array, "*left inner"], b: Float[Array, "inner *right"]) -> Float[Array, "..."]:
    """The sum over the last axis of `a` and the first of `b`; not a dot product, which XLA would not fuse."""
    left, right = a.ndim - 1, b.ndim - 1
    return jnp.sum(a.reshape(*a.shape, *(1,) * right) * b.reshape(*(1,) * left, *b.shape), axis=left)


# Each is a compiled function of its own, so that it is traced once, however many loops and transformations contain it.
@eqx.filter_jit
def _expanded(subject: _Subject, rows: Float[Array, "rows columns"]) -> Float[Array, "rows kept coefficients"]:
    """The polynomials of the steps `rows`, shape (rows, components kept, degree + 1)."""
    system = eqx.combine(subject.varied, subject.fixed)
    polynomials = subject.method.expand(lambda row: _known_step(system, subject.tolerance, row), rows)
    return _stacked(polynomials, subject.keep)


class _StepsOfTile:
    """The steps of a tile as functions of their inputs: the numbers with which each starts, then the parameters."""

    def __init__(self, subject: _Subject, rows: Float[Array, "rows columns"]):
        self._subject, self._size = subject, rows.shape[1] - KNOWN_COLUMNS
        parameters, self._rebuilt = ravel_pytree(subject.varied)
        starts, shape = rows[:, : self._size], (len(rows), parameters.size)
        self.inputs: Float[Array, "rows inputs"] = jnp.concatenate(
            [starts, jnp.broadcast_to(parameters, shape)], axis=1
        )
        self.known: Float[Array, "rows known"] = rows[:, self._size :]

    def _restored(self, inputs: Array, known: Array) -> tuple[AbstractHybridSystem, Float[Array, " columns"]]:
        """System and row of one step, from its inputs and what is known of it."""
        system = eqx.combine(self._rebuilt(inputs[self._size :]), self._subject.fixed)
        return system, jnp.concatenate([inputs[: self._size], known])

    def step(self, inputs: Array, known: Array) -> KnownStep:
        """One step, from its inputs and what is known of it."""
        system, row = self._restored(inputs, known)
        return _known_step(system, self._subject.tolerance, row)

    def for_each(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """`function(system, row, *values)` for all rows, as a function of all inputs and of the values of each row."""
        of_row = lambda inputs, known, *values: function(*self._restored(inputs, known), *values)
        return lambda inputs, *values: jax.vmap(of_row)(inputs, self.known, *values)


@eqx.filter_jit
def _linearised(
    subject: _Subject, rows: Float[Array, "rows columns"]
) -> tuple[Float[Array, "rows kept coefficients"], Any]:
    """The polynomials of the steps `rows`, and the Jacobians of their ends and polynomials.

    These are by the numbers with which a step starts and by every varied parameter of the system.
    """
    steps = _StepsOfTile(subject, rows)
    step_size, duration = steps.known[:, 2], steps.known[:, 3]

    def flow(inputs: Float[Array, "rows inputs"]) -> tuple[Any, Any]:
        polynomials = subject.method.expand(steps.step, inputs, steps.known)
        kept = _stacked(polynomials, subject.keep)
        # Always true, also where a number is not finite.
        true = ~(step_size[0] < 0.0)
        # Component by component: stacking them takes as long as expanding the steps.
        x = computed_once(true, lambda polynomials: [horner(list(p), duration) for p in polynomials], polynomials)
        x = computed_once(true, steps.for_each(exact_end), inputs, x)
        shift = computed_once(true, steps.for_each(event_shift_of), inputs, x)
        return (steps.for_each(end_to_first_order)(inputs, x, shift), kept), kept

    def pushforward(direction: Float[Array, " inputs"]) -> Any:
        # No row depends on another: one direction serves them all.
        return jax.jvp(flow, (steps.inputs,), (jnp.broadcast_to(direction, steps.inputs.shape),), has_aux=True)

    _, slopes, polynomials = jax.vmap(pushforward, out_axes=(None, -1, None))(jnp.eye(steps.inputs.shape[1]))
    return polynomials, slopes


@eqx.filter_jit
def _second_derivatives(
    subject: _Subject, rows: Float[Array, "rows columns"], directions: Float[Array, "rows inputs parameters"]
) -> tuple[
    Float[Array, "rows start parameters parameters"], Float[Array, "rows kept coefficients parameters parameters"]
]:
    """Second derivatives of the ends and polynomials of the steps `rows`, along pairs of directions of their inputs."""
    steps = _StepsOfTile(subject, rows)

    def flow(inputs: Float[Array, "rows inputs"]) -> tuple[Array, Array]:
        polynomials = subject.method.expand(steps.step, inputs, steps.known)
        each = jnp.stack([coefficients.T for coefficients in polynomials], axis=1)
        return steps.for_each(end_to_second_order)(inputs, each), _stacked(polynomials, subject.keep)

    def bend(pair: tuple[Array, Array]) -> tuple[Array, Array]:
        slope = lambda inputs: jax.jvp(flow, (inputs,), (directions[..., pair[0]],))[1]
        return jax.jvp(slope, (steps.inputs,), (directions[..., pair[1]],))[1]

    count = directions.shape[-1]
    first, second = np.triu_indices(count)
    bends = lax.map(bend, (jnp.asarray(first), jnp.asarray(second)), batch_size=min(_PAIRS, max(len(first), 1)))
    place = np.zeros((count, count), int)
    place[first, second] = place[second, first] = np.arange(len(first))
    whole = lambda upper: jnp.moveaxis(upper[place], (0, 1), (-2, -1))
    return whole(bends[0]), whole(bends[1])


def _stacked(
    polynomials: Sequence[Float[Array, "coefficients rows"]], keep: Keep
) -> Float[Array, "rows kept coefficients"]:
    """The components `keep` of the polynomials of many rows, shape (rows, components kept, degree + 1)."""
    return jnp.stack([polynomials[i].T for i in keep], axis=1)


def _known_step(system: AbstractHybridSystem, tolerance: Scalar, row: Float[Array, " columns"]) -> KnownStep:
    """A step of the table, as step methods take it."""
    step = read(row)
    unflatten = unflattener(system)
    field = field_of(system, system.segment(step.index), unflatten, step.mode)
    scales = lax.stop_gradient(system.error_scale(unflatten(step.x)))
    error_weights = [scale / tolerance for scale in jax.tree.leaves(scales)]
    return KnownStep(field, step.t_local, list(step.x), error_weights, step.step_size)
