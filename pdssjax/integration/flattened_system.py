"""A `HybridSystem` in the integrator's own interface: scalars for arrays, and a run that lasts one unit of time.

The clock of the run goes from 0 to 1, and errors are in units of the tolerances.  So no constant of the integrator,
such as the time within which a tie between events is broken, depends on the user's units.
"""

from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float, Int

from ..core import Count, InputError, Scalar, ScalarLike, Tree
from .hybrid_system import HybridSystem
from .polynomials import basis
from .system import AbstractHybridSystem, State
from .taylor_series import Series, Term, constant, expanding, polynomial, weighted

_FIRST_MODE = 3
"""The integrator's number for the user's mode 0: its own 0 is the mode before the start, and 2 is `SETTLED`."""

_GUARD_DEGREE = 16
"""Degree of the polynomial through a guard along a step."""

_SHORTEST = 1e-15
"""Shortest step, as a part of the run, for which the polynomial through a guard is made."""

_INSIDE = 4.0 * np.finfo(float).eps
"""Part of the largest time by which a time is kept away from the corners."""

Structure: TypeAlias = Any
"""A `PyTreeDef`, for which JAX has no public type."""


class Layout(NamedTuple):
    """How a state's arrays lie in a list of scalars."""

    structure: Structure
    shapes: tuple[tuple[int, ...], ...]

    def split(self, rows: Float[Array, "*rows components"]) -> Tree:
        """The pytree whose components stand along the last axis of `rows`."""
        ends = np.cumsum([int(np.prod(shape)) for shape in self.shapes])
        leaves = jnp.split(rows, ends[:-1], axis=-1)
        whole = [leaf.reshape(*rows.shape[:-1], *shape) for leaf, shape in zip(leaves, self.shapes, strict=True)]
        return jax.tree.unflatten(self.structure, whole)

    def joined(self, tree: Tree, what: str) -> Float[Array, " components"]:
        """The components of a pytree; **raises** `InputError` where it is not like the state."""
        structure = jax.tree.structure(tree)
        if structure != self.structure:
            raise InputError(f"{what}: found a {structure}, expected a pytree like the state, {self.structure}.")
        leaves = [jnp.asarray(leaf, float) for leaf in jax.tree.leaves(tree)]
        if tuple(leaf.shape for leaf in leaves) != self.shapes:
            found = ", ".join(str(leaf.shape) for leaf in leaves)
            expected = ", ".join(str(shape) for shape in self.shapes)
            raise InputError(f"{what}: found leaves of shape {found}, expected those of the state, {expected}.")
        return jnp.concatenate([leaf.ravel() for leaf in leaves])


class Stretch(NamedTuple):
    """The time between two corners, in parts of the run."""

    begin: Scalar
    duration: Scalar
    number: Scalar


