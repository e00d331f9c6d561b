"""The interface of every model of the piezo stack with its platform.

A linear model without friction feedback is known in closed form between two corners of
the drive, and the integrator takes it from there.  Everything else is integrated along
with the contact.  A model that changes its form (the sliding elements of a hysteresis)
does so by flags, guards and `after_event`, as a friction law does.
"""

import abc
from collections.abc import Mapping
from typing import ClassVar, NamedTuple, TypeAlias

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..core import AbstractModel, Declared, Scalar, ScalarLike, quantities
from ..drive.base import Segment, Voltage
from ..integration import N, Term

State: TypeAlias = tuple[Scalar, ...]
"""State of a stack: one scalar a component."""

Terms: TypeAlias = tuple[Term, ...]
"""A component of a rate: a number, or a series."""

USUAL_SWING = 80.0
"""Voltage [V] over which a stack is driven that has the nominal parameters of a hysteresis."""


class Shown(NamedTuple):
    """Features of a stack read from records before any fit; None where they do not show it."""

    gain: float | None = None
    """Displacement per volt [m/V]."""
    natural_frequency: float | None = None
    """Natural frequency of the first mode [rad/s]."""
    damping_ratio: float | None = None
    """Damping ratio of the first mode [1]."""
    swing: float | None = None
    """Difference of the highest and the lowest voltage [V]."""
    duration: float | None = None
    """Duration of the longest record [s]."""
    interval: float | None = None
    """Sample interval of the finest record [s]."""


class DeterminableRange(NamedTuple):
    """Range [SI] in which records can determine a parameter."""

    low: float
    high: float
    why_low: str
    """Meaning of the lower end, in words."""
    why_high: str
    """Meaning of the upper end, in words."""


_LOOK_AHEAD = 1e-9
"""Time [s] by which the direction of a voltage at its turning point is told."""


def slew_sign(voltage: Voltage[Scalar], before: ScalarLike) -> Scalar:
    """1 where a voltage rises or is about to, -1 where it falls; `before` where it stays."""
    slope = voltage.slope + _LOOK_AHEAD * voltage.bend
    return jnp.where(slope > 0.0, 1.0, jnp.where(slope < 0.0, -1.0, before))


