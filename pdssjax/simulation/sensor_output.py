"""The output of a sensor on a hybrid system, and the motions inside it, from one integration.

A measurement names one of these, or makes its own; `sensor_samples` integrates the system and shows it at sample times.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float, Int

from ..core import Count, Scalar, ScalarLike, Tree, Truth
from ..drive.base import AbstractDrive, Segment
from ..integration import (
    FAILURES,
    AbstractHybridSystem,
    Accuracy,
    SampledStates,
    Table,
    TakenSteps,
    empty_table,
    exact_states_at,
    find_steps,
    integrate_steps,
    is_closed,
    sample_run,
    states_at,
)
from .systems.platform_only import PlatformOnly
from .systems.prescribed_motion import PrescribedMotion

System: TypeAlias = Any
"""The system of a record: one that has what is asked of it, such as `shown_displacement`."""

State: TypeAlias = Any
"""State of that system."""


def _delay_of_sensor(system: System) -> ScalarLike:
    # A system need not have a sensor.
    return system.sensor.delay if hasattr(system, "sensor") else 0.0


def _at_once(system: System) -> ScalarLike:
    return 0.0


class Output(NamedTuple):
    """The quantity of a system that a sensor shows; static, since records that share it share one compiled function."""

    shown: Callable[[System, Segment, Scalar, State, Scalar], Scalar]
    """(system, segment, t_local, x, mode) to what is shown [SI], shape ()."""
    components: Callable[[System], tuple[int, ...] | None]
    """A function from a system to the state components that are shown, counted as leaves; None for all."""
    delay: Callable[[System], ScalarLike] = _delay_of_sensor
    """A function from a system to the delay of the sensor [s]; 0 where it has none."""


def _displacement(system: System, segment: Segment, t_local: Scalar, x: State, mode: Scalar) -> Scalar:
    return system.shown_displacement(x)


def _velocity(system: System, segment: Segment, t_local: Scalar, x: State, mode: Scalar) -> Scalar:
    return system.shown_velocity(x)


def _acceleration(system: System, segment: Segment, t_local: Scalar, x: State, mode: Scalar) -> Scalar:
    return jax.jvp(system.shown_velocity, (x,), (system.rates(segment, t_local, x, mode),))[1]


def _stop_force(system: System, segment: Segment, t_local: Scalar, x: State, mode: Scalar) -> Scalar:
    return system.shown_force(x)


def _friction_force(system: System, segment: Segment, t_local: Scalar, x: State, mode: Scalar) -> Scalar:
    return system.force(segment, t_local, x, mode)


# Named, so that another process finds them: a problem can be pickled.
def _of_displacement(system: System) -> tuple[int, ...] | None:
    return system.output_components()


def _of_velocity(system: System) -> tuple[int, ...] | None:
    return system.velocity_components()


def _of_all(system: System) -> tuple[int, ...] | None:
    return None


DISPLACEMENT = Output(_displacement, _of_displacement)
"""Displacement of platform or end-effector [m], behind the sensor's low-pass."""

VELOCITY = Output(_velocity, _of_velocity)
"""Velocity of platform or end-effector [m/s], behind the sensor's low-pass."""

ACCELERATION = Output(_acceleration, _of_all)
"""The rate of that velocity [m/s2]."""

STOP_FORCE = Output(_stop_force, _of_displacement)
"""The push on the stop [N], behind the sensor's low-pass."""

FRICTION_FORCE = Output(_friction_force, _of_all, _at_once)
"""Friction force of the contact on the end-effector [N], without a sensor."""


