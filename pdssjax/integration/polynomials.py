"""Polynomials in the time [s] since a step's begin."""

from collections.abc import Sequence
from typing import Any, TypeAlias, cast

from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..core import ScalarLike
from .traced_arithmetic import plus, times

Polynomials: TypeAlias = list[list[ScalarLike]]
"""For each component the coefficients, lowest first."""


def horner(
    coefficients: Sequence[Float[ArrayLike, "*shape"]], time: Float[ArrayLike, "*shape"]
) -> Float[Array, "*shape"]:
    """The polynomial with the given coefficients, lowest first, at a `time`."""
    total = cast("Any", coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total = plus(times(total, time), coefficient)
    return total
