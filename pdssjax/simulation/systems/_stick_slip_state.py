"""The state of an actuator, and the modes of its contact."""

from typing import Generic, NamedTuple, TypeAlias

import jax.numpy as jnp

from ...actuator import DrivenPlatformState
from ...core import Scalar
from ...integration import SETTLED, N_co

ADVANCING, STUCK, RETREATING = 1.0, 0.0, -1.0
"""Modes: v > 0, v = 0 held by friction, v < 0; the fourth is `SETTLED`."""


class StickSlipState(NamedTuple, Generic[N_co]):
    """The state of an actuator; components of parts that it lacks are empty."""

    d: N_co
    """Relative displacement [m]."""
    v: N_co
    """Relative velocity [m/s]."""
    driven: DrivenPlatformState[N_co]
    contact_state: tuple[N_co, ...]
    """State of the contact."""
    in_contact: tuple[N_co, ...]
    """Flag: the end-effector touches the stop."""
    sensor_lag: tuple[N_co, ...]
    """Lag of the sensor [m]; of a sensor at the stop the force that it shows [N]."""


State: TypeAlias = StickSlipState[Scalar]
"""A state of numbers, not of series."""


class Kind(NamedTuple):
    """Weights 1 and 0 that say what the contact does in a mode."""

    moves: Scalar
    sticks: Scalar
    settled: Scalar


def kind(mode: Scalar) -> Kind:
    """The kind of motion of the contact in `mode`."""
    unity, none = jnp.ones_like(mode), jnp.zeros_like(mode)
    return Kind(
        jnp.where(jnp.abs(mode) == 1.0, unity, none),
        jnp.where(mode == STUCK, unity, none),
        jnp.where(mode == SETTLED, unity, none),
    )
