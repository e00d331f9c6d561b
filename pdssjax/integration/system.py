"""What the integrator asks of a hybrid system, and the mode that every one of them shares."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

SETTLED = 2.0
"""The mode of a system that has settled until the next corner; no guard ends it."""


def initial_state_and_mode(system: Any) -> tuple[Any, Any]:
    """State and mode in which the first segment begins."""
    zero = jnp.zeros(())
    return system.enter(system.segment(zero), system.initial(), zero)


def field_of(system: Any, segment: Any, unflatten: Callable, mode: Any) -> Callable:
    """The field of one mode on lists of scalars, as the methods want it."""
    return lambda t_local, x: jax.tree.leaves(system.field(segment, t_local, unflatten(x), mode))


def unflattener(system: Any) -> Callable:
    """Makes a state of `system` from its components."""
    tree = jax.tree.structure(system.initial())
    return lambda leaves: jax.tree.unflatten(tree, list(leaves))
