"""The parts of a rig besides piezo and friction: amplifier, end-effector, stop and sensor, a converter's staircase."""

import dataclasses
from collections.abc import Mapping
from typing import Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ..core import AbstractModel, Quantity, Scalar, ScalarLike, quantity
from ..drive.base import AbstractDrive, Flanks, Segment, Voltage
from ..integration import Term


class Amplifier(AbstractModel):
    """A voltage amplifier of finite bandwidth and slew rate.

        u' = w_a (command - u), but never faster than the slew rate.

    Its state is the voltage u and a flag: 0 while it follows, +1 or -1 while it slews.
    """

    bandwidth: float = quantity(5e3, "Hz", optional=True)
    """Frequency at which a small signal is down by 3 dB [Hz]."""
    slew: float = quantity(1e9, "V/s", optional=True)
    """Largest rate of the output [V/s]."""

    def initial(self) -> tuple[Scalar, ...]:
        """The state at rest: the output [V], and 0 while it follows, 1 or -1 while it slews."""
        return jnp.zeros(()), jnp.zeros(())

    def rate(self, state: tuple[Term, ...], command: Voltage[Term]) -> tuple[Term, ...]:
        """Time derivative of the state [V/s]."""
        u, slews = state
        follows = 1.0 - slews * slews
        return (command.level - u) * (self.pole() * follows) + slews * self.slew, 0

    def output(self, state: tuple[Term, ...], command: Voltage[Term]) -> Voltage[Term]:
        """The voltage on the piezo; numbers or series."""
        slope, _ = self.rate(state, command)
        follows = 1.0 - state[1] * state[1]
        return Voltage(state[0], slope, (command.slope - slope) * (self.pole() * follows))

    def on_segment_start(self, state: tuple[Scalar, ...], segment: Segment) -> tuple[Scalar, ...]:
        """The state just after the corner that opens `segment`, where the command may jump."""
        u, _ = state
        wanted = self.pole() * (segment.voltage(0.0).level - u)
        return u, jnp.where(jnp.abs(wanted) > self.slew, jnp.sign(wanted), 0.0)

    def guards(self, state: tuple[Term, ...], command: Voltage[Term]) -> tuple[Term, ...]:
        """Positive while the amplifier goes on following, or slewing."""
        u, slews = state
        wanted = (command.level - u) * self.pole()
        limited = slews * slews
        follows = 1.0 - limited
        upper = (self.slew - wanted) * follows + (slews * wanted - self.slew) * limited
        return upper, (self.slew + wanted) * follows + limited

    def after_event(self, state: tuple[Scalar, ...], which: Scalar) -> tuple[Scalar, ...]:
        """The state just after `guards(...)[which]` has fallen through zero."""
        u, slews = state
        return u, jnp.where(slews != 0.0, 0.0, jnp.where(which == 0, 1.0, -1.0))

    def steady(self, segment: Segment) -> Segment:
        """The voltage on the piezo late in a straight segment: that of the command, 1/w_a later."""
        return segment._replace(start=segment.start - segment.slope * (1.0 / self.pole()))

    def pole(self) -> ScalarLike:
        """Angular corner frequency w_a [rad/s]."""
        return 2.0 * jnp.pi * self.bandwidth


GRAVITY = 9.80665
"""Standard gravity g [m/s2]."""


class Effector(AbstractModel):
    """A mass that rides on the platform, held by friction alone (5.23), with its load and the platform's tilt.

        m_e x_e'' = F + load + m_e g sin(tilt) [ - what it meets in front of it ]

    Load and tilt set in at t = 0: until then the contact carries nothing, and an elastic one yields and rings then.
    With `rests_under_load` of the actuator they acted before, and it has come to rest under them.
    """

    mass: float = quantity(0.086, "kg")
    """Moving mass m_e [kg]."""
    load: float = quantity(0.0, "N", positive=False, optional=True)
    """Constant force on the end-effector, positive forward [N]."""
    tilt: float = quantity(0.0, "rad", positive=False, low=-1.5, high=1.5, optional=True)
    """Angle by which the forward direction points downhill [rad]."""

    def pull(self) -> Scalar:
        """The constant force on the end-effector, load and weight along the tilt, positive forward [N]."""
        return self.load + self.mass * GRAVITY * jnp.sin(jnp.asarray(self.tilt, float))


