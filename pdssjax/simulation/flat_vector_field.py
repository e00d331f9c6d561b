"""The vector field of an actuator as `diffrax.ODETerm` takes it: `f(t, y, args)` on a flat state."""

from typing import Literal, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from ..actuator import Actuator
from ..core import InputError, Scalar, ScalarLike, require_float64
from ..drive.base import AbstractDrive, Segment
from ..friction.base import AbstractFriction
from ..integration import Accuracy, flat, unflattener
from .steady_cycles import checked_arguments
from .systems._stick_slip_state import ADVANCING, RETREATING, STUCK, StickSlipState
from .systems._sticking import mode_from_rest
from .systems.stick_slip import StickSlip

_FOR_EVER = 1e9
"""A time [s] by which a drive that does not repeat has come to its last segment."""


class DriveClock(eqx.Module):
    """When the segments of a drive begin: all of them, or those until the first period has ended."""

    drive: AbstractDrive
    origins: Float[Array, " segments"]
    """[s]"""
    period: Scalar
    """Period of a drive that repeats [s]; else infinite."""
    first: int = eqx.field(static=True)
    """Segment with which the first period begins."""

    def at(self, time: Scalar) -> tuple[Segment, Scalar]:
        """The segment at a `time` [s] from the start of the drive, and the time since it began [s]."""
        since = lax.stop_gradient((time - self.origins[self.first]) / self.period)
        cycles = jnp.maximum(jnp.floor(since), 0.0)
        time = time - jnp.where(cycles > 0.0, cycles * self.period, 0.0)
        # A comparison with all of them: a search would be a loop within the solver's.
        begun = jnp.sum(lax.stop_gradient(self.origins) <= lax.stop_gradient(time))
        place = jnp.maximum(begun - 1, 0)
        return self.drive.segment(place + cycles * (self.origins.size - self.first)), time - self.origins[place]


def drive_clock(drive: AbstractDrive) -> DriveClock:
    """The clock of `drive`; its functions are compiled once for drives of one kind."""
    cycle = drive.period()
    first, count = cycle or (0, drive.segments(_FOR_EVER))
    return _clock(drive, first, count, cycle is not None)


@eqx.filter_jit
def _clock(drive: AbstractDrive, first: int, count: int, repeats: bool) -> DriveClock:
    durations = jax.vmap(lambda index: drive.segment(index).duration)(jnp.arange(first + count) * 1.0)
    origins = jnp.concatenate([jnp.zeros(1), jnp.cumsum(durations)[:-1]])
    return DriveClock(drive, origins, jnp.sum(durations[first:]) if repeats else jnp.inf * jnp.ones(()), first)


ContactMode: TypeAlias = Literal["advancing", "stuck", "retreating"]
"""The relative velocity is positive, zero and held by friction, or negative."""

_MODES = {"advancing": ADVANCING, "stuck": STUCK, "retreating": RETREATING}