class AbstractPiezo(AbstractModel):
    """Platform displacement y [m] under a voltage; the state is a tuple of scalars.

    `rate`, `platform`, `acceleration` and `guards` use + - * / and the functions of
    `pdssjax.integration.taylor_series`: then the Taylor integrator can expand them.
    """

    closed: ClassVar[bool] = False
    """`motion` is exact on straight segments without friction feedback."""
    closed_on_lines: ClassVar[bool] = False
    """`motion` is exact on straight segments without friction feedback, through all guards; waves are stepped."""
    has_steady_state: ClassVar[bool] = True
    """Whether every motion on a straight segment soon tends to `steady`.

    The state then consists of pairs (displacement [m], velocity [m/s]), whose displacements
    creep along steadily in the end.  A model that creeps or remembers for long says False,
    and every moment of it is integrated.
    """

    is_compliant: ClassVar[bool] = True
    """A force moves the platform: friction can act back on it."""

    mechanical: ClassVar[tuple[str, ...]] = ("natural_frequency", "damping_ratio")
    """Parameters of the mechanics, if it has them: how the motion follows in time."""

    hysteretic: ClassVar[tuple[str, ...]] = ()
    """Parameters of its hysteresis."""

    loop_numbers: ClassVar[tuple[str, ...] | None] = None
    """Thresholds and times on which `loop_columns` depend; None where the model has no such columns."""

    mass: eqx.AbstractVar[Declared]
    """Moving mass that a force on the platform accelerates at first, a number [kg]; only feedback (5.25) uses it."""

    @abc.abstractmethod
    def initial(self) -> State:
        """The state at 0 V and at rest."""

    @abc.abstractmethod
    def rate(self, state: Terms, voltage: Voltage[Term], force: Term) -> Terms:
        """Time derivative of the state with `force` [N] on the platform; the integer 0 for flags."""

    @abc.abstractmethod
    def platform(self, state: tuple[N, ...]) -> tuple[N, N]:
        """Displacement y [m] and velocity y' [m/s] of the platform."""

    @abc.abstractmethod
    def acceleration(self, state: Terms, voltage: Voltage[Term]) -> Term:
        """y'' [m/s2] without friction; a force F on the platform adds F / `mass`."""

    @abc.abstractmethod
    def steady(self, state: State, segment: Segment, t_local: ScalarLike, force: ScalarLike) -> State:
        """The state to which the platform tends, `t_local` [s] into a straight segment.

        `force` [N] acts on the platform constantly.  May be `state` where `has_steady_state` is False.
        """

    @abc.abstractmethod
    def error_scale(self) -> State:
        """Displacement [m] that one unit of each state stands for: the scale of its error."""

    @abc.abstractmethod
    def static_gain(self) -> Scalar:
        """Displacement [m/V] that a slow volt gives: the scale of the voltage's error."""

    @abc.abstractmethod
    def frequency_scale(self) -> Scalar:
        """The fastest angular frequency [rad/s]: the scale between velocity and displacement."""

    def broken_conditions(self) -> tuple[str, ...]:
        """What the parameters must obey together and do not, a clause each such as "|gamma| is 0.1, above beta, 0.03".

        Not under `jit`: it reads the numbers.
        """
        return ()

    @classmethod
    def first_guess(cls, shown: Shown, known: Mapping[str, float]) -> dict[str, float]:
        """Where a fit of this model's parameters may start, by their names, as far as records show them.

        **Arguments:** `shown` is what the records say of any stack; `known` numbers of this one, by
        name, are given.
        """
        guess = {
            "gain": shown.gain,
            "natural_frequency": shown.natural_frequency,
            "damping_ratio": shown.damping_ratio,
        }
        return {name: number for name, number in guess.items() if number is not None and name in quantities(cls)}

    @classmethod
    def loop_columns(
        cls, time: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"], numbers: Mapping[str, float]
    ) -> dict[str, Float[np.ndarray, " n"]]:
        """The motion [m] at `time` [s] per unit of each linear parameter under `volts` [V], without mechanics.

        From rest at 0 V before t = 0, by NumPy: where a fit of many elements may start is found by it.

        **Arguments:** `numbers` of `loop_numbers`.
        """
        raise NotImplementedError(f"{cls.__name__} has no columns of loops")

    @classmethod
    def determinable_ranges(cls, shown: Shown) -> dict[str, DeterminableRange]:
        """Ranges in which records can determine parameters of this model, by name; without those always determined.

        Beyond, such a parameter does what others do: an element of creep much quicker than the samples is a part of the
        gain.  Fits stay within, where a study gives no bound.
        """
        return {}

    def motion(self, state: State, segment: Segment, t_local: ScalarLike, elapsed: ScalarLike) -> State:
        """Where `closed`: the exact state `elapsed` [s] later, `t_local` [s] into a segment; no force."""
        raise NotImplementedError(f"{type(self).__name__} knows no closed form")

    def states_on_lines(
        self, segments: Segment, places: Int[Array, " m"], t_local: Float[Array, " m"]
    ) -> tuple[Float[Array, " m"], ...]:
        """Where `closed_on_lines`: the states at m moments, from `initial` on; no force.

        **Arguments:** the first `segments` of the drive, arrays of shape (k,), and the `places` among them, `t_local`
        [s] after whose begin the moments are.
        """
        raise NotImplementedError(f"{type(self).__name__} knows no closed form")

    def on_segment_start(self, state: State, segment: Segment) -> State:
        """The state just after the corner that opens `segment`, where the voltage may jump."""
        return state

    def guards(self, state: Terms, voltage: Voltage[Term]) -> Terms:
        """Positive while the model keeps its form; always as many, in the same order.

        None, or first the slope of the voltage [V/s], times its sign before, then voltages [V].
        """
        return ()

    def after_event(self, state: State, voltage: Voltage[Scalar], which: Scalar) -> State:
        """The state just after `guards(...)[which]` has fallen through zero."""
        return state
