"""Polynomials in theta, the share of a step that has elapsed: evaluated, and rescaled to another length."""

from collections.abc import Sequence
from typing import TypeAlias

import jax.numpy as jnp
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..core import Scalar, ScalarLike
from .traced_arithmetic import plus, times

Polynomials: TypeAlias = list[list[Scalar]]
"""For each component the coefficients in theta = elapsed/step_radius, lowest first."""


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
