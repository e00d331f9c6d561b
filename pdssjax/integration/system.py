"""The contract of a hybrid system: what the integrator requires of the systems that it integrates."""

import abc
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, Protocol, TypeAlias, cast

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ..core import Scalar, ScalarLike, Truth
from .taylor_series import Field, Series, Term

SETTLED = 2.0
"""The mode of a system that has settled until the next corner; no guard ends it."""

State: TypeAlias = Any
"""A pytree of scalars, its displacements in m; a component that does not change with time has the rate 0.

Its leaves are a `Term` each in `field` and `guards`, else a `Scalar` each.  Every system has a structure of its own.
"""

InputSegment: TypeAlias = Any
"""An `AnySegment`, as the system's own `segment` returns it, with further fields of the system's own."""

Unflatten: TypeAlias = Callable[[Iterable[Any]], State]
"""Makes a state from its components."""


class AnySegment(Protocol):
    """A stretch of a system's input between two corners, within which the input is smooth."""

    @property
    def duration(self) -> Scalar:
        """Length [s], a scalar; zero for a jump, infinite for the last one."""
        ...


class SampledStates(NamedTuple):
    """The states of a motion at many times; every leaf has the axis of the times first."""

    x: State
    """One array for each component, shape (m,)."""
    segment: InputSegment
    t_local: Float[Array, " m"]
    """Local time [s]."""
    mode: Float[Array, " m"]


