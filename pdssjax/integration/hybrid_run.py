"""Solve a hybrid system between two times: states, events and why it stopped, with right derivatives."""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from ..core import Count, InputError, Scalar, ScalarLike, Tree, check_whole, require_float64
from .accuracy import Accuracy
from .flattened_system import FlattenedSystem, Layout
from .hybrid_system import HybridSystem, Mode
from .polynomials import horner
from .restart import Restarted, flat as components
from .solution import SteppedRun, integrate_steps, states_at
from .step_methods.base import AbstractStepMethod
from .step_methods.picard import Picard
from .step_methods.taylor import Taylor
from .system import AbstractHybridSystem, unflattener

RESULTS = (
    "",
    "it ran out of steps: events that accumulate (a ball that comes to rest), a stiff field or too fine a tolerance; "
    "end the motion in a mode of its own, allow more `max_steps`, or take an implicit solver",
    "the state did not stay finite",
    "a guard was negative inside a mode: no event can be located there; see that `after_event` leaves every guard at "
    "zero or above, and that the first state lies inside its mode",
    "`t1` is not after `t0`",
)
"""Sentences that explain `Solution.result`, by its number."""

_USUAL = Picard()

_NEGATIVE = 1e-6
"""Part of a guard's largest value at the steps; a guard below minus that is negative by more than rounding."""


class Events(NamedTuple):
    """The events of a run, in order; behind the last of them NaN, and -1 for whole numbers."""

    ts: Float[Array, " events"]
    """Times, in the unit of the time."""
    which: Int[Array, " events"]
    """Numbers of the guards that fell through zero."""
    before: Tree
    """States just before the events, in the units of the state; every leaf has their axis first."""
    after: Tree
    """States just after them."""
    count: Count  # pyright: ignore[reportIncompatibleMethodOverride]
    """How many there were; where that is more than `max_events` the later ones are not listed."""


class Solution(NamedTuple):
    """The result of `integrate`; times and states in the units they were given in."""

    ts: Float[Array, " times"]
    """The times asked for."""
    ys: Tree
    """The states there, after an event that falls on such a time; every leaf has the axis of the times first.

    NaN at times that were not reached or lie outside the run.
    """
    modes: Int[Array, " times"]
    """The modes there."""
    events: Events
    stats: dict[str, Count]
    """`steps`, `rejected` steps and `events`."""
    stopped: Scalar
    """The time to which the states are known: `t1`, or where the run broke off."""
    result: Count
    """0 where the run reached `t1`, else an index into `RESULTS`."""

    @property
    def message(self) -> str:
        """The sentence for a concrete `result`; empty where the run reached `t1`.  Of many runs, the first such one."""
        broken = np.flatnonzero(np.ravel(self.result))
        return RESULTS[int(np.ravel(self.result)[broken[0]])] if broken.size else ""


def integrate(
    system: HybridSystem | AbstractHybridSystem,
    t0: ScalarLike,
    t1: ScalarLike,
    y0: Tree = None,
    args: Tree = None,
    *,
    saveat: Float[ArrayLike, " times"] | None = None,
    mode: Mode = 0,
    rtol: Tree = 1e-11,
    atol: Tree = 1e-13,
    max_steps: int = 1024,
    max_events: int = 64,
    method: AbstractStepMethod = _USUAL,
    throw: bool = True,
) -> Solution:
    """Solve a hybrid system from `t0` to `t1`, in whatever units it is written; `HybridSystem` shows an example.

    Works under `jit`, `vmap` (lane by lane), `jacfwd`, `jacrev` and both nested, up to second derivatives: by `y0`,
    `args`, `t0`, `saveat` and the floating-point leaves of `system`, through every event.

    **Arguments:**

    - `system`: what moves; or an `AbstractHybridSystem`, the integrator's own interface, of which the package's own
      systems are (`pdssjax.simulation.StickSlip(actuator, drive)`): it knows its start (`y0` may be left out), its
      arguments, modes and scale, `t0` is 0 s, and a step may be wrong by `atol`, a displacement [m]
    - `t0`, `t1`: begin and end, `t1` after `t0`
    - `y0`: state at `t0`, a pytree of floating-point arrays of any shape
    - `args`: handed to the methods of `system`, a pytree
    - `saveat`: times at which the states are wanted, shape (times,), none outside the run; `t1` alone by default
    - `mode`: at `t0`, a whole number from 0 on
    - `rtol`, `atol`: one step may be wrong by `atol + rtol |y|`, `atol` in the units of the state; one number for all
      components, or a pytree like `y0`
    - `max_steps`: room for so many steps; memory grows with it
    - `max_events`: how many events are listed
    - `method`: collocation, `Picard()`, by default; `OneStep(diffrax.Kvaerno5())` for stiff fields; `Taylor()` for
      states of scalars whose field is made of + - * / and the functions of `pdssjax.integration`
    - `throw`: raise where the run does not reach `t1`; if not, `result` says why, and what was not reached is NaN,
      with derivatives of 0

    **Raises** `InputError` for what cannot be integrated, and `RuntimeError` as `throw` says.
    """
    require_float64("integrate")
    check_whole("integrate: `max_steps`", max_steps, 1)
    check_whole("integrate: `max_events`", max_events, 1)
    if not isinstance(method, AbstractStepMethod):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(
            f"integrate: found `method` {method!r:.80}, expected Picard(), Taylor(), or a solver of diffrax in "
            "OneStep(...), all of pdssjax.integration."
        )
    begin, end = jnp.asarray(t0, float), jnp.asarray(t1, float)
    ts = end[None] if saveat is None else jnp.asarray(saveat, float)
    if isinstance(system, AbstractHybridSystem):
        y0 = system.initial() if y0 is None else y0
        _check_own(system, y0, t0, args, mode, atol)
        _check_times(begin, end, ts)
        fine = jnp.asarray(atol, float)
        accuracy = Accuracy(fine, 3.0 * fine, method, max_steps)
        solution = _solved_own(Restarted(system, components(y0), 0.0), ts, accuracy, max_events, throw, t1=end)
    else:
        flat = _flattened(system, begin, end, y0, args, mode, (rtol, atol), isinstance(method, Taylor))
        _check_times(begin, end, ts)
        solution = _solved(flat, ts, Accuracy(1.0, 1.0, method, max_steps), max_events, throw)
    return _thrown(solution) if throw else solution


