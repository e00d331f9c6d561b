"""The motion that is left when the transient has died out: integrated as long as that is quick, then by Newton.

Periods of the input are integrated until the motion repeats, in every one or in every second or third.  How far a cycle
is from its limit follows from how it approaches it: where the distance from one cycle to the next shrinks by a factor
r, the distance still to come is r / (1 - r) times the last one.
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ..core import Count, Scalar, ScalarLike, Truth
from .accuracy import Accuracy
from .forward_pass import Packed, time_stepper
from .periodic_orbit import CONFIRMED, SHORT, Orbit, multipliers, newton_orbit, refined
from .restart import restarted
from .solution import SteppedRun, integrate_steps
from .system import AbstractHybridSystem, State, unflattener
from .tracing import choose_each, traced_once, zeros_of

PERIODS = 3
"""A motion may repeat after 1, 2 or 3 cycles."""

FIRST = 24
"""Cycles that are integrated before Newton's method is tried."""

MOST = 200
"""Cycles that are integrated at most, where Newton's method found no orbit from the first ones."""

_SHRINKS = 0.9
"""A motion repeats after 2 or 3 cycles only if its distance from a cycle earlier has hardly shrunk over so many."""

_FLOOR = 0.25
"""A distance below this part of the tolerance is not extrapolated: rounding and the error of steps do not shrink."""

_NEUTRAL = 1e-6
"""Distance from 1 within which a multiplier is 1 but for rounding: a deviation then never dies out."""

_FAR = 10.0
"""An orbit is rejected if its distance from the last cycle is this multiple of what the last cycles predict."""

GRAZES = 1e-2
"""`SteadyState.grazing` below this: a small change of the system takes an event away; derivatives may break there."""

Opening: TypeAlias = tuple[Float[Array, " components"], Float[Array, " components"]]
"""The state at the opening of a period, and its net shift until the motion repeats."""

Nearness: TypeAlias = Callable[[AbstractHybridSystem, SteppedRun], Scalar]
"""How near the events of a run of a system, given with its steps, are to grazing; 1: far from it."""


class Cycles(NamedTuple):
    """The last cycles of a motion, and whether it repeats."""

    x: State
    """The states at the phases of the last cycles, oldest first; every leaf of shape (PERIODS + 1, m)."""
    remaining: Float[Array, " periods"]
    """How far [m] the motion is from one that repeats after 1, 2, 3 cycles."""
    period: Count
    """After how many cycles it repeats; 0 where it does not."""
    cycles: Count
    """How many were integrated."""
    ratio: Scalar
    """Factor by which the distance between cycles has shrunk in the last one."""
    steps: Count
    failure: Count
    """Index into `accuracy.FAILURES`; 0 where the integration went well."""


class SteadyState(NamedTuple):
    """A motion that repeats, and how it was found."""

    x: Float[Array, " components"]
    """The state at the opening of a period, just before its corner."""
    gain: Float[Array, " components"]
    """Net shift of the components that nothing depends on, until the motion repeats; zero for all others."""
    period: Count
    """After how many periods of the input it repeats; 0 where it does not, and `x` is only the last state."""
    multipliers: Float[Array, " components"]
    """Moduli of its Floquet multipliers, largest first; NaN where the motion is that of integrated cycles."""
    grazing: Scalar
    """How near an event of the orbit that Newton's method found is to grazing, 0 to 1; NaN where none attracts."""
    distance: Scalar
    """How far [m] the state is from that after it repeated."""
    cycles: Count
    """How many were integrated from the start on."""
    looks: Count
    """How often Newton's method integrated and linearised a cycle; two confirm what the integration found."""
    failure: Count
    """Index into `accuracy.FAILURES`; 0 where the integration went well."""


