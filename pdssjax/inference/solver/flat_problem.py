"""A residual between bounds on any pytree as one of vectors, which is what the solver works on."""

from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

from ...core import InputError, Tree
from .trust_region import Bounds


def flat_bounds(y: Tree, options: Mapping[str, Tree]) -> Bounds:
    """The "lower" and "upper" of `options` as vectors; one that is left out is infinite.

    **Arguments:** each is a number for all of the point `y`, or a pytree of the structure of `y` whose leaves
    broadcast to those of `y`.

    **Raises:** `InputError` for another key, and for bounds of another structure or shape.
    """
    for key in options:
        if key not in ("lower", "upper"):
            raise InputError(f'options: found the key {key!r}, expected "lower" and "upper", the bounds.')
    ends = {"lower": -jnp.inf, "upper": jnp.inf} | dict(options)
    return {name: _vector(name, end, y) for name, end in ends.items()}


def _vector(name: str, end: Tree, y: Tree) -> Tree:
    leaves, structure = jax.tree.flatten(y)
    given, form = jax.tree.flatten(end)
    if form != structure and len(given) == 1 and jnp.ndim(given[0]) == 0:
        given, form = given * len(leaves), structure
    if form != structure:
        raise InputError(f'options["{name}"]: found the structure {form}, expected a number or {structure}, as of y0.')
    for bound, leaf in zip(given, leaves, strict=True):
        if not _broadcasts(jnp.shape(bound), jnp.shape(leaf)):
            raise InputError(f'options["{name}"]: found shape {jnp.shape(bound)}, expected {leaf.shape}, as of y0.')
    filled = [jnp.broadcast_to(jnp.asarray(a, b.dtype), b.shape) for a, b in zip(given, leaves, strict=True)]
    return filled[0] if is_vector(y) else ravel_pytree(filled)[0]


def _broadcasts(shape: tuple[int, ...], to: tuple[int, ...]) -> bool:
    missing = len(to) - len(shape)
    return missing >= 0 and all(a in (1, b) for a, b in zip(shape, to[missing:], strict=True))


def is_vector(y: Tree) -> bool:
    """Whether `y` is one array of one axis."""
    return hasattr(y, "ndim") and y.ndim == 1


def flat_function(fn: Callable[[Tree, Tree], Tree], unravel: Callable[[Tree], Tree]) -> Callable[[Tree, Tree], Tree]:
    """`fn` as a function of the vector that `unravel` makes a point of, with its residuals as one vector."""

    def flat(y: Tree, args: Tree) -> Tree:
        out, aux = fn(unravel(y), args)
        return (out if is_vector(out) else ravel_pytree(out)[0]), aux

    return flat


def flat_point(y: Tree) -> tuple[Tree, Callable[[Tree], Tree]]:
    """`y` as a vector, and what makes a point of such a vector again."""
    return (y, lambda vector: vector) if is_vector(y) else ravel_pytree(y)
