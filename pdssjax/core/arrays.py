"""Type names of numbers and arrays, and checks of arrays that a user gives, before JAX meets them.

Arrays say their shape as jaxtyping does, `Float[Array, " samples"]`.  A type checker sees what a number is (JAX's,
NumPy's or Python's), a reader also its shape.
"""

from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from .errors import InputError

Scalar: TypeAlias = Float[Array, ""]
"""One number of JAX, which may be traced."""

Count: TypeAlias = Int[Array, ""]
"""One whole number of JAX, which may be traced."""

Truth: TypeAlias = Bool[Array, ""]
"""Whether something holds, which may be traced."""

ScalarLike: TypeAlias = float | Scalar
"""One number, Python's or JAX's: what a field of a model holds."""

Document: TypeAlias = dict[str, Any]
"""Plain data as a JSON or TOML file holds it: what is in it is said where it is made."""

Given: TypeAlias = Any
"""What a user passes for a number or an array: of no known type until it has been checked."""

Tree: TypeAlias = Any
"""A pytree, or what a library passes along with one: its structure is its owner's."""


def on_device(tree: Tree) -> Tree:
    """The pytree with NumPy's arrays and numbers copied to the device, once and not at every call of a function."""
    return jax.tree.map(lambda leaf: jnp.asarray(leaf) if isinstance(leaf, np.ndarray | np.generic) else leaf, tree)


def ascending_times(name: str, given: Given) -> Float[Array | np.ndarray, " m"]:
    """The times [s] `given` for the argument `name`, as an array of floating point of shape (m,).

    **Raises:** `InputError` for another shape, for no time at all, for what is no finite number, and for times that
    descend.  Of traced times only the shape is known.
    """
    times = given if isinstance(given, Tracer) else _as_floats(name, given, "an array of times [s]")
    if times.ndim != 1 or not times.size:
        raise InputError(
            f"{name}: found the shape {times.shape}, expected one dimension, (m,), with a time [s] or more."
        )
    if isinstance(times, Tracer):
        return times.astype(float)
    if not np.isfinite(times).all():
        place = int(np.argmin(np.isfinite(times)))
        raise InputError(f"{name}: found {times[place]} at index {place}, expected finite times [s].")
    if (falls := np.diff(times) < 0.0).any():
        place = int(np.argmax(falls)) + 1
        found = f"{times[place]:.9g} s after {times[place - 1]:.9g} s at index {place}"
        raise InputError(f"{name}: found {found}, expected times that ascend.")
    return times


def _as_floats(name: str, given: Given, expected: str) -> Float[np.ndarray, "..."]:
    """What is `given` for the argument `name` as a NumPy array; **raises** `InputError` where it is no real numbers."""
    try:
        array = np.asarray(given)
    except (ValueError, TypeError) as error:
        raise InputError(f"{name}: found {given!r:.80}, expected {expected}.") from error
    if array.dtype.kind not in "iuf":
        raise InputError(f"{name}: found {given!r:.80}, expected {expected}.")
    return array.astype(float)
