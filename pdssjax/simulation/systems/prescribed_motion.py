"""The contact alone, under a prescribed relative motion: what a tribometer measures.

Between two samples of the motion the velocity is constant.
"""

from typing import Any

import jax.numpy as jnp

from ...actuator import chosen
from ...drive.base import Segment
from ...friction.base import AbstractFriction
from ...integration import AbstractHybridSystem, weighted

_STILL = 0.0


class PrescribedMotion(AbstractHybridSystem):
    """One contact under one motion; its state is the contact's."""

    friction: AbstractFriction
    times: Any
    """When the relative displacement was measured [s], shape (m,), from 0 on."""
    motion: Any
    """The relative displacement [m], shape (m,)."""

    def initial(self) -> tuple:
        return (jnp.zeros(()), self.friction.initial())

    @property
    def resets_at_corners(self) -> bool:
        """Flags may change at the samples."""
        return type(self.friction).on_reversal is not AbstractFriction.on_reversal

    def segment(self, index) -> Segment:
        """Displacement in place of a voltage."""
        i = jnp.clip(jnp.asarray(index).astype(int), 0, self.times.shape[0] - 2)
        duration = self.times[i + 1] - self.times[i]
        # Records of different lengths are filled up with their last sample.
        over = (jnp.asarray(index) > self.times.shape[0] - 2) | (duration <= 0.0)
        slope = (self.motion[i + 1] - self.motion[i]) / jnp.where(over, 1.0, duration)
        return Segment(jnp.where(over, jnp.inf, duration), self.motion[i], jnp.where(over, 0.0, slope))

    def state_scale(self) -> tuple:
        """What one unit of each state amounts to as a displacement [m]."""
        return (jnp.ones(()), self.friction.error_scale())

    def field(self, segment: Segment, t_local, x: tuple, mode) -> tuple:
        """Time derivative of the state."""
        moves = jnp.where(mode == _STILL, 0.0, 1.0)
        v = x[0] * 0.0 + segment.slope
        rates = self.friction.rate(x[1], v, mode)
        return (v, tuple(weighted(rate, moves) for rate in rates))

    def guards(self, segment: Segment, t_local, x: tuple, mode) -> tuple:
        """The law's own."""
        moves = jnp.where(mode == _STILL, 0.0, 1.0)
        law = self.friction.guards(x[1], x[0] * 0.0 + segment.slope, mode)
        return tuple(guard * moves + (1.0 - moves) for guard in law)

    def after_event(self, segment: Segment, t_local, x: tuple, mode, which) -> tuple[tuple, Any]:
        """State and mode after guard `which` has reached zero."""
        return (x[0], self.friction.after_event(x[1], segment.slope, mode, which)), mode

    def on_segment_start(self, segment: Segment, x: tuple, mode) -> tuple[tuple, Any]:
        """State and mode in which a new segment begins."""
        direction = jnp.sign(segment.slope)
        begins = (direction != 0.0) & (direction != mode)
        return (x[0], chosen(begins, self.friction.on_reversal(x[1], direction), x[1])), direction

    def force(self, segment: Segment, t_local, x: tuple, mode):
        """Friction force [N]; of a set-valued law at rest the middle of its interval."""
        sliding = self.friction.force(x[1], segment.slope, jnp.where(mode == _STILL, 1.0, mode))
        zero: Any = 0.0
        middle = 0.5 * (self.friction.force(x[1], zero, 1.0) + self.friction.force(x[1], zero, -1.0))  # pyright: ignore[reportArgumentType]
        return jnp.where(mode == _STILL, middle, sliding)
