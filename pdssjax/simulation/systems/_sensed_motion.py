"""What the sensor of an actuator shows: of platform or end-effector or, where there is a stop, of the force on it.

Of a motion the sensor's state is its lag; of a force, which does not drift, it is what the sensor shows.
"""

from typing import NamedTuple

from ...actuator import Actuator, Sensor
from ...core import Scalar, ScalarLike
from ...integration import N, Term, constant
from ._contact_state import State
from ._stop_contact import push_on_stop


class SensedMotion(NamedTuple):
    """A sensor that looks at an actuator."""

    actuator: Actuator
    sensor: Sensor
    on_platform: ScalarLike
    """1 where it looks at the platform, 0 at the end-effector."""

    def rate(self, x: State[Term], active: ScalarLike) -> tuple[Term, ...]:
        """Time derivative of the sensor's state; of a lag 0 where nothing is `active`, of a force never."""
        if self.actuator.stop is not None:
            return tuple((push_on_stop(self.actuator, x) - shown) * self.sensor.pole() for shown in x.sensor_lag)
        return tuple(rate * active for rate in self.sensor.rate(x.sensor_lag, self._speed(x)))

    def after_platform_jump(self, x: State[Scalar], jump: Scalar) -> tuple[Scalar, ...]:
        """The sensor's state after the platform has jumped by `jump` [m]; the end-effector has not, nor a force."""
        if self.actuator.stop is not None:
            return x.sensor_lag
        return self.sensor.after_jump(x.sensor_lag, jump * self.on_platform)

    def displacement(self, x: State[Scalar]) -> Scalar:
        """The displacement [m] that it shows."""
        y, _ = self.actuator.driven_platform.platform(x.driven)
        return self.sensor.shown_displacement(self._motion_lag(x), y - x.d * (1.0 - self.on_platform))

    def velocity(self, x: State[Scalar]) -> Scalar:
        """The velocity [m/s] that it shows."""
        return self.sensor.shown_velocity(self._motion_lag(x), self._speed(x))

    def force(self, x: State[Scalar]) -> ScalarLike:
        """The force on the stop [N] that it shows."""
        return x.sensor_lag[0] if x.sensor_lag else constant(push_on_stop(self.actuator, x))

    def _speed(self, x: State[N]) -> N:
        _, w = self.actuator.driven_platform.platform(x.driven)
        return w - x.v * (1.0 - self.on_platform)

    def _motion_lag(self, x: State[Scalar]) -> tuple[Scalar, ...]:
        if self.actuator.stop is not None and x.sensor_lag:
            raise ValueError("Expected a sensor without a filter beside a stop, whose force it filters, but got one.")
        return x.sensor_lag