def sensor_samples(
    system: AbstractHybridSystem,
    times: Float[Array, " m"],
    accuracy: Accuracy,
    output: Output = DISPLACEMENT,
    segments: int | None = None,
    wanted: Count | None = None,
    steps: TakenSteps | None = None,
) -> Float[Array, " m"]:
    """What the sensor of a `system` shows at `times` [s]: what a fit needs, at less cost than `simulate`.

    **Arguments:** `output` says what of the system is shown, in SI, and by how much it is
    late.  `segments` is how many segments of the drive the times may reach into: where it is given, a
    system known in closed form is not integrated.  Of the times only the first `wanted` are looked at, all by default;
    what is returned for later ones is unknown.  The `steps` to the last of the times are found unless they are given.

    NaN where the motion cannot be integrated; `why_failed` says why.
    """
    keep = output.components(system)
    seen = times - output.delay(system)

    def look(states: SampledStates) -> Float[Array, " some"]:
        x, segment, t_local, mode = states
        return jax.vmap(partial(output.shown, system))(segment, t_local, x, mode)

    if segments is not None and is_closed(system):
        shown, failure = look(exact_states_at(system, jnp.maximum(seen, 0.0), segments)), jnp.zeros((), int)
    else:
        run = sample_run(system, seen, accuracy, keep, times[-1], look, wanted, steps)
        shown, failure = run.states, run.failure
    return from_rest(seen, failure)(shown)


class Scratch(NamedTuple):
    """Memory that one record after the other writes to, so that it is cleared once for all of them."""

    table: Table
    """Of the steps."""
    slopes: Float[Array, "records early p"]
    """Derivatives of the first samples of all records; 0 where none were wanted so far."""


Shown: TypeAlias = tuple[Float[Array, " m"], Float[Array, "records early p"]]
"""Samples, and the derivatives of those of all records."""


def scratch(system: AbstractHybridSystem, accuracy: Accuracy, shape: tuple[int, int, int]) -> Scratch:
    """Room for runs of systems such as this one, and derivatives of that `shape`: (records, early, p)."""
    return Scratch(jnp.zeros((0, 0)) if is_closed(system) else empty_table(system, accuracy), jnp.zeros(shape))


