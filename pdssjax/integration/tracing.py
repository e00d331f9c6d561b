"""Means to trace and to compile faster.

`plus`, `times` and `choose` are those of jax.numpy, traced several times as fast.  The code of a step holds some
thousand operations on scalars, and `x * y` of two traced numbers passes through layers of jax.numpy that sort out
types and shapes, which here are nearly always the same already.  Other operands go the usual way.  The operations that
come out are the same.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias, TypeVar, TypeVarTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.core import Tracer

from ..core import Truth

Arguments = TypeVarTuple("Arguments")
Result = TypeVar("Result")
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


def choose_each(condition: Truth | bool, x: Result, y: Result) -> Result:
    """x where the condition, a number, holds, else y: pytrees of one structure."""
    return jax.tree.map(lambda a, b: jnp.where(condition, a, b), x, y)


def _of_one_shape(x: Any, y: Any) -> tuple[Any, Any] | None:
    """Both with one shape and type, at least one of them traced; None where that takes more than a look."""
    if isinstance(x, Tracer):
        if isinstance(y, Tracer):
            return (x, y) if x.shape == y.shape and x.dtype == y.dtype else None
        if not (isinstance(y, float) and x.dtype.kind == "f"):
            return None
        return x, lax.full_like(x, y) if x.shape else np.asarray(y, x.dtype)
    other = _of_one_shape(y, x) if isinstance(y, Tracer) else None
    return None if other is None else other[::-1]


traced_once = partial(jax.jit, inline=True)
"""Decorator of a function whose shapes are asked for before a loop or a branch calls it: one trace serves both."""


def zeros_of(function: Callable[[*Arguments], Result], *args: *Arguments) -> Result:
    """Zeros like the arrays of `function(*args)`, which is not computed."""
    return jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), jax.eval_shape(function, *args))


def computed_once(true: Truth | bool, function: Callable[[*Arguments], Result], *args: *Arguments) -> Result:
    """`function(*args)`, kept apart where XLA would fuse it into, and so repeat it in, every place that needs it.

    `true` holds in a way that the compiler cannot know: a branch is compiled as a whole.
    """
    function = traced_once(function)
    return lax.cond(true, function, lambda *args: zeros_of(function, *args), *args)
