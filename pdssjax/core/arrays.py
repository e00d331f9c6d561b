"""What numbers are called in annotations; arrays say their shape as jaxtyping does, `Float[Array, " samples"]`.

A type checker sees what a number is (JAX's, NumPy's or Python's), a reader also its shape.
"""

from typing import Any, TypeAlias

from jaxtyping import Array, Bool, Float, Int

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