class Stop(AbstractModel):
    """A force sensor in the way: it can be pushed, but does not pull.

    P = k depth (1 + d depth'), which loses energy and yet begins and ends at zero force
    (K. H. Hunt and F. R. E. Crossley, J. Applied Mechanics 42(2), 1975).
    """

    stiffness: float = quantity(1e5, "N/m")
    """Contact stiffness k of the sensor with its mount [N/m]."""
    dissipation: float = quantity(10.0, "s/m", positive=False, low=0.0, optional=True)
    """Share d of the force that a unit of speed adds [s/m]; below the reciprocal of the fastest withdrawal."""
    gap: float = quantity(0.0, "m", positive=False, low=0.0, optional=True)
    """How far the end-effector goes before it meets the sensor [m]."""

    def push(self, x: Term, speed: Term) -> Term:
        """Force [N] on the sensor where the end-effector touches it, at `x` [m] and `speed` [m/s]."""
        return self.depth(x) * self.stiffness * (speed * self.dissipation + 1.0)

    def depth(self, x: Term) -> Term:
        """How far [m] the end-effector at `x` [m] has pushed the sensor; negative before it touches."""
        return x - self.gap


class Sensor(AbstractModel):
    """A displacement, velocity or force sensor: a first-order low-pass and a delay.

        s' = w_s (x - s),   seen at t: s(t - delay).

    The state is the lag e = x - s, which does not depend on how far the end-effector has moved: e' = x' - w_s e.  A
    sensor of velocity with the same low-pass shows s' = w_s e.
    """

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
        """Time derivative of the lag where the measured quantity changes at the rate `speed`."""
        return tuple(speed - e * self.pole() for e in sensor_lag)

    def steady(self, sensor_lag: tuple[Scalar, ...], speed: Scalar) -> tuple[Scalar, ...]:
        """The lag behind a quantity that has long changed at the rate `speed`."""
        return tuple(speed / self.pole() for _ in sensor_lag)

    def after_jump(self, sensor_lag: tuple[Scalar, ...], jump: Scalar) -> tuple[Scalar, ...]:
        """The lag after a jump of the measured quantity; the shown one does not jump."""
        return tuple(e + jump for e in sensor_lag)

    def shown_displacement(self, sensor_lag: tuple[Scalar, ...], true: Scalar) -> Scalar:
        """The displacement [m], or other quantity, that the sensor shows, `sensor_lag` behind."""
        return true - sensor_lag[0] if sensor_lag else true

    def shown_velocity(self, sensor_lag: tuple[Scalar, ...], true: Scalar) -> Scalar:
        """The velocity [m/s] that the sensor shows: the rate of the shown displacement, x' - e' = w_s e."""
        return sensor_lag[0] * self.pole() if sensor_lag else true

    def pole(self) -> ScalarLike:
        """Angular corner frequency w_s [rad/s]."""
        return 2.0 * jnp.pi * self.bandwidth


IDEAL = Sensor(filters=False)
"""Shows what is there when it is there."""


PARTS: dict[str, type] = {"effector": Effector, "stop": Stop, "amplifier": Amplifier, "sensor": Sensor}
"""The classes of the parts by name, as in "effector.mass"; their `quantity` fields are the parameters."""


_LATE = 1e-6
"""Part of an interval after its begin at which the voltage is read: a jump that falls on the begin is over then."""


class ZeroOrderHold(AbstractDrive):
    """`drive`, read once every `interval` and held until the next time; it jumps at every corner."""

    drive: AbstractDrive
    interval: float = quantity(50e-6, "s")
    """Time between two values [s]."""

    def segment(self, index: Scalar) -> Segment:
        index = jnp.asarray(index, float)
        return Segment(jnp.asarray(self.interval, float), self._read(index), jnp.zeros(()))

    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        # Rounding must not put the begin of an interval into the one before.
        return jnp.where(time < 0, 0.0, self._read(jnp.floor(time / self.interval + 1e-9)))

    def period(self) -> tuple[int, int] | None:
        # The period of the drive need not be a whole number of intervals.
        return None

    def cycle_frequency(self) -> ScalarLike | None:
        """Frequency of the held drive [Hz]: the staircase repeats but for where the intervals fall."""
        return self.drive.cycle_frequency()

    def has_jumps(self) -> bool:
        return True

    def peak(self) -> ScalarLike:
        """Peak of the held drive [V]: the staircase stays below by the change of the voltage in an interval."""
        return self.drive.peak()

    def flanks(self) -> Flanks | None:
        return self.drive.flanks()

    def slow_flank_times(self, parts: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        return self.drive.slow_flank_times(parts)

    def declared(self) -> dict[str, Quantity]:
        """Declared quantities of the held drive: the interval is a record's own."""
        return self.drive.declared()

    def numbers(self) -> dict[str, ScalarLike]:
        return self.drive.numbers()

    def with_numbers(self, numbers: Mapping[str, ScalarLike]) -> Self:
        return dataclasses.replace(self, drive=self.drive.with_numbers(numbers))

    def segments(self, until: float) -> int:
        return int(max(until, 0.0) / float(self.interval)) + 2

    def _read(self, index: Float[Array, "*n"]) -> Float[Array, "*n"]:
        return self.drive.at((index + _LATE) * self.interval)