class _Trial(NamedTuple):
    """An orbit that Newton's method found, and whether it is accepted as the motion."""

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
    nearness: Nearness = lambda system, run: jnp.ones(()),
) -> SteadyState:
    """The motion of `system` after the transient, by the state at the opening of a period of `duration` [s].

    A periodic orbit is accepted if the motion repeats to within `tolerance` [m] twice in a row and all its multipliers
    lie inside the unit circle.  Repetition in every period is tried first, then in every second and third, from the end
    of `FIRST` cycles; where none is found, from the end of `MOST`.  Near an orbit whose `nearness` says that it grazes
    a linearised cycle means little.  There, and where no orbit attracts, the motion is the last of `MOST` cycles, or of
    those until it repeats: it may repeat even so, where a remainder of the start neither grows nor shrinks.

    `x` and `gain` are differentiable in every floating-point leaf of `system` and in `duration`; their derivatives
    are NaN where the motion is that of integrated cycles.
    """
    fixed, length = lax.stop_gradient(system), jnp.asarray(lax.stop_gradient(duration), float)
    phases = length[None] * (1.0 - SHORT)

    @traced_once
    def attempt(attempts: Count) -> tuple[Count, tuple[Cycles, _Trial]]:
        cycles = integrate_cycles(fixed, length, phases, accuracy, tolerance, jnp.where(attempts > 0, MOST, FIRST))
        trial = _first_accepted(fixed, cycles, length, accuracy, tolerance)
        on_orbit = restarted(fixed, trial.orbit.x)
        run = integrate_steps(on_orbit, trial.count * phases[0], accuracy)
        grazing = jnp.where(trial.accepted, nearness(on_orbit, run), jnp.nan)
        return attempts + 1, (cycles, trial._replace(grazing=grazing))

    goes_on = lambda now: (now[0] < 2) & ~(now[1][1].grazing >= GRAZES)
    # A loop that begins with zeros has its body once, and compiles faster.
    blank = zeros_of(attempt, jnp.zeros((), int))
    _, (cycles, trial) = lax.while_loop(goes_on, lambda now: attempt(now[0]), blank)
    ok = trial.grazing >= GRAZES
    orbit = refined(system, trial.orbit, duration, accuracy, trial.count)
    x, gain = _chosen(ok, orbit, (_openings(cycles)[-1], _net_shift(system, cycles)))
    return SteadyState(
        x=x,
        gain=gain,
        period=jnp.where(ok, trial.count, cycles.period),
        multipliers=jnp.where(ok, trial.moduli, jnp.nan),
        grazing=trial.grazing,
        distance=jnp.where(ok, trial.orbit.distance, cycles.remaining[0]),
        cycles=cycles.cycles,
        looks=trial.orbit.looks,
        failure=jnp.where(ok, 0, cycles.failure),
    )


@jax.custom_jvp
def _chosen(ok: Truth, orbit: Opening, integrated: Opening) -> Opening:
    """The opening on the `orbit`, or that of the `integrated` cycles, whose derivatives are NaN."""
    return choose_each(ok, orbit, integrated)


@_chosen.defjvp
def _(primals: tuple[Truth, Opening, Opening], tangents: tuple[Truth, Opening, Opening]) -> tuple[Opening, Opening]:
    known = jnp.where(primals[0], 1.0, jnp.nan)
    return _chosen(*primals), jax.tree.map(lambda tangent: known * tangent, tangents[1])


def _net_shift(system: AbstractHybridSystem, cycles: Cycles) -> Float[Array, " components"]:
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
) -> _Trial:
    """The orbit near the end of some cycles that repeats after the fewest periods, and whether it is accepted."""
    openings, unflatten = _openings(cycles), unflattener(system)
    distance = lambda a, b: system.state_distance(unflatten(list(a)), unflatten(list(b)))

    @traced_once
    def attempt(tried: Count) -> _Trial:
        orbit = newton_orbit(system, openings[-1], duration, accuracy, tolerance, tried + 1)
        moduli = multipliers(system, orbit)
        attracts = moduli[0] < 1.0 - _NEUTRAL
        # Newton's method may jump to another orbit than the one that the cycles approach.
        to_come = distance(openings[-1], openings[-2 - tried]) / jnp.where(attracts, 1.0 - moduli[0], 1.0)
        reached = distance(orbit.x, openings[-1]) <= _FAR * to_come + tolerance
        accepted = (orbit.confirmed >= CONFIRMED) & (orbit.failure == 0) & attracts & reached
        return _Trial(orbit, moduli, tried + 1, accepted, jnp.zeros(()))

    goes_on = lambda trial: ~trial.accepted & (trial.count < PERIODS)
    return lax.while_loop(goes_on, lambda trial: attempt(trial.count), zeros_of(attempt, jnp.zeros((), int)))