def samples_and_slopes(
    system: Callable[[Tree], AbstractHybridSystem],
    numbers: Tree,
    directions: Tree,
    sloped: Truth,
    scratch: Scratch,
    record: Count,
    times: Float[Array, " m"],
    accuracy: Accuracy,
    output: Output,
    segments: int,
    wanted: Count | None = None,
) -> tuple[Float[Array, " m"], Scratch]:
    """`sensor_samples` of the system of some `numbers`, and where they are `sloped` the derivatives along `directions`.

    Compiled it is one function for both, in which the motion is stepped in one place: that is most of what there is to
    compile.

    **Arguments:** `directions` are p of them, along the first axis of every leaf; the rest is as of `sensor_samples`.

    **Returns:** samples, where they are `sloped` only as many as the `scratch` has derivatives of, the later ones zero;
    and the `scratch`, with the derivatives of this `record` where they are wanted.
    """
    begun = system(numbers)
    steps = None if is_closed(begun) else find_steps(begun, times[-1], accuracy, scratch.table)
    early = scratch.slopes.shape[1]

    def read(numbers: Tree, first: Count) -> Float[Array, " early"]:
        some = lax.dynamic_slice_in_dim(times, first, early)
        few = None if wanted is None else jnp.clip(wanted - first, 1, early)
        return sensor_samples(system(numbers), some, accuracy, output, segments, few, steps)

    def with_slopes(slopes: Float[Array, "records early p"]) -> Shown:
        along = lambda direction: jax.jvp(lambda numbers: read(numbers, jnp.zeros((), int)), (numbers,), (direction,))
        shown, found = jax.vmap(along, out_axes=(None, -1))(directions)
        return jnp.pad(shown, (0, times.size - early)), slopes.at[record].set(found)

    def without(slopes: Float[Array, "records early p"]) -> Shown:
        def next_part(number: Count, shown: Float[Array, " m"]) -> Float[Array, " m"]:
            begin = jnp.minimum(number * early, times.size - early)
            return lax.dynamic_update_slice_in_dim(shown, read(numbers, begin), begin, 0)

        parts = -(-(times.size if wanted is None else wanted) // early)
        return lax.fori_loop(0, parts, next_part, jnp.zeros(times.size)), slopes

    shown, slopes = lax.cond(sloped, with_slopes, without, scratch.slopes)
    return shown, Scratch(scratch.table if steps is None else steps[0], slopes)


def why_failed(
    system: AbstractHybridSystem,
    times: Float[Array, " m"],
    accuracy: Accuracy,
    output: Output = DISPLACEMENT,
    segments: int | None = None,
    wanted: Count | None = None,
) -> Int[Array, ""]:
    """Index into `pdssjax.integration.FAILURES` of the run behind `sensor_samples`; 0 where it works.

    **Arguments:** as of `sensor_samples`; a run fails or not however many samples are `wanted`.
    """
    if segments is not None and is_closed(system):
        return jnp.zeros((), int)
    return integrate_steps(system, times[-1], accuracy, output.components(system)).failure


def from_rest(times: Float[Array, " m"], failure: Count) -> Callable[[Float[Array, " m"]], Float[Array, " m"]]:
    """Function that sets values to zero before the start and, with all derivatives, to NaN where the run failed."""
    known = jnp.where(failure > 0, jnp.nan, 1.0)
    return lambda value: jnp.where(times >= 0, value, 0.0) * known


class Inside(NamedTuple):
    """Motions within a system; arrays of shape (k,), SI, NaN where the system has no such part."""

    voltage: Float[Array, " k"]
    """The command [V]."""
    platform: Float[Array, " k"]
    """[m]"""
    platform_velocity: Float[Array, " k"]
    relative: Float[Array, " k"]
    """Displacement of the contact, y - x_e [m]: of the platform relative to the end-effector."""
    relative_velocity: Float[Array, " k"]
    friction: Float[Array, " k"]
    """Friction force on the end-effector [N]."""


class Observation(NamedTuple):
    """The sensor's output of one run, and the motions inside."""

    shown: Float[Array, " m"]
    """Output of the sensor, in the unit of the record."""
    between: Float[Array, " k"]
    """The same at the instants at which the inside is looked at."""
    inside: Inside
    steps: Int[Array, ""]
    """Accepted; 0 where nothing was integrated."""
    failure: Int[Array, ""]
    """0, or an index into `pdssjax.integration.FAILURES`; all is NaN then."""

    @property
    def message(self) -> str:
        """Why the run did not finish; empty where it did.  Not under jit."""
        return FAILURES[int(self.failure)]


def observe(
    system: System,
    output: Output,
    times: Float[Array, " m"],
    instants: Float[Array, " k"],
    accuracy: Accuracy,
    segments: int,
) -> Observation:
    """What `output` shows of `system` at `times` [s], and what moves inside at `instants` [s], both ascending.

    **Arguments:** no instant is later than the last of the `times`; `segments` is how many segments of the drive the
    times may reach into.  Works under `jit` and `vmap`.  A run that cannot finish is NaN.
    """
    seen = times - output.delay(system)
    if is_closed(system):
        at = lambda when: exact_states_at(system, jnp.maximum(when, 0.0), segments)
        steps = failure = jnp.zeros((), int)
    else:
        run = integrate_steps(system, times[-1], accuracy)
        at, steps, failure = partial(states_at, system, run), run.count, run.failure
    sensed = lambda states: jax.vmap(partial(output.shown, system))(states[1], states[2], states[0], states[3])
    late = instants - output.delay(system)
    return Observation(
        from_rest(seen, failure)(sensed(at(seen))),
        from_rest(late, failure)(sensed(at(late))),
        _inside(system, at(instants), instants, failure),
        steps,
        failure,
    )


def _inside(system: System, states: SampledStates, instants: Float[Array, " k"], failure: Int[Array, ""]) -> Inside:
    x, segment, t_local, mode = states
    show, none = from_rest(instants, failure), jnp.full_like(instants, jnp.nan)
    if isinstance(system, PrescribedMotion):
        force = jax.vmap(system.force)(segment, t_local, x, mode)
        return Inside(none, none, none, show(x[0]), show(segment.slope), show(force))
    driven_platform = system.driven_platform if isinstance(system, PlatformOnly) else system.actuator.driven_platform
    y, w = jax.vmap(driven_platform.platform)(x.driven)
    drive: AbstractDrive = system.drive
    platform = drive.at(instants), show(y), show(w)
    if isinstance(system, PlatformOnly):
        return Inside(*platform, none, none, none)
    force = jax.vmap(system.force)(segment, t_local, x, mode)
    return Inside(*platform, show(x.d), show(x.v), show(force))
