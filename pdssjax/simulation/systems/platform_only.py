"""The hybrid system of amplifier, piezo and sensor, without an end-effector.

For what has no closed form: a stack with hysteresis, an amplifier, a slow sensor.
"""

from typing import Generic, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from ...actuator import IDEAL, DrivenPlatform, DrivenPlatformState, Sensor
from ...core import Scalar, ScalarLike, Truth
from ...drive.base import AbstractDrive, Segment
from ...integration import SETTLED, AbstractHybridSystem, N_co, SampledStates, Term


class State(NamedTuple, Generic[N_co]):
    """State of piezo, amplifier and sensor."""

    driven: DrivenPlatformState[N_co]
    sensor_lag: tuple[N_co, ...]
    """Lag of the sensor [m]."""


class PlatformOnly(AbstractHybridSystem):
    """One platform under one drive."""

    driven_platform: DrivenPlatform
    drive: AbstractDrive
    sensor: Sensor = IDEAL

    def initial(self) -> State[Scalar]:
        return State(self.driven_platform.initial(), self.sensor.initial())

    @property
    def resets_at_corners(self) -> bool:
        """Whether the platform jumps, or the piezo learns that the amplifier's input turned."""
        return self.driven_platform.state_jumps or self.driven_platform.amplifier is not None

    def segment(self, index: Scalar) -> Segment:
        return self.drive.segment(index)

    def period(self) -> tuple[int, int] | None:
        return self.drive.period()

    def output_components(self) -> tuple[int, ...]:
        """The components of which the measured motion is made."""
        return tuple(range(len(jax.tree.leaves(self.initial()))))

    def state_scale(self) -> State[Scalar]:
        """Displacement that one unit of each state stands for [m]."""
        return State(self.driven_platform.error_scale(), tuple(jnp.ones(()) for _ in self.initial().sensor_lag))

    def field(self, segment: Segment, t_local: Term, x: State[Term], mode: Scalar) -> State[Term]:
        """Time derivative of the state."""
        active = jnp.where(mode == SETTLED, 0.0, 1.0)
        _, w = self.driven_platform.platform(x.driven)
        sensor_lag = tuple(rate * active for rate in self.sensor.rate(x.sensor_lag, w))
        return State(self.driven_platform.rate(segment, t_local, x.driven, 0.0, active), sensor_lag)

    def rates(self, segment: Segment, t_local: Scalar, x: State[Scalar], mode: Scalar) -> State[Scalar]:
        """The true time derivative in any mode."""
        return super().rates(segment, t_local, x, jnp.ones_like(mode))

    def guards(self, segment: Segment, t_local: Term, x: State[Term], mode: Scalar) -> tuple[Term, ...]:
        """Guards of amplifier and piezo, positive inside the mode."""
        return self.driven_platform.guards(segment, t_local, x.driven)

    def after_event(
        self, segment: Segment, t_local: ScalarLike, x: State[Scalar], mode: Scalar, which: Scalar
    ) -> tuple[State[Scalar], Scalar]:
        """State after an event of amplifier or piezo, and the mode, which stays."""
        return x._replace(driven=self.driven_platform.after_event(segment, t_local, x.driven, which)), mode

    def is_carried_back(self, slope: Scalar, mode: Scalar, which: Scalar, amplitude: float) -> Truth:
        """Whether an event of the piezo comes from a voltage at rest, to within `amplitude` [m]."""
        return self.driven_platform.is_small_event(slope, which, amplitude)

    def on_segment_start(self, segment: Segment, x: State[Scalar], mode: Scalar) -> tuple[State[Scalar], Scalar]:
        """State and mode in which a new segment begins."""
        driven = self.driven_platform.on_segment_start(segment, x.driven)
        jump = self.driven_platform.platform(driven)[0] - self.driven_platform.platform(x.driven)[0]
        return State(driven, self.sensor.after_jump(x.sensor_lag, jump)), jnp.ones_like(mode)

    def is_settled(
        self, segment: Segment, t_local: ScalarLike, x: State[Scalar], mode: Scalar, tolerance: ScalarLike
    ) -> Truth:
        """Whether only steady creep is left, to within `tolerance` [m]."""
        away = self.driven_platform.ringing(segment, t_local, x.driven, 0.0)
        for value, steady in zip(x.sensor_lag, self._steady_lag(segment, t_local, x), strict=True):
            away = jnp.maximum(away, jnp.abs(value - steady))
        return (mode != SETTLED) & (away < tolerance)

    def project_to_steady(self, segment: Segment, t_local: ScalarLike, x: State[Scalar], mode: Scalar) -> State[Scalar]:
        """The state projected onto the steady solution."""
        return State(
            self.driven_platform.steady(segment, t_local, x.driven, 0.0), self._steady_lag(segment, t_local, x)
        )

    def closed_components(self) -> tuple[int, ...]:
        """The components, counted as the leaves of `State`, that `exact` knows."""
        return tuple(range(len(self.driven_platform.piezo.initial()))) if self._closed else ()

    @property
    def _closed(self) -> bool:
        """Known in closed form on a segment."""
        on_lines = self.has_closed_states() and self.drive.segment(jnp.zeros(())).wave is None
        return self.driven_platform.closed or on_lines

    def exact(
        self, segment: Segment, t_local: ScalarLike, begin: State[Scalar], elapsed: ScalarLike, end: State[Scalar]
    ) -> State[Scalar]:
        """`end` with the components known in closed form replaced."""
        if not self._closed:
            return end
        return end._replace(driven=self.driven_platform.motion(segment, t_local, begin.driven, elapsed))

    def has_closed_states(self) -> bool:
        """Whether all states are known in closed form; through guards only if nothing has to be stepped."""
        return self.driven_platform.closed_on_lines and not self.driven_platform.closed and not self.sensor.initial()

    def closed_states(self, times: Float[Array, " m"], segments: int) -> SampledStates:
        """States by the piezo, which passes all corners of a chain of lines at once and follows waves as lines."""
        chain = jax.vmap(self.drive.segment)(jnp.arange(segments) * 1.0)
        lasts = jnp.isfinite(chain.duration)
        ends = jnp.cumsum(jnp.where(lasts, chain.duration, jnp.inf))
        origins = jnp.concatenate([jnp.zeros(1), ends[:-1]])
        places = jnp.clip(jnp.searchsorted(lax.stop_gradient(origins), times, side="right") - 1, 0)
        t_local = times - origins[places]
        stack = self.driven_platform.piezo.states_on_lines(chain, places, t_local)
        segment = jax.tree.map(lambda array: array[places], chain)
        return SampledStates(State(DrivenPlatformState(stack, ()), ()), segment, t_local, jnp.ones_like(times))

    def shown_displacement(self, x: State[Scalar]) -> Scalar:
        """Displacement [m] that the sensor shows."""
        return self.sensor.shown_displacement(x.sensor_lag, self.driven_platform.platform(x.driven)[0])

    def shown_velocity(self, x: State[Scalar]) -> Scalar:
        """Velocity [m/s] that a sensor of velocity shows."""
        return self.sensor.shown_velocity(x.sensor_lag, self.driven_platform.platform(x.driven)[1])

    def velocity_components(self) -> tuple[int, ...]:
        """The components of which the velocity shown is made."""
        return self.output_components()

    def _steady_lag(self, segment: Segment, t_local: ScalarLike, x: State[Scalar]) -> tuple[Scalar, ...]:
        steady = self.driven_platform.steady(segment, t_local, x.driven, 0.0)
        return self.sensor.steady(x.sensor_lag, self.driven_platform.platform(steady)[1])
