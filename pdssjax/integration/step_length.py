"""How long a step resolves what it shows: the motion, and what a system names besides.

The length follows from the last two coefficients of a series (À. Jorba and M. Zou, Experimental Mathematics 14(1),
2005).  How long derivatives can bear a step is said by `step_bound`.
"""

from collections.abc import Sequence

import jax.numpy as jnp

from ..core import Scalar, ScalarLike
from .step_methods.base import Piece
from .taylor_series import Series


def resolved_radius(series: Sequence[Sequence[ScalarLike]], units: Sequence[ScalarLike]) -> Scalar:
    """The length over which the last two of the coefficients stay below one unit."""
    lengths = []
    for k in (len(series[0]) - 2, len(series[0]) - 1):
        largest = 1e-100
        for coefficients, unit in zip(series, units, strict=True):
            largest = jnp.maximum(largest, jnp.abs(coefficients[k]) * unit)
        lengths.append(jnp.exp(jnp.log(largest) * (-1.0 / k)))
    return 0.95 * jnp.minimum(*lengths)


def shortened(piece: Piece, extra: Sequence[Series], tolerance: Scalar, opaque_one: Scalar) -> Piece:
    """As much of `piece` as also resolves the series `extra`, made of its polynomials, to `tolerance`."""
    size = len(piece.polynomials[0])
    rows = [[series[k] for k in range(size)] for series in extra]
    enough = jnp.minimum(resolved_radius(rows, [1.0 / tolerance] * len(rows)), piece.step_radius)
    return piece._replace(step_radius=enough / opaque_one)
