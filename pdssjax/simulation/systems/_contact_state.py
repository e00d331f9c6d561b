"""The state of an actuator, and the modes of its contact."""

from typing import Any, NamedTuple

import jax.numpy as jnp

from .integration import RESTING as RESTING
from .stage import Driven
from .stage import chosen as chosen

ADVANCING, STUCK, RETREATING = 1.0, 0.0, -1.0
"""Modes: v > 0, v = 0 held by friction, v < 0; the fourth is `RESTING`."""


class State(NamedTuple):
    """All that moves; the parts that an actuator has not are empty."""

    d: Any
    """Relative displacement [m]."""
    v: Any
    """Relative velocity [m/s]."""
    stage: Driven
    memory: tuple
    """Of the contact."""
    touch: tuple
    """Flag: the end-effector touches the stop."""
    lag: tuple
    """What the sensor is behind [m]; at the stop the force that it shows [N]."""


def kind(mode):
    """Weights 1 and 0 that say whether the contact slides, sticks or rests."""
    one, none = jnp.ones_like(mode), jnp.zeros_like(mode)
    return (
        jnp.where(jnp.abs(mode) == 1.0, one, none),
        jnp.where(mode == STUCK, one, none),
        jnp.where(mode == RESTING, one, none),
    )
