"""The contact alone, under a prescribed relative motion: what a tribometer measures.

Between two samples of the motion the velocity is constant.
"""

from typing import TypeAlias

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ...actuator import chosen
from ...core import Scalar, ScalarLike
from ...drive.base import Segment
from ...friction.base import AbstractFriction
from ...integration import AbstractHybridSystem, N, SampledStates, Term, constant, weighted

State: TypeAlias = tuple[N, tuple[N, ...]]
"""The relative displacement [m], and the state of the contact."""

_STILL = 0.0


class PrescribedMotion(AbstractHybridSystem):
    """One contact under one motion; its state is the contact's."""

    friction: AbstractFriction
    times: Float[Array, " m"]
    """When the relative displacement was measured [s], shape (m,), from 0 on."""
    motion: Float[Array, " m"]
    """The relative displacement [m], shape (m,)."""

    def initial(self) -> State[Scalar]:
        return (jnp.zeros(()), self.friction.initial())

    @property
    def resets_at_corners(self) -> bool:
        """Whether the flags of the law may change at the samples."""
        return type(self.friction).on_reversal is not AbstractFriction.on_reversal

    def segment(self, index: Scalar) -> Segment:
        """Segment of the prescribed motion: displacement in place of a voltage."""
        i = jnp.clip(jnp.asarray(index).astype(int), 0, self.times.shape[0] - 2)
        times, motion = jnp.asarray(self.times), jnp.asarray(self.motion)
        duration = times[i + 1] - times[i]
        # Records of different lengths are filled up with their last sample.
        over = (jnp.asarray(index) > self.times.shape[0] - 2) | (duration <= 0.0)
        slope = (motion[i + 1] - motion[i]) / jnp.where(over, 1.0, duration)
        return Segment(jnp.where(over, jnp.inf, duration), motion[i], jnp.where(over, 0.0, slope))

    def state_scale(self) -> State[Scalar]:
        """Displacement that one unit of each state stands for [m]."""
        return (jnp.ones(()), self.friction.error_scale())

    def field(self, segment: Segment, t_local: Term, x: State[Term], mode: Scalar) -> State[Term]:
        """Time derivative of the state."""
        moves = jnp.where(mode == _STILL, 0.0, 1.0)
        v = x[0] * 0.0 + segment.slope
        rates = self.friction.rate(x[1], v, mode)
        return (v, tuple(weighted(rate, moves) for rate in rates))

    def guards(self, segment: Segment, t_local: Term, x: State[Term], mode: Scalar) -> tuple[Term, ...]:
        """Guards of the friction law."""
        moves = jnp.where(mode == _STILL, 0.0, 1.0)
        law = self.friction.guards(x[1], x[0] * 0.0 + segment.slope, mode)
        return tuple(guard * moves + (1.0 - moves) for guard in law)

    def after_event(
        self, segment: Segment, t_local: ScalarLike, x: State[Scalar], mode: Scalar, which: Scalar
    ) -> tuple[State[Scalar], Scalar]:
        """State and mode after guard `which` has reached zero."""
        return (x[0], self.friction.after_event(x[1], segment.slope, mode, which)), mode

    def on_segment_start(self, segment: Segment, x: State[Scalar], mode: Scalar) -> tuple[State[Scalar], Scalar]:
        """State and mode in which a new segment begins."""
        v, direction = segment.slope, jnp.sign(segment.slope)
        moves, friction = direction != 0.0, self.friction
        contact = chosen(moves & (direction != mode), friction.on_reversal(x[1], direction), x[1])
        # The velocity jumps at every sample.
        return (x[0], chosen(moves, friction.on_velocity_jump(contact, v, direction), contact)), direction

    def has_closed_states(self) -> bool:
        """Whether the law has a closed form at constant velocity, so that nothing is stepped."""
        return self.friction.slides_in_closed_form()

    def closed_states(self, times: Float[Array, " m"], segments: int) -> SampledStates:
        """States at `times`: from sample to sample of the motion, then within the interval of each."""

        def next_sample(
            carry: tuple[State[Scalar], Scalar], index: Scalar
        ) -> tuple[tuple[State[Scalar], Scalar], tuple[State[Scalar], Scalar]]:
            segment = self.segment(index)
            x, mode = self.on_segment_start(segment, *carry)
            lasts = jnp.isfinite(segment.duration)
            return (self._slid(segment, x, mode, jnp.where(lasts, segment.duration, 0.0)), mode), (x, mode)

        first = jax.tree.map(lambda x: jnp.asarray(x, float), self.initial())
        corners = jnp.asarray(self.times)
        _, (begins, modes) = lax.scan(next_sample, (first, jnp.zeros(())), jnp.arange(corners.shape[0]) * 1.0)
        fixed = lax.stop_gradient(corners)
        # The motion ends with its last interval; what comes after is the last sample again, to fill up.
        last = jnp.searchsorted(fixed, fixed[-1]) - 1
        places = jnp.clip(jnp.searchsorted(fixed, times, side="right") - 1, 0, last)
        t_local, mode = times - corners[places], modes[places]
        segment = jax.vmap(self.segment)(places * 1.0)
        x = jax.vmap(self._slid)(segment, jax.tree.map(lambda array: array[places], begins), mode, t_local)
        return SampledStates(x, segment, t_local, mode)

    def _slid(self, segment: Segment, x: State[Scalar], mode: Scalar, elapsed: Scalar) -> State[Scalar]:
        """The state `elapsed` [s] after the begin of a segment in which it is `x`."""
        moves = mode != _STILL
        v, sign = jnp.where(moves, segment.slope, 1.0), jnp.where(moves, mode, 1.0)
        slid = self.friction.slide(x[1], v, jnp.where(moves, elapsed, 0.0), sign)
        return x[0] + segment.slope * elapsed, chosen(moves, slid, x[1])

    def force(self, segment: Segment, t_local: ScalarLike, x: State[Scalar], mode: Scalar) -> Scalar:
        """Friction force [N]; of a set-valued law at rest the middle of its interval."""
        sliding = self.friction.force(x[1], segment.slope, jnp.where(mode == _STILL, 1.0, mode))
        middle = 0.5 * (self.friction.force(x[1], 0.0, 1.0) + self.friction.force(x[1], 0.0, -1.0))
        return jnp.where(mode == _STILL, constant(middle), constant(sliding))
