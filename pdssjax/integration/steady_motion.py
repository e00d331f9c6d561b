"""The motion that is left when the transient has died out: integrated as long as that is quick, then by Newton."""

from collections.abc import Callable
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, Scalar, ScalarLike, Truth
from .accuracy import Accuracy
from .periodic_orbit import CONFIRMED, SHORT, Orbit, multipliers, newton_orbit, refined
from .restart import restarted
from .solution import SteppedRun, integrate_steps
from .steady_cycle import PERIODS, Cycles, integrate_cycles
from .system import AbstractHybridSystem, unflattener

FIRST = 24
"""Cycles that are integrated before Newton's method is asked."""

MOST = 200
"""Cycles that are integrated at most, where it found nothing from there."""

_NEUTRAL = 1e-6
"""Distance from 1 within which a multiplier is 1 but for rounding: what began never dies out."""

_FAR = 10.0
"""An orbit so many times farther from the last cycle than the distances between cycles predict is rejected."""

Carry = TypeVar("Carry")
"""A pytree of arrays."""

Ends = tuple[Float[Array, " components"], Float[Array, " components"]]
"""The state at the opening of a period, and what the motion gains until it repeats."""

GRAZES = 1e-2
"""`SteadyState.grazing` below this: a small change of the system takes an event away; derivatives may break there."""

Nearness = Callable[[AbstractHybridSystem, SteppedRun], Scalar]
"""How near the events of a motion, given by what was integrated and its steps, are to grazing; 1: far from it."""


class SteadyState(NamedTuple):
    """A motion that repeats, and how it was found."""

    x: Float[Array, " components"]
    """The state at the opening of a period, just before its corner."""
    gain: Float[Array, " components"]
    """Net shift of the components that nothing depends on, until the motion repeats; zero for all others."""
    period: Count
    """After how many periods of the input it repeats; 0 where it does not, and `x` is only the last state seen."""
    multipliers: Float[Array, " components"]
    """Moduli of its Floquet multipliers, largest first; NaN where the motion is that of integrated cycles."""
    grazing: Scalar
    """How near an event of the orbit that Newton's method found is to grazing, 0 to 1; NaN where none attracts."""
    distance: Scalar
    """How far [m] the state is from that after it repeated."""
    cycles: Count
    """Integrated from the start on."""
    looks: Count
    """How often Newton's method integrated and linearised a cycle; two confirm what the integration found."""
    failure: Count
    """Index into `accuracy.FAILURES`; 0 where the integration went well."""


class _Tried(NamedTuple):
    orbit: Orbit
    moduli: Float[Array, " components"]
    count: Count  # pyright: ignore[reportIncompatibleMethodOverride]
    accepted: Truth
    grazing: Scalar


def steady_state(
    system: AbstractHybridSystem,
    duration: ScalarLike,
    accuracy: Accuracy,
    tolerance: ScalarLike,
    nearness: Nearness = lambda moving, run: jnp.ones(()),
) -> SteadyState:
    """The motion of `system` after the transient, by the state at the opening of a period of `duration` [s].

    A periodic orbit counts where it is met to within `tolerance` [m], all its multipliers lie inside the unit circle,
    and two cycles in a row agree with it.  Repetition in every period is tried first, then in every second
    and third, from where `FIRST` cycles lead; where none is found, from where `MOST` do.  A linearised cycle says
    little of an orbit that by its `nearness` grazes.  There, and where no orbit attracts, the motion is the last of
    `MOST` cycles, or of those until it repeats: it may repeat all the same, where what is left of the start neither
    grows nor shrinks.

    `x` and `gain` are differentiable in every floating-point leaf of `system` and in `duration`; their derivatives
    are NaN where the motion is that of integrated cycles.
    """
    still, long = lax.stop_gradient(system), jnp.asarray(lax.stop_gradient(duration), float)
    phases = long[None] * (1.0 - SHORT)

    def attempt(before: tuple[Count, tuple[Cycles, _Tried]]) -> tuple[Count, tuple[Cycles, _Tried]]:
        attempts, _ = before
        cycles = integrate_cycles(still, long, phases, accuracy, tolerance, jnp.where(attempts > 0, MOST, FIRST))
        tried = _first_accepted(still, cycles, long, accuracy, tolerance)
        moving = restarted(still, tried.orbit.x)
        run = integrate_steps(moving, tried.count * phases[0], accuracy)
        return attempts + 1, (cycles, tried._replace(grazing=jnp.where(tried.accepted, nearness(moving, run), jnp.nan)))

    goes_on = lambda now: (now[0] < 2) & ~(now[1][1].grazing >= GRAZES)
    _, (cycles, tried) = lax.while_loop(goes_on, attempt, _blank(lambda: attempt((jnp.zeros((), int), None))))  # pyright: ignore[reportArgumentType]
    ok = tried.grazing >= GRAZES
    orbit = refined(system, tried.orbit, duration, accuracy, tried.count)
    x, gain = _chosen(ok, orbit, (_openings(cycles)[-1], _gained(system, cycles)))
    return SteadyState(
        x=x,
        gain=gain,
        period=jnp.where(ok, tried.count, cycles.period),
        multipliers=jnp.where(ok, tried.moduli, jnp.nan),
        grazing=tried.grazing,
        distance=jnp.where(ok, tried.orbit.distance, cycles.remaining[0]),
        cycles=cycles.cycles,
        looks=tried.orbit.looks,
        failure=jnp.where(ok, 0, cycles.failure),
    )