def _check_own(system: AbstractHybridSystem, y0: Tree, t0: ScalarLike, args: Tree, mode: Mode, atol: Tree) -> None:
    """**Raises** `InputError` for what an `AbstractHybridSystem` knows itself, and for a state that is not like its."""
    found, expected = jax.tree.structure(y0), jax.tree.structure(system.initial())
    if found != expected:
        raise InputError(f"integrate: found `y0` of the structure {found}, expected that of the system, {expected}.")
    if isinstance(t0, jax.core.Tracer) or np.any(np.not_equal(t0, 0.0)):  # pyright: ignore[reportAttributeAccessIssue]
        raise InputError(
            f"integrate: found `t0` = {t0}, expected 0 for an AbstractHybridSystem: its input begins there."
        )
    known = {"args": args is not None, "mode": not (isinstance(mode, int) and mode == 0), "atol": np.ndim(atol) > 0}
    if wrong := [name for name, is_wrong in known.items() if is_wrong]:
        raise InputError(
            f"integrate: found `{wrong[0]}` for an AbstractHybridSystem, expected none: it knows its arguments and "
            "modes, and `atol` is one number, a displacement [m]."
        )


@eqx.filter_jit
def _solved_own(
    system: AbstractHybridSystem,
    ts: Float[Array, " times"],
    accuracy: Accuracy,
    max_events: int,
    throw: bool,
    *,
    t1: Scalar,
) -> Solution:
    """The solution of a system that has the integrator's own interface, from 0 s on."""
    run = _finite(integrate_steps(system, t1, accuracy))
    states = states_at(system, run, ts)
    reached = ts <= jnp.where(run.failure > 0, run.end.time, t1)
    ys = jax.tree.map(lambda leaf: _nan_if_unknown(leaf, reached, throw), states.x)
    modes = jnp.where(reached, states.mode.astype(int), -1)
    split = jax.vmap(unflattener(system))
    events = _events(run, 0.0, 1.0, split, max_events, jnp.inf, throw & (run.failure > 0))
    stopped = jnp.where(run.failure > 0, run.end.time, t1)
    return Solution(ts, ys, modes, events, _stats(run), stopped, run.failure)


