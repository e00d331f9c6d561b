"""The interface of every step method: one smooth step of a solver, as polynomials in time.

Inside a mode the field is smooth.  A method advances it by one step and gives the step as a polynomial,
in which events are located and samples are read off.
"""

import abc
from collections.abc import Callable, Sequence
from typing import ClassVar, NamedTuple, TypeAlias

import equinox as eqx
import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ...core import Scalar, ScalarLike, Truth
from ..taylor_series import Field, Series
from ..traced_arithmetic import plus, times

Polynomials: TypeAlias = list[list[Scalar]]
"""For each component the coefficients in theta = elapsed/step_radius, lowest first."""


class Piece(NamedTuple):
    """A step that was attempted."""

    polynomials: Polynomials
    step_radius: Scalar
    """Length for which the polynomials hold [s]."""
    accepted: Truth
    next_proposed_step: Scalar
    """A length to try for the next step [s]."""


class KnownStep(NamedTuple):
    """A step of which the length is known, but no polynomial."""

    field: Field
    t_local: Scalar
    """Local time at its start [s]."""
    x: list[Scalar]
    """State at its start."""
    units: list[Scalar]
    step_radius: Scalar
    """Length for which the polynomials hold [s]."""


class AbstractStepMethod(eqx.Module):
    """How a smooth piece is advanced.

    The state `x` is a scalar a component, and so are the `units` that turn each component into tolerances.
    `opaque_one` is a 1 unknown to the compiler: see `taylor_series`.
    """

    noise: ClassVar[float]
    """Tolerances below which the sign of a small velocity means nothing: its reversals are not events."""

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
        units: Sequence[Scalar],
        remaining: Scalar,
        proposed_step: Scalar,
        opaque_one: Scalar,
    ) -> Piece:
        """A step from `x` at time `t_local`, over `remaining` [s] at most; `proposed_step` [s] is asked for."""

    @abc.abstractmethod
    def expand(
        self, step: Callable[..., KnownStep], *rows: Float[Array, "rows ..."]
    ) -> list[Float[Array, "coefficients rows"]]:
        """Many steps again, side by side and differentiable.

        `step` says from one row of each of `rows` which step it is.

        **Returns:** for each component the coefficients in theta, lowest first, shape (degree + 1, rows).
        """


def shortened(piece: Piece, extra: Sequence[Series], tolerance: Scalar, opaque_one: Scalar) -> Piece:
    """As much of `piece` as also resolves the series `extra`, made of its polynomials, to `tolerance`."""
    size = len(piece.polynomials[0])
    rows = [[series[k] for k in range(size)] for series in extra]
    part = jnp.minimum(resolved_radius(rows, [1.0 / tolerance] * len(rows)), 1.0) / opaque_one
    return piece._replace(polynomials=rescaled(piece.polynomials, part), step_radius=piece.step_radius * part)


def resolved_radius(series: Sequence[Sequence[ScalarLike]], units: Sequence[ScalarLike]) -> Scalar:
    """The length over which the last two of the coefficients stay below one unit."""
    lengths = []
    for k in (len(series[0]) - 2, len(series[0]) - 1):
        largest = 1e-100
        for coefficients, unit in zip(series, units, strict=True):
            largest = jnp.maximum(largest, jnp.abs(coefficients[k]) * unit)
        lengths.append(jnp.exp(jnp.log(largest) * (-1.0 / k)))
    return 0.95 * jnp.minimum(*lengths)


def horner(coefficients: Sequence[Float[Array, "*shape"]], theta: Float[ArrayLike, "*shape"]) -> Float[Array, "*shape"]:
    """The polynomial with the given coefficients, lowest first, at `theta`."""
    total = coefficients[-1]
    for coefficient in coefficients[-2::-1]:
        total = plus(times(total, theta), coefficient)
    return total


def rescaled(series: Sequence[Sequence[ScalarLike]], step_radius: Scalar) -> Polynomials:
    powers = [jnp.ones_like(step_radius)]
    for _ in range(len(series[0]) - 1):
        powers.append(times(powers[-1], step_radius))
    return [[times(c, p) for c, p in zip(row, powers, strict=True)] for row in series]