class _Carry(NamedTuple):
    packed: Packed
    states: Float[Array, "cycles phases components"]
    """Those at the phases of the last cycles, oldest first."""
    distances: Float[Array, "memory periods"]
    """Those of the last cycles, oldest first, from the ones 1, 2, 3 cycles earlier."""
    cycles: Count


def integrate_cycles(
    system: AbstractHybridSystem,
    duration: ScalarLike,
    phases: Float[Array, " m"],
    accuracy: Accuracy,
    tolerance: ScalarLike,
    most: int | Count,
) -> Cycles:
    """Integrate `system` from its initial state until a cycle repeats to within `tolerance` [m], `most` at most.

    **Arguments:** a cycle takes `duration` [s]; cycles are compared at the `phases` [s] within one, ascending, shape
    (m,).  The accuracy has room for the steps of one cycle.
    """
    start, advance, unpack = time_stepper(system, accuracy)
    unflatten, count = unflattener(system), len(unpack(start).x)
    distance = lambda a, b: system.state_distance(unflatten(list(a)), unflatten(list(b)))

    def cycle(carry: _Carry) -> _Carry:
        room = (carry.cycles + 1) * accuracy.max_steps

        def to_phase(packed: Packed, time: Scalar) -> tuple[Packed, Float[Array, " components"]]:
            packed = advance(packed, time, room)
            return packed, jnp.stack(unpack(packed).x)

        packed, now = lax.scan(to_phase, carry.packed, carry.cycles * duration + phases)
        states = jnp.concatenate([carry.states[1:], now[None]])
        distances = jnp.stack([jax.vmap(distance)(now, states[-1 - n]).max() for n in range(1, PERIODS + 1)])
        # The first cycles have none before them.
        distances = jnp.where(carry.cycles >= jnp.arange(1, PERIODS + 1), distances, jnp.inf)
        return _Carry(packed, states, jnp.concatenate([carry.distances[1:], distances[None]]), carry.cycles + 1)

    def goes_on(carry: _Carry) -> Scalar:
        loop = unpack(carry.packed)
        failed = (carry.cycles > 0) & ((loop.failure > 0) | (loop.done == 0))
        return (carry.cycles < most) & ~failed & (_remaining(carry.distances, tolerance).min() >= tolerance)

    empty = jnp.zeros((PERIODS + 1, len(phases), count))
    begin = _Carry(start, empty, jnp.full((PERIODS + 1, PERIODS), jnp.inf), jnp.zeros((), int))
    last = lax.while_loop(goes_on, cycle, begin)
    loop, remaining = unpack(last.packed), _remaining(last.distances, tolerance)
    repeats = remaining < tolerance
    period = jnp.where(repeats.any(), jnp.argmax(repeats) + 1, 0)
    failure = jnp.where((loop.done == 0) & (loop.failure == 0), 1.0, loop.failure).astype(int)
    x = jax.vmap(jax.vmap(lambda row: unflatten(list(row))))(last.states)
    ratio = last.distances[-1, 0] / last.distances[-2, 0]
    return Cycles(x, remaining, period, last.cycles, ratio, loop.count.astype(int), failure)


def _remaining(distances: Float[Array, "memory periods"], tolerance: ScalarLike) -> Float[Array, " periods"]:
    """How far [m] the cycle before the last is from one that repeats after 1, 2, 3 cycles, by the last distances.

    It is that of the cycle before, since net steps are differences of the last two.
    """
    before, last, now = distances[-3:]
    # The slower of the two: where multipliers are complex the distance shrinks by fits and starts.
    ratio = jnp.maximum(now / last, last / before)
    ratio = jnp.where(jnp.isfinite(ratio), ratio, 1.0)
    limit = jnp.where(ratio < 1.0, now / jnp.where(ratio < 1.0, 1.0 - ratio, 1.0), jnp.inf)
    limit = jnp.where(now < _FLOOR * tolerance, now, limit)
    # A motion that approaches one that repeats in every cycle nearly repeats in every second and third, too.
    ago = distances[::-1, 0][jnp.arange(1, PERIODS + 1)]
    shrinking = (jnp.arange(PERIODS) > 0) & ~(now[0] > _SHRINKS * ago)
    return jnp.where(shrinking, jnp.inf, limit)