class VectorField(eqx.Module):
    """`f(t, y, args)`, the time derivative of the flat state `y` at the time `t` [s]; see `vector_field`."""

    system: StickSlip
    clock: DriveClock
    initial: Float[Array, " components"]
    """The state at t = 0, at rest, just after the drive has begun; shape (components,)."""
    mode: ContactMode | None = eqx.field(static=True)

    def __call__(
        self, t: ScalarLike, y: Float[Array, " components"], args: object = None
    ) -> Float[Array, " components"]:
        """The rates of the components, shape (components,), each in its unit a second; `args` are not used."""
        segment, t_local = self.clock.at(jnp.asarray(t, float))
        x = self._state(y)
        if self.mode is not None:
            mode = jnp.asarray(_MODES[self.mode])
        else:
            at_rest = mode_from_rest(self.system.actuator, segment, t_local, x, ended=0.0)
            mode = jnp.where(x.v == 0.0, at_rest, jnp.sign(x.v))
        return jnp.stack(jax.tree.leaves(self.system.rates(segment, t_local, x, mode)))

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each component: "d", "v", "driven.stack.0", "contact_state.0", ..."""
        leaves, _ = jax.tree_util.tree_flatten_with_path(self.system.initial())
        return tuple(jax.tree_util.keystr(path, simple=True, separator=".") for path, _ in leaves)

    def displacements(self, y: Float[Array, " components"]) -> tuple[Scalar, Scalar]:
        """Platform and end-effector displacement [m] in the state `y`."""
        x = self._state(y)
        platform, _ = self.system.actuator.driven_platform.platform(x.driven)
        return platform, platform - x.d

    def corners(self, until: float) -> Float[np.ndarray, " corners"]:
        """Times [s] after 0 and before `until` where the voltage or its rate jumps, for `jump_ts` of a controller.

        Not under `jit`.
        """
        indices = jnp.arange(self.system.drive.segments(until)) * 1.0
        ends = np.cumsum(np.asarray(jax.vmap(lambda index: self.system.segment(index).duration)(indices)))
        return np.unique(ends[(ends > 0.0) & (ends < until)])

    def _state(self, y: Float[Array, " components"]) -> StickSlipState[Scalar]:
        return unflattener(self.system)(list(y))


def vector_field(actuator: Actuator, drive: AbstractDrive, mode: ContactMode | None = None) -> VectorField:
    """The motion of `actuator` under `drive` as an ordinary differential equation, for `diffrax.ODETerm`.

        f = pdssjax.vector_field(actuator, drive)
        control = diffrax.ClipStepSizeController(diffrax.PIDController(rtol=1e-8, atol=1e-12), jump_ts=f.corners(0.1))
        found = diffrax.diffeqsolve(diffrax.ODETerm(f), diffrax.Tsit5(), 0.0, 0.1, 1e-6, f.initial,
                                    stepsize_controller=control)
        platform, effector = f.displacements(found.ys[-1])

    The state is a vector, named by `f.names` and at rest in `f.initial`: first the relative displacement
    d = platform - effector [m] and its rate v [m/s], then the states of stack and amplifier, of the contact (a
    bristle's deflection [m]; flags have the rate 0), and of a stop.

    **Plain differentiation of a solution of it is wrong.**  The times of reversals move with the parameters, and where
    the field jumps there, so does the derivative, which no tolerance cures: in the deflection reading it is 300 % off
    by the natural frequency, 14 % by the mass and 7 % by the damping ratio.  `simulate`, `steady_cycle` and
    `Study.predict` locate the events, by any solver, and differentiate rightly.

    **Arguments:** `mode` holds the field of one mode, smooth and right as long as the contact stays in it; None takes
    the mode from the sign of v.

    **Raises:** `InputError` for an actuator, a drive or a mode of another kind, and in single precision; without a
    `mode` also for a part whose state changes at events, which a field cannot tell: a law with bonds or saturation,
    hysteresis, an amplifier that slews, a stop, a platform without inertia.
    """
    require_float64("vector_field")
    if mode is not None and mode not in _MODES:
        raise InputError(f"mode: found {mode!r:.80}, expected None, or one of {', '.join(_MODES)}.")
    actuator, drive, _ = checked_arguments(actuator, drive, Accuracy())
    system = StickSlip(actuator, drive)
    if mode is None and (part := _part_with_events(system)):
        raise InputError(
            f"vector_field: found {part}, whose state changes at events that a field does not tell, expected parts "
            "whose state is smooth; `pdssjax.simulate` has the events, and `mode` a field that is right between them."
        )
    return VectorField(system, drive_clock(drive), _initial(system), mode)


def _part_with_events(system: StickSlip) -> str:
    """The first part of an actuator that changes its state at an event of its own; empty where none does."""
    actuator = system.actuator
    law, platform = actuator.friction, actuator.driven_platform
    if law.flags_shape_force and type(law).after_event is not AbstractFriction.after_event:
        return f"the friction law {type(law).__name__}"
    if actuator.stop is not None:
        return "a stop"
    if platform.state_jumps or platform.guards(system.segment(jnp.zeros(())), 0.0, platform.initial()):
        return f"the platform's {type(actuator.piezo).__name__} and its amplifier"
    return ""


@eqx.filter_jit
def _initial(system: StickSlip) -> Float[Array, " components"]:
    """The components of the state in which the first segment begins."""
    zero = jnp.zeros(())
    return flat(system.on_segment_start(system.segment(zero), system.initial(), zero)[0])