@jax.custom_jvp
def _chosen(ok: Truth, orbit: Ends, integrated: Ends) -> Ends:
    """The result of the `orbit`, or that of the `integrated` cycles, whose derivatives are NaN."""
    return jax.tree.map(lambda a, b: jnp.where(ok, a, b), orbit, integrated)


@_chosen.defjvp
def _(primals: tuple[Truth, Ends, Ends], tangents: tuple[Truth, Ends, Ends]) -> tuple[Ends, Ends]:
    known = jnp.where(primals[0], 1.0, jnp.nan)
    return _chosen(*primals), jax.tree.map(lambda moved: known * moved, tangents[1])


def _gained(system: AbstractHybridSystem, cycles: Cycles) -> Float[Array, " components"]:
    """Net shift over the last cycles, as many as the motion takes to repeat; zero in components that do not shift."""
    ends = _openings(cycles)
    shifts = jnp.array([i in system.shifting_components() for i in range(ends.shape[1])])
    return jnp.where(shifts, ends[-1] - ends[-1 - cycles.period], 0.0)


def _openings(cycles: Cycles) -> Float[Array, "cycles components"]:
    """The states at the last phase of some cycles, oldest first."""
    return jnp.stack([leaf[:, -1] for leaf in jax.tree.leaves(cycles.x)], axis=1)


def _first_accepted(
    system: AbstractHybridSystem,
    cycles: Cycles,
    duration: ScalarLike,
    accuracy: Accuracy,
    tolerance: ScalarLike,
) -> _Tried:
    """The orbit near the end of some cycles that repeats after the fewest periods, and whether it is accepted."""
    none, unflatten = jnp.zeros((), int), unflattener(system)
    seen = _openings(cycles)
    apart = lambda a, b: system.state_distance(unflatten(list(a)), unflatten(list(b)))

    def attempt(before: _Tried) -> _Tried:
        orbit = newton_orbit(system, seen[-1], duration, accuracy, tolerance, before.count + 1)
        moduli = multipliers(system, orbit)
        attracts = moduli[0] < 1.0 - _NEUTRAL
        # Newton's method may jump to another orbit than the one that the cycles approach.
        to_come = apart(seen[-1], seen[-2 - before.count]) / jnp.where(attracts, 1.0 - moduli[0], 1.0)
        reached = apart(orbit.x, seen[-1]) <= _FAR * to_come + tolerance
        accepted = (orbit.confirmed >= CONFIRMED) & (orbit.failure == 0) & attracts & reached
        return _Tried(orbit, moduli, before.count + 1, accepted, jnp.zeros(()))

    nothing = _blank(lambda: attempt(_Tried(None, None, none, None, None)))  # pyright: ignore[reportArgumentType]
    goes_on = lambda tried: ~tried.accepted & (tried.count < PERIODS)
    return lax.while_loop(goes_on, attempt, nothing)


def _blank(made: Callable[[], Carry]) -> Carry:
    """Zeros of the shapes of what is `made`: a loop that begins with them has its body once, and compiles faster."""
    return jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), jax.eval_shape(made))