class FlattenedSystem(AbstractHybridSystem):
    """A user's system, its first state and arguments, on the clock of a run from `t0` on for a `span` of time."""

    system: HybridSystem
    y0: Float[Array, " components"]
    mode0: Count
    args: Tree
    t0: Scalar
    span: Scalar
    rtol: Float[Array, " components"]
    atol: Float[Array, " components"]
    layout: Layout = eqx.field(static=True)
    expands: bool = eqx.field(static=True)
    """Whether fields are asked for Taylor series."""

    def initial(self) -> State:
        return tuple(self.y0)

    def segment(self, index: Scalar) -> Stretch:
        corners = (jnp.sort(self._corners()) - self.t0) / self.span
        begins = jnp.concatenate([jnp.zeros(1), jnp.maximum(corners, 0.0), jnp.full(1, jnp.inf)])
        number = jnp.clip(jnp.asarray(index).astype(int), 0, len(corners))
        return Stretch(begins[number], begins[number + 1] - begins[number], index)

    def field(self, segment: Stretch, t_local: Term, x: State, mode: Scalar) -> State:
        time, user_mode = self._time(segment, t_local), self.user_modes(mode)
        if not any(isinstance(part, Series) for part in (t_local, *x)):
            rates = self.system.vector_field(time, self._state(x), self.args, user_mode)
            return tuple(self.layout.joined(rates, f"{type(self.system).__name__}.vector_field") * self.span)
        rates = self._expanded("vector_field", time, x, user_mode)
        leaves = jax.tree.leaves(rates, is_leaf=lambda leaf: isinstance(leaf, Series))
        return tuple(weighted(rate, self.span) for rate in leaves)

    def guards(self, segment: Stretch, t_local: Term, x: State, mode: Scalar) -> tuple[Term, ...]:
        time, user_mode = self._time(segment, t_local), self.user_modes(mode)
        if not any(isinstance(part, Series) for part in (t_local, *x)):
            return tuple(self.guard_values(time, self._state(x), user_mode))
        guards = self._expanded("guards", time, x, user_mode)
        guards = guards if isinstance(guards, tuple | list) else (guards,)
        return tuple(guard if isinstance(guard, Series) else polynomial([guard]) for guard in guards)

    def _expanded(self, method: str, time: Term, x: State, mode: Count) -> Any:
        """The series that a user's method returns for series; **raises** `InputError` where it cannot take them."""
        state = jax.tree.unflatten(self.layout.structure, list(x))
        with expanding(f"{type(self.system).__name__}.{method}"):
            return getattr(self.system, method)(time, state, self.args, mode)

    def guard_values(self, t: Scalar, y: Tree, mode: Count) -> Float[Array, " guards"]:
        """The user's guards as one array, whatever they came in."""
        given = self.system.guards(t, y, self.args, mode)
        several = isinstance(given, tuple | list)
        guards = [_real(guard) for guard in given] if several else [_real(given)]
        if any(guard is None or guard.ndim > (not several) for guard in guards):
            each = zip(given if several else [given], guards, strict=True)
            kind = lambda guard: getattr(guard, "dtype", type(guard).__name__)
            found = ", ".join(f"{kind(guard) if array is None else f'shape {array.shape}'}" for guard, array in each)
            raise InputError(
                f"{type(self.system).__name__}.guards: found {found}, expected real numbers, positive inside the mode: "
                "one, a tuple of them, or an array with one axis."
            )
        return jnp.concatenate([jnp.atleast_1d(guard) for guard in guards if guard is not None] or [jnp.zeros(0)])

    def guards_along(
        self, segment: Stretch, t_local: Term, x: State, mode: Scalar, size: int, length: Scalar
    ) -> tuple[tuple[Series, ...], int]:
        if self.expands:
            return super().guards_along(segment, t_local, x, mode, size, length)
        points = basis(_GUARD_DEGREE)
        length = jnp.maximum(length, _SHORTEST)
        coefficients = jnp.stack([jnp.stack([jnp.asarray(part[k], float) for part in x]) for k in range(size)])
        elapsed = length * points.nodes
        states = jnp.sum(elapsed[:, None, None] ** np.arange(size)[:, None] * coefficients, axis=1)
        start = constant(t_local)
        at = lambda later, state: jnp.stack([jnp.zeros(()), *self.guards(segment, start + later, tuple(state), mode)])  # pyright: ignore[reportArgumentType]
        values = jax.vmap(at)(elapsed, states)[:, 1:]
        fitted = points.powers(values) / length ** np.arange(_GUARD_DEGREE + 1.0)[:, None]
        fitted = fitted.at[0].set(values[0])
        return tuple(polynomial(list(guard)) for guard in fitted.T), _GUARD_DEGREE + 1

    def after_event(
        self, segment: Stretch, t_local: ScalarLike, x: State, mode: Scalar, which: Scalar
    ) -> tuple[State, Scalar]:
        time, whole = self._time(segment, t_local), jnp.asarray(which).astype(int)
        found = self.system.after_event(time, self._state(x), self.args, self.user_modes(mode), whole)
        return self._following(found, "after_event")

    @property
    def resets_at_corners(self) -> bool:
        return type(self.system).after_corner is not HybridSystem.after_corner

    def on_segment_start(self, segment: Stretch, x: State, mode: Scalar) -> tuple[State, Scalar]:
        at_start = mode < 1.0
        first = jnp.asarray(self.mode0, float) + _FIRST_MODE
        if not self.resets_at_corners:
            return x, jnp.where(at_start, first, mode)
        time, place = self._time(segment, 0.0), jnp.asarray(segment.number).astype(int) - 1
        which = jnp.argsort(self._corners())[place]
        after = self.system.after_corner(time, self._state(x), self.args, self.user_modes(mode), which)
        next_x, next_mode = self._following(after, "after_corner")
        x = tuple(jnp.where(at_start, a, b) for a, b in zip(x, next_x, strict=True))
        return x, jnp.where(at_start, first, next_mode)

    def state_scale(self) -> State:
        return self.error_scale(self.initial())

    def error_scale(self, x: State) -> State:
        return tuple(1.0 / (self.atol + self.rtol * jnp.abs(jnp.stack(x))))

    def _time(self, segment: Stretch, t_local: Term) -> Any:
        """The user's time, strictly inside the segment, so that a field that jumps at a corner is on the right side."""
        begin, end = segment.begin, segment.begin + segment.duration
        if isinstance(t_local, Series):
            return self.t0 + self.span * (begin + t_local)
        time = self.t0 + self.span * (begin + t_local)
        gap = _INSIDE * jnp.maximum(jnp.abs(self.t0), jnp.abs(self.t0 + self.span))
        first = jnp.where(begin > 0.0, self.t0 + self.span * begin + gap, -jnp.inf)
        inside = jnp.clip(time, first, self.t0 + self.span * end - gap)
        return time + lax.stop_gradient(inside - time)

    def _corners(self) -> Float[Array, " corners"]:
        """The times of the user's corners, in the user's order."""
        return jnp.ravel(jnp.asarray(self.system.corners(self.args), float))

    def _state(self, x: State) -> Tree:
        return self.layout.split(jnp.stack([jnp.asarray(part, float) for part in x]))

    def user_modes(self, modes: Float[Array, "*m"]) -> Int[Array, "*m"]:
        """The user's modes for those of the integrator."""
        return jnp.asarray(modes).astype(int) - _FIRST_MODE

    def _following(self, found: Any, method: str) -> tuple[State, Scalar]:
        where = f"{type(self.system).__name__}.{method}"
        if not (isinstance(found, tuple) and len(found) == 2):
            raise InputError(f"{where}: found {found!r:.80}, expected the pair (state, mode) that follows.")
        return tuple(self.layout.joined(found[0], where)), jnp.asarray(found[1], float) + _FIRST_MODE


def _real(guard: Any) -> Float[Array, "..."] | None:
    """The value of a guard as floating point; None where it is no real number (a truth value crosses no zero)."""
    try:
        array = jnp.asarray(guard)
    except (TypeError, ValueError):
        return None
    is_real = jnp.issubdtype(array.dtype, jnp.floating) or jnp.issubdtype(array.dtype, jnp.integer)
    return array.astype(float) if is_real else None
