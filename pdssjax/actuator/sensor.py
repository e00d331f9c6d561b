"""What the sensor makes of a motion: a first-order low-pass and a delay.

    s' = w_s (x - s),   seen at t: s(t - delay).

The state is the lag e = x - s, which does not depend on how far the end-effector has moved:
e' = x' - w_s e.  A sensor of velocity with the same low-pass shows s' = w_s e.
"""

import equinox as eqx
import jax.numpy as jnp

from ..core import AbstractModel, Scalar, ScalarLike, quantity
from ..integration import Term


class Sensor(AbstractModel):
    """A displacement, velocity or force sensor with its filter."""

    bandwidth: float = quantity(1e3, "Hz", optional=True)
    """Frequency at which the signal is down by 3 dB [Hz]."""
    delay: float = quantity(0.0, "s", positive=False, low=0.0, optional=True)
    """Time by which the record is late [s]."""
    filters: bool = eqx.field(static=True, default=True)
    """False: only late."""

    def initial(self) -> tuple[Scalar, ...]:
        """The lag of a sensor while nothing moves; none without a filter."""
        return (jnp.zeros(()),) if self.filters else ()

    def rate(self, sensor_lag: tuple[Term, ...], speed: Term) -> tuple[Term, ...]:
        """Time derivative of the lag where what is measured changes with `speed`."""
        return tuple(speed - e * self.pole() for e in sensor_lag)

    def steady(self, sensor_lag: tuple[Scalar, ...], speed: Scalar) -> tuple[Scalar, ...]:
        """The lag behind what has long changed with `speed`."""
        return tuple(speed / self.pole() for _ in sensor_lag)

    def after_jump(self, sensor_lag: tuple[Scalar, ...], jump: Scalar) -> tuple[Scalar, ...]:
        """The lag after what is measured has jumped: what is shown has not."""
        return tuple(e + jump for e in sensor_lag)

    def shown_displacement(self, sensor_lag: tuple[Scalar, ...], true: Scalar) -> Scalar:
        """What it shows of a displacement [m], or of whatever it follows, `sensor_lag` behind."""
        return true - sensor_lag[0] if sensor_lag else true

    def shown_velocity(self, sensor_lag: tuple[Scalar, ...], true: Scalar) -> Scalar:
        """What it shows of a velocity [m/s]: the rate of what it shows of the displacement, x' - e' = w_s e."""
        return sensor_lag[0] * self.pole() if sensor_lag else true

    def pole(self) -> ScalarLike:
        """Angular corner frequency w_s [rad/s]."""
        return 2.0 * jnp.pi * self.bandwidth


IDEAL = Sensor(filters=False)
"""Shows what is there when it is there."""
