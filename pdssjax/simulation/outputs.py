"""What a sensor shows of a hybrid system: a function of its state, and the components that this takes.

A measurement names one of these, or makes its own.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import jax

from ..core import Scalar, ScalarLike
from ..drive.base import Segment

System: TypeAlias = Any
"""The system of a record: one that has what is asked of it, such as `shown_displacement`."""

State: TypeAlias = Any
"""Of that system."""


def _delay_of_sensor(system: System) -> ScalarLike:
    # A system need not have a sensor.
    return system.sensor.delay if hasattr(system, "sensor") else 0.0


def _at_once(system: System) -> ScalarLike:
    return 0.0


class Output(NamedTuple):
    """What is shown of a system; static, since records that share it share one compiled function."""

    shown: Callable[[System, Segment, Scalar, State, Scalar], Scalar]
    """(system, segment, t_local, x, mode) to what is shown [SI], shape ()."""
    components: Callable[[System], tuple[int, ...] | None]
    """Of a system, the components of its state of which that is made, counted as leaves; None for all."""
    delay: Callable[[System], ScalarLike] = _delay_of_sensor
    """Of a system, by how much later it is shown [s]; its sensor's delay by default, 0 where it has none."""


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


DISPLACEMENT = Output(_displacement, lambda system: system.output_components())
"""Of platform or end-effector [m], behind the sensor's low-pass."""

VELOCITY = Output(_velocity, lambda system: system.velocity_components())
"""The same of a sensor of velocity [m/s]."""

ACCELERATION = Output(_acceleration, lambda system: None)
"""The rate of that velocity [m/s2]."""

STOP_FORCE = Output(_stop_force, lambda system: system.output_components())
"""The push on the stop [N], behind the sensor's low-pass."""

FRICTION_FORCE = Output(_friction_force, lambda system: None, _at_once)
"""Of the contact on the end-effector [N], as it is."""