class AbstractHybridSystem(eqx.Module):
    """A motion that is smooth within each of its modes, and the events that end a mode.

    The state is a pytree of scalars, the same in every mode.  A mode is a float; `SETTLED` is one that
    every system has.  Time runs from the last corner of the input on: `t_local` [s], inside a `segment`.
    `field`, `guards`, `extra_error_terms` and what they call take state and time as scalars or as `Series`, so
    they are built of + - * / and the functions that `pdssjax.integration` exports; the other methods take scalars.
    Derivatives can be taken by every floating-point leaf of the system.

    Only the abstract methods are required.  The others add knowledge of the system that saves steps.
    """

    @abc.abstractmethod
    def initial(self) -> State:
        """The state at t = 0, before the first segment begins."""

    @abc.abstractmethod
    def segment(self, index: Scalar) -> AnySegment:
        """The segment of number `index`, a float from 0 on that may be traced: a pytree with a `duration` [s]."""

    @abc.abstractmethod
    def field(self, segment: InputSegment, t_local: Term, x: State, mode: Scalar) -> State:
        """The time derivative of the state in `mode`, each component in its unit a second; in `SETTLED`, too."""

    @abc.abstractmethod
    def guards(self, segment: InputSegment, t_local: Term, x: State, mode: Scalar) -> tuple[Term, ...]:
        """Numbers of any scale, positive inside the mode, which ends where the first of them falls through zero.

        As many in every mode; may be none.
        """

    @abc.abstractmethod
    def after_event(
        self, segment: InputSegment, t_local: ScalarLike, x: State, mode: Scalar, which: Scalar
    ) -> tuple[State, Scalar]:
        """State and mode after guard number `which`, a float, has reached zero; not called where there is no guard."""

    @abc.abstractmethod
    def state_scale(self) -> State:
        """Displacement [m] that one unit of each component stands for: tolerances are displacements."""

    def error_scale(self, x: State) -> State:
        """Displacement [m] for one unit of each component's error in a step from `x`; override for relative errors."""
        return self.state_scale()

    def guards_along(
        self, segment: InputSegment, t_local: Term, x: State, mode: Scalar, size: int, length: Scalar
    ) -> tuple[tuple[Series, ...], int]:
        """The `guards` as series in the time [s] along a step of some `length` [s], and how many coefficients count.

        **Arguments:** time and state as series of which `size` coefficients count.
        """
        return cast("tuple[Series, ...]", self.guards(segment, t_local, x, mode)), size  # of series, series

    def rates(self, segment: InputSegment, t_local: Scalar, x: State, mode: Scalar) -> State:
        """The true time derivative of the state, scalars, in every mode, for outputs and plots.

        In `SETTLED` the `field` leaves out the components that `exact` knows, such as a platform that rings on below a
        contact that sticks.  A system for which the two differ overrides this.
        """
        rates = self.field(segment, t_local, x, mode)
        return jax.tree.map(lambda value, rate: jnp.asarray(rate, float) + 0.0 * value, x, rates)

    def on_segment_start(self, segment: InputSegment, x: State, mode: Scalar) -> tuple[State, Scalar]:
        """State and mode in which a new segment begins; the state changes only where `resets_at_corners`."""
        return x, mode

    @property
    def resets_at_corners(self) -> bool:
        """Whether the state may change at a corner of the input: jump, or learn that the input has turned."""
        return False

    def period(self) -> tuple[int, int] | None:
        """The first segment of the first period, and how many segments make one; None: the input never repeats."""
        return None

    def is_settled(
        self, segment: InputSegment, t_local: ScalarLike, x: State, mode: Scalar, tolerance: ScalarLike
    ) -> Truth:
        """Whether the motion is within `tolerance` [m] of the segment's steady solution; must be False where unsure."""
        return jnp.zeros((), bool)

    def project_to_steady(self, segment: InputSegment, t_local: ScalarLike, x: State, mode: Scalar) -> State:
        """The state with the remaining deviations from the steady solution removed."""
        return x

    def state_distance(self, x: State, earlier: State) -> Scalar:
        """Distance [m] between two states, without the `shifting_components`."""
        away = jax.tree.map(lambda a, b, unit: jnp.abs(a - b) * unit, x, earlier, self.state_scale())
        fixed = [d for i, d in enumerate(jax.tree.leaves(away)) if i not in self.shifting_components()]
        return jnp.stack(fixed).max()

    def shifting_components(self) -> tuple[int, ...]:
        """The components, counted as the leaves of the state, on which nothing depends: a shift changes no motion."""
        return ()

    def same_state(self, x: State, earlier: State, tolerance: ScalarLike) -> Truth:
        """Whether two states start the same motion but for a constant shift, to within `tolerance` [m]."""
        return self.state_distance(x, earlier) < tolerance

    def extra_error_terms(self, x: State, mode: Scalar) -> tuple[Term, ...]:
        """Functions that a step has to resolve besides the state, as displacements [m]."""
        return ()

    def closed_components(self) -> tuple[int, ...]:
        """The components, counted as the leaves of the state, that `exact` knows."""
        return ()

    def exact(self, segment: InputSegment, t_local: ScalarLike, begin: State, elapsed: Scalar, end: State) -> State:
        """`end`, `elapsed` [s] after `begin` at `t_local`, the `closed_components` replaced by their exact values."""
        return end

    def has_closed_states(self) -> bool:
        """Whether `closed_states` has the states without any step, from the start of the drive on."""
        return False

    def closed_states(self, times: Float[Array, " m"], segments: int) -> SampledStates:
        """The states at `times` [s], none before 0; only where `has_closed_states`.

        **Arguments:** `segments` is how many segments of the drive the times may reach into.
        """
        raise NotImplementedError(f"{type(self).__name__} knows no states in closed form")

    def is_carried_back(self, slope: Scalar, mode: Scalar, which: Scalar, amplitude: float) -> Truth:
        """Whether derivatives are carried back to a fixed time from an event with this `slope` of its guard.

        True for events of motions smaller than `amplitude` [m] (docs/numerics.md, "A ringing that dies out").
        """
        return jnp.zeros((), bool)


def initial_state_and_mode(system: AbstractHybridSystem) -> tuple[State, Scalar]:
    """State and mode in which the first segment begins."""
    zero = jnp.zeros(())
    return system.on_segment_start(system.segment(zero), system.initial(), zero)


def has_guards(system: AbstractHybridSystem, segment: InputSegment, t_local: Term, x: State, mode: Scalar) -> bool:
    """Whether events can end a mode."""
    return len(system.guards(segment, t_local, x, mode)) > 0


def field_of(system: AbstractHybridSystem, segment: InputSegment, unflatten: Unflatten, mode: Scalar) -> Field:
    """The field of one mode on lists of scalars, as the methods want it."""
    return lambda t_local, x: jax.tree.leaves(system.field(segment, t_local, unflatten(x), mode))


def unflattener(system: AbstractHybridSystem) -> Unflatten:
    """Make a state of `system` from its components."""
    tree = jax.tree.structure(system.initial())
    return lambda leaves: jax.tree.unflatten(tree, list(leaves))
