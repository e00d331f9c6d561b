"""Sums, products and choices of traced numbers, as jax.numpy has them, but traced several times as fast.

The code of a step holds some thousand operations on scalars, and `x * y` of two traced numbers passes through
layers of jax.numpy that sort out types and shapes, which here are nearly always the same already.  What is not goes
the usual way.  The operations that come out are the same.
"""

from typing import Any, TypeAlias

import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

Operand: TypeAlias = Any
"""A number or an array of any shape, traced or not: the result is of the kind that jax.numpy would give."""


def plus(x: Operand, y: Operand) -> Operand:
    """x + y."""
    pair = _of_one_shape(x, y)
    return x + y if pair is None else lax.add(*pair)


def times(x: Operand, y: Operand) -> Operand:
    """x y."""
    pair = _of_one_shape(x, y)
    return x * y if pair is None else lax.mul(*pair)


def choose(condition: Operand, x: Operand, y: Operand) -> Operand:
    """x where the condition holds, else y; both and the condition of one shape, or numbers."""
    pair = _of_one_shape(x, y)
    if pair is None or not isinstance(condition, Tracer) or condition.shape != np.shape(pair[0]):
        return jnp.where(condition, x, y)
    return lax.select(condition, *pair)


def _of_one_shape(x: Any, y: Any) -> tuple[Any, Any] | None:
    """Both with one shape and type, at least one of them traced; None where that takes more than a look."""
    if isinstance(x, Tracer):
        if isinstance(y, Tracer):
            return (x, y) if x.shape == y.shape and x.dtype == y.dtype else None
        return (x, _like(x, y)) if isinstance(y, float) and x.dtype.kind == "f" else None
    other = _of_one_shape(y, x) if isinstance(y, Tracer) else None
    return None if other is None else other[::-1]


def _like(traced: Any, number: float) -> Any:
    if traced.shape:
        return lax.full_like(traced, number)
    return np.asarray(number, traced.dtype)
