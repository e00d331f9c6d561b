"""The state of an actuator, and the modes of its contact."""

from typing import Any, NamedTuple

import jax.numpy as jnp

from ...actuator import DrivenPlatformState
from ...integration import SETTLED

ADVANCING, STUCK, RETREATING = 1.0, 0.0, -1.0
"""Modes: v > 0, v = 0 held by friction, v < 0; the fourth is `SETTLED`."""


class State(NamedTuple):
    """All that moves; the parts that an actuator has not are empty."""

    d: Any
    """Relative displacement [m]."""
    v: Any
    """Relative velocity [m/s]."""
    driven: DrivenPlatformState
    contact_state: tuple
    """Of the contact."""
    in_contact: tuple
    """Flag: the end-effector touches the stop."""
    sensor_lag: tuple
    """What the sensor is behind [m]; at the stop the force that it shows [N]."""


def kind(mode):
    """Weights 1 and 0 that say whether the contact slides, sticks or rests."""
    unity, none = jnp.ones_like(mode), jnp.zeros_like(mode)
    return (
        jnp.where(jnp.abs(mode) == 1.0, unity, none),
        jnp.where(mode == STUCK, unity, none),
        jnp.where(mode == SETTLED, unity, none),
    )
