"""A system that begins in the midst of its motion: at the opening of a segment, in a given state."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, ScalarLike, Truth
from .system import AbstractHybridSystem, AnySegment, InputSegment, State, Term, unflattener
from .taylor_series import Series


class Restarted(AbstractHybridSystem):
    """`system` from the state `begin` on, just before the corner that opens segment number `first`.

    Its segments are counted from there.  The system tells the mode from the state: its `on_segment_start` is given
    mode 0, as at the start of any motion.
    """

    system: AbstractHybridSystem
    begin: Float[Array, " components"]
    """The components of the state, as its leaves stand."""
    first: ScalarLike

    def initial(self) -> State:
        return unflattener(self.system)([self.begin[i] for i in range(self.begin.shape[0])])

    def segment(self, index: Scalar) -> AnySegment:
        return self.system.segment(index + self.first)

    def field(self, segment: InputSegment, t_local: Term, x: State, mode: Scalar) -> State:
        return self.system.field(segment, t_local, x, mode)

    def guards(self, segment: InputSegment, t_local: Term, x: State, mode: Scalar) -> tuple[Term, ...]:
        return self.system.guards(segment, t_local, x, mode)

    def after_event(
        self, segment: InputSegment, t_local: ScalarLike, x: State, mode: Scalar, which: Scalar
    ) -> tuple[State, Scalar]:
        return self.system.after_event(segment, t_local, x, mode, which)

    def state_scale(self) -> State:
        return self.system.state_scale()

    def error_scale(self, x: State) -> State:
        return self.system.error_scale(x)

    def guards_along(
        self, segment: InputSegment, t_local: Term, x: State, mode: Scalar, size: int, length: Scalar
    ) -> tuple[tuple[Series, ...], int]:
        return self.system.guards_along(segment, t_local, x, mode, size, length)

    def rates(self, segment: InputSegment, t_local: Scalar, x: State, mode: Scalar) -> State:
        return self.system.rates(segment, t_local, x, mode)

    def on_segment_start(self, segment: InputSegment, x: State, mode: Scalar) -> tuple[State, Scalar]:
        return self.system.on_segment_start(segment, x, mode)

    @property
    def resets_at_corners(self) -> bool:
        return self.system.resets_at_corners

    def is_settled(
        self, segment: InputSegment, t_local: ScalarLike, x: State, mode: Scalar, tolerance: ScalarLike
    ) -> Truth:
        return self.system.is_settled(segment, t_local, x, mode, tolerance)

    def project_to_steady(self, segment: InputSegment, t_local: ScalarLike, x: State, mode: Scalar) -> State:
        return self.system.project_to_steady(segment, t_local, x, mode)

    def shifting_components(self) -> tuple[int, ...]:
        return self.system.shifting_components()

    def extra_error_terms(self, x: State, mode: Scalar) -> tuple[Term, ...]:
        return self.system.extra_error_terms(x, mode)

    def closed_components(self) -> tuple[int, ...]:
        return self.system.closed_components()

    def exact(self, segment: InputSegment, t_local: ScalarLike, begin: State, elapsed: Scalar, end: State) -> State:
        return self.system.exact(segment, t_local, begin, elapsed, end)

    def is_carried_back(self, slope: Scalar, mode: Scalar, which: Scalar, amplitude: float) -> Truth:
        return self.system.is_carried_back(slope, mode, which, amplitude)


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