def _flattened(
    system: HybridSystem,
    t0: Scalar,
    t1: Scalar,
    y0: Tree,
    args: Tree,
    mode: Mode,
    tolerances: tuple[Tree, Tree],
    expands: bool,
) -> FlattenedSystem:
    """The system with its start, as the integrator wants it; **raises** `InputError` for what it cannot be."""
    if not isinstance(system, HybridSystem):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(f"integrate: found a system {system!r:.60}, expected a pdssjax.integration.HybridSystem.")
    is_known = not isinstance(mode, jax.core.Tracer)  # pyright: ignore[reportAttributeAccessIssue]
    if jnp.shape(mode) or jnp.result_type(mode).kind not in "iu" or (is_known and int(mode) < 0):
        raise InputError(f"integrate: found `mode` = {mode!r:.60}, expected a whole number from 0 on.")
    y0 = jax.tree.map(_floating, y0)
    shapes = tuple(leaf.shape for leaf in jax.tree.leaves(y0))
    layout = Layout(jax.tree.structure(y0), shapes)
    if not shapes:
        raise InputError("integrate: found a state `y0` without a number, expected a pytree of arrays.")
    if expands and any(shapes):
        raise InputError(
            f"integrate: found leaves of `y0` of shape {', '.join(map(str, shapes))}, expected scalars alone for "
            "`method=Taylor()`; leave `method` out for arrays."
        )
    return FlattenedSystem(
        _of_arrays(system),
        layout.joined(y0, "integrate: y0"),
        jnp.asarray(mode, int),
        _of_arrays(args),
        t0,
        # What a unit of the clock is moves no state: its derivative would be rounding.
        lax.stop_gradient(t1 - t0),
        _spread(tolerances[0], y0, "rtol"),
        _spread(tolerances[1], y0, "atol"),
        layout,
        expands,
    )


@eqx.filter_jit
def _solved(
    flat: FlattenedSystem, ts: Float[Array, " times"], accuracy: Accuracy, max_events: int, throw: bool
) -> Solution:
    run = _finite(integrate_steps(flat, 1.0, accuracy))
    parts = (ts - flat.t0) / flat.span
    states = states_at(flat, run, parts)
    sound = _sound_until(flat, run)
    stopped = jnp.where(run.failure > 0, run.end.time, 1.0)
    reached = (parts >= -1e-12) & (parts <= stopped + 1e-12) & (parts < sound) & (flat.span > 0.0)
    ys = flat.layout.split(_nan_if_unknown(jnp.stack(states.x, axis=-1), reached[:, None], throw))
    modes = jnp.where(reached, flat.user_modes(states.mode), -1)
    result = jnp.where((run.failure != 2) & jnp.isfinite(sound), 3, run.failure)
    result = jnp.where(flat.span > 0.0, result, 4)
    events = _events(run, flat.t0, flat.span, flat.layout.split, max_events, sound, throw & (result > 0))
    return Solution(ts, ys, modes, events, _stats(run), flat.t0 + flat.span * jnp.minimum(stopped, sound), result)


def _nan_if_unknown(values: Float[Array, "..."], known: Bool[Array, "..."], fails: bool | Bool[Array, ""]) -> Array:
    """The `values` where they are known, NaN elsewhere; where the run `fails`, derivatives there are NaN, too.

    A mask alone would make them 0, which passes for right: `jit` drops the error together with unused values.
    """
    return jnp.where(known | fails, values * jnp.where(known | ~jnp.asarray(fails), 1.0, jnp.nan), jnp.nan)


def _finite(run: SteppedRun) -> SteppedRun:
    """The run with a finite end: otherwise NaN would spread to the states that were reached."""
    return run._replace(end=run.end._replace(x=jnp.where(jnp.isfinite(run.end.x), run.end.x, 0.0)))


def _stats(run: SteppedRun) -> dict[str, Count]:
    return {"steps": run.count, "rejected": run.rejected, "events": run.events}


def _events(
    run: SteppedRun,
    t0: ScalarLike,
    span: ScalarLike,
    split: Callable[[Float[Array, "events components"]], Tree],
    most: int,
    sound: ScalarLike,
    fails: Bool[Array, ""],
) -> Events:
    """The first events of a run, at most so many, to the time `sound`; its clock began at `t0`, its unit is `span`."""
    steps, end = run.steps, run.end
    ended = _real(run) & steps.event
    rows = jnp.nonzero(ended, size=most, fill_value=0)[0]
    listed = jnp.arange(most) < ended.sum()
    last = rows + 1 >= run.count
    following = jnp.minimum(rows + 1, len(ended) - 1)
    begins = steps.origin + steps.t_local
    times = jnp.where(last, end.time, begins[following])
    listed &= times <= sound
    after = jnp.where(last[:, None], end.x, steps.x[following])
    before = _along(steps.polynomials[rows], times - begins[rows])
    listed_states = lambda x: split(_nan_if_unknown(x, listed[:, None], fails))
    ts = _nan_if_unknown(t0 + span * times, listed, fails)
    return Events(ts, jnp.where(listed, steps.which[rows], -1), listed_states(before), listed_states(after), run.events)


def _real(run: SteppedRun) -> Bool[Array, " room"]:
    """Which rows of the table hold a step."""
    return jnp.arange(len(run.steps.mode)) < run.count


def _along(
    polynomials: Float[Array, "rows components coefficients"], elapsed: Float[Array, " rows"]
) -> Float[Array, "rows components"]:
    """States so long after the begins of their steps."""
    return horner(list(jnp.moveaxis(polynomials, -1, 0)), elapsed[:, None])


