"""Polynomials in the time since a step began: their values, and the ones through values at Chebyshev points of [0, 1].

The way from values to powers leads through Chebyshev polynomials: values give their coefficients without loss of
digits, and they have whole coefficients themselves.  The inverse of a Vandermonde matrix would lose digits.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple, TypeAlias, cast

import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from ..core import ScalarLike
from .tracing import plus, times

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


class Basis(NamedTuple):
    """Points, and the matrices that belong to them."""

    nodes: Float[np.ndarray, " nodes"]
    """The points from 0 to 1, both included."""
    to_chebyshev: Float[np.ndarray, "nodes nodes"]
    """Matrix from values at the nodes to coefficients of Chebyshev polynomials."""
    to_powers: Float[np.ndarray, "nodes nodes"]
    """Matrix from these to coefficients of powers, lowest first."""
    integral: Float[np.ndarray, "nodes nodes"]
    """Matrix from values at the nodes to integrals from 0 to each of them."""

    def powers(self, values: Float[Array, "nodes components"]) -> Float[Array, "nodes components"]:
        """Coefficients of the powers, lowest first, of the polynomials through `values`."""
        return jnp.asarray(self.to_powers) @ (jnp.asarray(self.to_chebyshev) @ values)


@cache
def basis(degree: int) -> Basis:
    """The points and matrices of polynomials of a `degree`."""
    number = np.arange(degree + 1)
    angles = np.pi * (1.0 - number / degree)
    half = np.where(np.isin(number, (0, degree)), 0.5, 1.0)
    to_chebyshev = 2.0 / degree * half[:, None] * half * np.cos(np.outer(number, angles))
    shifted = [np.polynomial.Polynomial([1.0]), np.polynomial.Polynomial([-1.0, 2.0])]
    for _ in range(degree - 1):
        shifted.append(2.0 * shifted[1] * shifted[-1] - shifted[-2])
    to_powers = np.zeros((degree + 1, degree + 1))
    for k, chebyshev in enumerate(shifted[: degree + 1]):
        to_powers[: k + 1, k] = chebyshev.coef
    integrated = np.polynomial.chebyshev.chebint(to_chebyshev, lbnd=-1.0, scl=0.5)
    integral = np.polynomial.chebyshev.chebval(np.cos(angles), integrated).T
    integral[0] = 0.0
    return Basis(0.5 + 0.5 * np.cos(angles), to_chebyshev, to_powers, integral)
