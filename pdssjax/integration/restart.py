"""A system that begins in the midst of its motion: at the opening of a segment, in a given state."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, ScalarLike
from .system import AbstractHybridSystem, AnySegment, State, unflattener


def _delegated(name: str) -> Any:
    """The method `name` of the `system`."""

    def method(self: "Restarted", *args: Any) -> Any:
        return getattr(self.system, name)(*args)

    return method


class Restarted(AbstractHybridSystem):
    """`system` from the state `begin` on, just before the corner that opens segment number `first`.

    Its segments are counted from there, and none repeat.  The system finds the mode from the state: its
    `on_segment_start` gets mode 0, as at the start of any motion.
    """

    system: AbstractHybridSystem
    begin: Float[Array, " components"]
    """The components of the state, as its leaves stand."""
    first: ScalarLike

    def initial(self) -> State:
        return unflattener(self.system)([self.begin[i] for i in range(self.begin.shape[0])])

    def segment(self, index: Scalar) -> AnySegment:
        return self.system.segment(index + self.first)

    field = _delegated("field")
    guards = _delegated("guards")
    guards_along = _delegated("guards_along")
    after_event = _delegated("after_event")
    state_scale = _delegated("state_scale")
    error_scale = _delegated("error_scale")
    extra_error_terms = _delegated("extra_error_terms")
    rates = _delegated("rates")
    on_segment_start = _delegated("on_segment_start")
    is_settled = _delegated("is_settled")
    project_to_steady = _delegated("project_to_steady")
    shifting_components = _delegated("shifting_components")
    closed_components = _delegated("closed_components")
    exact = _delegated("exact")
    is_carried_back = _delegated("is_carried_back")

    @property
    def resets_at_corners(self) -> bool:
        return self.system.resets_at_corners


def flat(x: State) -> Float[Array, " components"]:
    """The components of a state as a vector."""
    return jnp.stack([jnp.asarray(leaf, float) for leaf in jax.tree.leaves(x)])


def restarted(system: AbstractHybridSystem, x: Float[Array, " components"]) -> Restarted:
    """`system` from the state `x` on, just before the corner that opens a period of its input.

    **Raises:** `ValueError` for a system whose input never repeats.
    """
    period = system.period()
    if period is None:
        raise ValueError("Expected a system whose input repeats, but its period is None.")
    return Restarted(system, x, float(period[0]))