def _sound_until(flat: FlattenedSystem, run: SteppedRun) -> Scalar:
    """The start of the first step with a guard negative at its start or middle by more than rounding; else infinite."""
    steps = lax.stop_gradient(run.steps)

    def values(elapsed: Float[Array, " room"]) -> Float[Array, "room guards"]:
        times = flat.t0 + flat.span * (steps.origin + steps.t_local + elapsed)
        states = flat.layout.split(_along(steps.polynomials, elapsed))
        found = jax.vmap(flat.guard_values)(times, states, flat.user_modes(steps.mode))
        return jnp.where(_real(run)[:, None], found, 0.0)

    guards = jnp.stack([values(0.0 * steps.duration), values(0.5 * steps.duration)])
    negative = (guards < -_NEGATIVE * jnp.max(jnp.abs(guards), axis=(0, 1))).any(axis=(0, 2))
    return jnp.min(jnp.where(negative, steps.origin + steps.t_local, jnp.inf))


def _thrown(solution: Solution) -> Solution:
    """The solution, or an error where it is none: at once, or when a traced one is computed."""
    if not isinstance(solution.result, jax.core.Tracer):  # pyright: ignore[reportAttributeAccessIssue]
        if int(solution.result):
            count, at = int(solution.stats["events"]), float(solution.stopped)
            raise RuntimeError(_sentence(f"at the time {at:g}, after {count} events, {solution.message}"))
        return solution
    ys = solution.ys
    for code, message in list(enumerate(RESULTS))[1:]:
        ys = eqx.error_if(ys, solution.result == code, _sentence(message))
    return solution._replace(ys=ys)


def _sentence(message: str) -> str:
    return f"integrate: {message} (`throw=False` gives what was reached)."


def _floating(leaf: Any) -> Float[Array, "..."]:
    found = jnp.asarray(leaf)
    if not jnp.issubdtype(found.dtype, jnp.floating) and not jnp.issubdtype(found.dtype, jnp.integer):
        raise InputError(f"integrate: found a leaf of `y0` of type {found.dtype}, expected real numbers.")
    return found.astype(float)


def _of_arrays(tree: Tree) -> Tree:
    """The tree with arrays of JAX for Python's floats and NumPy's arrays: other values then need no compilation."""
    is_number = lambda leaf: isinstance(leaf, float | np.ndarray | np.generic)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf) if is_number(leaf) else leaf, tree)


def _spread(tolerance: Tree, y0: Tree, what: str) -> Float[Array, " components"]:
    """A tolerance for every component; **raises** `InputError` where it is not like the state."""
    whole = jax.tree.structure(tolerance)
    each = jax.tree.map(lambda _: tolerance, y0) if jax.tree_util.treedef_is_leaf(whole) else tolerance
    try:
        full: Callable[..., Any] = lambda leaf, number: jnp.broadcast_to(jnp.asarray(number, float), leaf.shape).ravel()
        parts = jax.tree.leaves(jax.tree.map(full, y0, each))
    except (TypeError, ValueError) as error:
        raise InputError(
            f"integrate: found `{what}` {tolerance!r:.60}, expected one number or a pytree like `y0`."
        ) from error
    spread = lax.stop_gradient(jnp.concatenate(parts))
    if not isinstance(spread, jax.core.Tracer) and not (np.asarray(spread) > 0.0).all():  # pyright: ignore[reportAttributeAccessIssue]
        raise InputError(f"integrate: found `{what}` {tolerance!r:.60}, expected positive numbers.")
    return spread


def _check_times(t0: Array, t1: Array, ts: Array) -> None:
    """**Raises** `InputError` for times that are known and wrong."""
    if t0.ndim or t1.ndim or ts.ndim != 1:
        raise InputError(
            f"integrate: found `t0`, `t1`, `saveat` of shape {t0.shape}, {t1.shape}, {ts.shape}, expected two numbers "
            "and an array with one axis."
        )
    if any(isinstance(time, jax.core.Tracer) for time in (t0, t1, ts)):  # pyright: ignore[reportAttributeAccessIssue]
        return
    if not (np.isfinite(t0) and np.isfinite(t1) and t1 > t0):
        raise InputError(f"integrate: found `t1` = {t1:g}, expected a finite time after `t0` = {t0:g}.")
    outside = np.asarray((ts < t0) | (ts > t1) | ~np.isfinite(ts))
    if outside.any():
        raise InputError(
            f"integrate: found {np.asarray(ts)[outside][0]:g} in `saveat`, expected times from {t0:g} to {t1:g}."
        )
