"""The interface of every step method: one smooth step of a solver, as polynomials in time.

Inside a mode the field is smooth.  A method advances it by one step and gives the step as a polynomial,
in which events are located and samples are read off.
"""

import abc
from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple

import equinox as eqx
from jaxtyping import Array, Float

from ...core import Scalar, Truth
from ..polynomials import Polynomials
from ..taylor_series import Field


class Piece(NamedTuple):
    """An attempted step."""

    polynomials: Polynomials
    step_size: Scalar
    """Length for which the polynomials hold [s]."""
    accepted: Truth
    next_proposed_step: Scalar
    """A length to try for the next step [s]."""


class KnownStep(NamedTuple):
    """A step whose length is known, but not its polynomials."""

    field: Field
    t_local: Scalar
    """Local time at its start [s]."""
    x: list[Scalar]
    """State at its start."""
    error_weights: list[Scalar]
    step_size: Scalar
    """Length for which the polynomials hold [s]."""


class AbstractStepMethod(eqx.Module):
    """A way to advance a smooth piece of the motion by one step.

    The state `x` is a list of scalars, and so are the `error_weights`, which turn each component into tolerances.
    `opaque_one` is a 1 unknown to the compiler: see `taylor_series`.
    """

    velocity_noise: ClassVar[float]
    """Amplitude in tolerances below which the sign of a velocity means nothing: its reversals are not events."""
    second_derivative_factor: ClassVar[float]
    """Factor on the tolerances for second derivatives; below it rounding would decide how long a step is."""

    @property
    @abc.abstractmethod
    def span(self) -> float:
        """Time constants of the quickest transient that a step may span, so that derivatives do not grow over it."""

    @abc.abstractmethod
    def attempt(
        self,
        field: Field,
        t_local: Scalar,
        x: Sequence[Scalar],
        error_weights: Sequence[Scalar],
        remaining: Scalar,
        proposed_step: Scalar,
        opaque_one: Scalar,
    ) -> Piece:
        """A step from `x` at time `t_local`, over `remaining` [s] at most; `proposed_step` [s] is a suggestion."""

    @abc.abstractmethod
    def expand(
        self, step: Callable[..., KnownStep], *rows: Float[Array, "rows ..."]
    ) -> list[Float[Array, "coefficients rows"]]:
        """The polynomials of many steps at once, differentiable.

        **Arguments:** `step` makes a step from one row of each of the `rows`.

        **Returns:** for each component the coefficients in the time [s], lowest first, shape (degree + 1, rows), in
        the unit of the component.
        """
