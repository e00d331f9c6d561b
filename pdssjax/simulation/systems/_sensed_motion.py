"""How the state of an actuator's sensor follows the motion of platform or end-effector or the force on a stop.

Of a motion that state is the sensor's lag; of a force, which does not drift, it is what the sensor shows.
"""

from typing import NamedTuple

import jax.numpy as jnp

from ...actuator import Actuator, Sensor
from ...core import Scalar, ScalarLike
from ...integration import N, Term
from ._stick_slip_state import State, StickSlipState
from ._sticking import push_on_stop


class SensedMotion(NamedTuple):
    """A sensor of the motion of an actuator, or of the force on its stop."""

    actuator: Actuator
    sensor: Sensor
    on_platform: ScalarLike
    """1 where it looks at the platform, 0 at the end-effector."""

    def rate(self, x: StickSlipState[Term], active: ScalarLike) -> tuple[Term, ...]:
        """Time derivative of the sensor's state; 0 where nothing is `active`."""
        if self.actuator.stop is not None:
            rates = tuple((push_on_stop(self.actuator, x) - shown) * self.sensor.pole() for shown in x.sensor_lag)
        else:
            rates = self.sensor.rate(x.sensor_lag, self.speed(x))
        return tuple(rate * active for rate in rates)

    def state_scale(self) -> Scalar:
        """Displacement that one unit of the sensor's state stands for [m]."""
        stop = self.actuator.stop
        return jnp.ones(()) if stop is None else 1.0 / jnp.asarray(stop.stiffness, float)

    def after_platform_jump(self, x: State, jump: Scalar) -> tuple[Scalar, ...]:
        """The sensor's state after the platform has jumped by `jump` [m]; the end-effector has not, nor a force."""
        if self.actuator.stop is not None:
            return x.sensor_lag
        return self.sensor.after_jump(x.sensor_lag, jump * self.on_platform)

    def speed(self, x: StickSlipState[N]) -> N:
        """Rate of the measured quantity [m/s]."""
        _, w = self.actuator.driven_platform.platform(x.driven)
        return w - x.v * (1.0 - self.on_platform)
