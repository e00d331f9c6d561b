"""The interface of every voltage waveform: a chain of smooth segments."""

import abc
from collections.abc import Mapping
from typing import Generic, NamedTuple, Self, overload

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..core import AbstractModel, Quantity, Scalar, ScalarLike, as_number, kept_jit, quantities
from ..integration import N_co, Term, cosine_and_sine


class Voltage(NamedTuple, Generic[N_co]):
    """The voltage on the piezo at a time; numbers or series."""

    level: N_co
    """[V]"""
    slope: N_co
    """Slope of the voltage [V/s]."""
    bend: N_co
    """Second derivative of the voltage [V/s2]."""


class Wave(NamedTuple):
    """A harmonic part of a segment: amplitude * cos(rate * t_local + phase)."""

    amplitude: ScalarLike
    """[V]"""
    rate: ScalarLike
    """[rad/s]"""
    phase: ScalarLike
    """Phase at the beginning of the segment [rad]."""


class Segment(NamedTuple):
    """A stretch of drive between two corners; within it the voltage is a straight line.

    Waveforms that are curved add a harmonic to the line.
    """

    duration: Float[Array, ""]
    """Length [s]; zero for a jump, infinite for the last one."""
    start: Float[Array, ""]
    """Voltage just after the corner that opens the segment, without the wave [V].

    Of a segment of zero length the mean of both ends: what a short one gives a stack and an amplifier that are
    linear, so that derivatives with respect to its length are right at zero, too.  With hysteresis, asymmetry or a
    slew rate they are not: what counts there is the mean along the way, not what the mean voltage does.
    """
    slope: Float[Array, ""]
    """Rate of the voltage, without the wave [V/s]."""
    wave: Wave | None = None

    @overload
    def voltage(self, t_local: ScalarLike) -> Voltage[Scalar]: ...
    @overload
    def voltage(self, t_local: Term) -> Voltage[Term]: ...
    def voltage(self, t_local: Term) -> Voltage[Term]:
        """The voltage `t_local` [s] into the segment, a number or a series."""
        if self.wave is None:
            return Voltage(self.start + self.slope * t_local, self.slope, 0.0)
        amplitude, rate, phase = self.wave
        cosine, sine = cosine_and_sine(phase + rate * t_local)
        return Voltage(
            self.start + self.slope * t_local + amplitude * cosine,
            self.slope - amplitude * rate * sine,
            -1.0 * amplitude * rate * rate * cosine,
        )


class Flanks(NamedTuple):
    """The two flanks of a cycle: a slow one, on which the end-effector is to stick, and a fast one."""

    slope: ScalarLike
    """Mean rate of the slow flank [V/s], positive where it rises."""
    fast: ScalarLike
    """Duration of the fast flank [s]; zero where it is ideal."""


class AbstractDrive(AbstractModel):
    """A voltage against time, from t = 0 on; before that the piezo is at 0 V and at rest."""

    @abc.abstractmethod
    def segment(self, index: Scalar) -> Segment:
        """The segment `index` = 0, 1, 2, …; may be traced and differentiated."""

    @abc.abstractmethod
    def at(self, time: Float[Array, " n"]) -> Float[Array, " n"]:
        """The voltage [V] at times [s] from the start of the drive; 0 before it."""

    @abc.abstractmethod
    def period(self) -> tuple[int, int] | None:
        """`(first, count)`: from segment `first` on, the drive repeats every `count` segments.

        None where it never does.
        """

    @abc.abstractmethod
    def cycle_frequency(self) -> ScalarLike | None:
        """Cycles a second [Hz], a number; None where the waveform has no cycle."""

    @abc.abstractmethod
    def has_jumps(self) -> bool:
        """Whether the voltage jumps, at t = 0 or later; not traced."""

    def has_corners(self) -> bool:
        """Whether the voltage or its rate jumps, at t = 0 or later; not traced."""
        return True

    def with_peak_voltage(self) -> Self:
        """This drive with its peak as the number "voltage", as a generator is set; not traced.

        By default as it is.
        """
        return self

    @abc.abstractmethod
    def peak(self) -> ScalarLike:
        """Largest magnitude that the voltage takes or tends to [V], a number."""

    def flanks(self) -> Flanks | None:
        """The slow and the fast flank of the cycle; None, the default, where a waveform has no such flanks."""
        return None

    def slow_flank_times(self, parts: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """Times at which the slow flank has covered `parts` of its voltage, in parts of its duration [1].

        The same where the flank is straight, the default.
        """
        return parts

    def broken_conditions(self) -> dict[str, str]:
        """Conditions between numbers that are broken, by field: "0.6 s, expected less than the period, 0.5 s".

        Not under `jit`: it reads the numbers.
        """
        idle = self.numbers().get("voltage") == 0
        return {"voltage": "0 V, expected the voltage that moves the actuator"} if idle else {}

    @classmethod
    def examples(cls) -> tuple[Self, ...]:
        """Waveforms of this kind that differ in more than their numbers; `tests/drive` checks each of them."""
        return (cls(),)

    def declared(self) -> dict[str, Quantity]:
        """Declared quantities of the numbers that describe the drive, by field; none where samples do."""
        return quantities(type(self))

    def numbers(self) -> dict[str, ScalarLike]:
        """The number [SI] of every `declared` field."""
        return {field: getattr(self, field) for field in self.declared()}

    def with_numbers(self, numbers: Mapping[str, ScalarLike]) -> Self:
        """The drive with other numbers [SI] in some of the `declared` fields; may be traced."""
        pick = lambda drive: [getattr(drive, field) for field in numbers]
        return eqx.tree_at(pick, self, [as_number(number) for number in numbers.values()]) if numbers else self

    def segments(self, until: float) -> int:
        """Number of segments that begin by the time `until` [s], or a few more; not traced."""
        cycle = self.period()
        if cycle is None:
            return 2
        first, every = cycle
        numbers = jax.tree.map(lambda leaf: np.asarray(leaf, float), self)
        duration = float(np.sum(_durations(numbers, np.arange(first, first + every))))
        return first + every * (int(max(until, 0.0) / duration) + 2)

    def sampled_at(self, time: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        """The voltage [V] `at` times [s], as NumPy's; compiled for few numbers of times, not traced."""
        count = time.size
        room = (1 << max(count - 1, 0).bit_length()) - count
        return np.asarray(_at(self, np.concatenate([time, np.zeros(room)])))[:count]


@kept_jit
def _at(drive: AbstractDrive, time: Float[np.ndarray, " n"]) -> Float[Array, " n"]:
    return jnp.broadcast_to(drive.at(jnp.asarray(time)), time.shape)


@kept_jit
def _durations(drive: AbstractDrive, indices: Int[np.ndarray, " n"]) -> Float[Array, " n"]:
    """Durations of some segments [s], compiled as one: each operation by itself costs as much."""
    return jax.vmap(lambda index: drive.segment(index).duration)(indices)
