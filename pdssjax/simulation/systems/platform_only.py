"""The platform without an end-effector that it could feel: the hybrid system of amplifier, piezo and sensor.

For what has no closed form: a stack with hysteresis, an amplifier, a slow sensor.
"""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp

from .drive.base import AbstractDrive, Segment
from .integration import RESTING
from .sensor import IDEAL, Sensor
from .stage import Driven, Stage


class State(NamedTuple):
    """All that moves."""

    stage: Driven
    lag: tuple
    """What the sensor is behind [m]."""


class Unloaded(eqx.Module):
    """One platform under one drive, as `integration` wants it."""

    stage: Stage
    drive: AbstractDrive
    sensor: Sensor = IDEAL

    def initial(self) -> State:
        return State(self.stage.initial(), self.sensor.initial())

    @property
    def jumps(self) -> bool:
        """The state may jump at the corners of the drive."""
        return self.stage.jumps

    @property
    def alters(self) -> bool:
        """The state may change at the corners in any way, flags included."""
        return self.jumps or self.stage.amplifier is not None

    def segment(self, index) -> Segment:
        return self.drive.segment(index)

    def period(self) -> tuple[int, int] | None:
        return self.drive.period()

    def displaced(self) -> tuple[int, ...]:
        """The components of which the measured motion is made."""
        return tuple(range(len(jax.tree.leaves(self.initial()))))

    def scales(self) -> State:
        """What one unit of each state amounts to as a displacement [m]."""
        return State(self.stage.length(), tuple(jnp.ones(()) for _ in self.initial().lag))

    def field(self, segment: Segment, after, x: State, mode) -> State:
        """Time derivative of the state."""
        active = jnp.where(mode == RESTING, 0.0, 1.0)
        _, w = self.stage.platform(x.stage)
        lag = tuple(rate * active for rate in self.sensor.rate(x.lag, w))
        return State(self.stage.rate(segment, after, x.stage, 0.0, active), lag)

    def guards(self, segment: Segment, after, x: State, mode) -> tuple:
        """Those of amplifier and piezo; the first is never reached, so that there is one."""
        y, _ = self.stage.platform(x.stage)
        return (y * 0.0 + 1.0, *self.stage.guards(segment, after, x.stage))

    def switch(self, segment: Segment, after, x: State, mode, which) -> tuple[State, Any]:
        """State and mode after guard `which` has reached zero."""
        return x._replace(stage=self.stage.passed(segment, after, x.stage, which - 1)), mode

    def enter(self, segment: Segment, x: State, mode) -> tuple[State, Any]:
        """State and mode in which a new segment begins."""
        return x._replace(stage=self.stage.entered(segment, x.stage)), jnp.ones_like(mode)

    def settled(self, segment: Segment, after, x: State, mode, tolerance):
        """Nothing but steady creep is left, to within `tolerance` [m]."""
        away = self.stage.ringing(segment, after, x.stage, 0.0)
        for lag, steady in zip(x.lag, self._steady_lag(segment, after, x), strict=True):
            away = jnp.maximum(away, jnp.abs(lag - steady))
        return (mode != RESTING) & (away < tolerance)

    def settle(self, segment: Segment, after, x: State, mode) -> State:
        """The state with the last of the deviations gone."""
        return State(self.stage.steady(segment, after, x.stage, 0.0), self._steady_lag(segment, after, x))

    def alike(self, x: State, earlier: State, tolerance):
        """Both begin the same motion, to within `tolerance` [m]."""
        away = jax.tree.map(lambda a, b, unit: jnp.abs(a - b) * unit, x, earlier, self.scales())
        return jnp.stack(jax.tree.leaves(away)).max() < tolerance

    def hidden(self, x: State, mode) -> tuple:
        """Nothing but the state has to be resolved."""
        return ()

    def closed_components(self) -> tuple[int, ...]:
        """The components, counted as the leaves of `State`, that `exact` knows."""
        return tuple(range(len(self.stage.piezo.initial()))) if self.stage.closed else ()

    def faint(self, slope, mode, which):
        """No event here is mere rounding."""
        return jnp.zeros((), bool)

    def exact(self, segment: Segment, after, begin: State, lapse, end: State) -> State:
        """`end` with what is known in closed form put right."""
        if not self.stage.closed:
            return end
        return end._replace(stage=self.stage.motion(segment, after, begin.stage, lapse))

    def measured(self, x: State):
        """Displacement [m] that the sensor shows."""
        y, _ = self.stage.platform(x.stage)
        return y - x.lag[0] if x.lag else y

    def _steady_lag(self, segment, after, x):
        steady = self.stage.steady(segment, after, x.stage, 0.0)
        return self.sensor.steady(x.lag, self.stage.platform(steady)[1])
