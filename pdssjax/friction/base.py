"""The interface of every friction law: an internal state, its rate, and the force.

Some laws change their form while the direction stays: an element of a Maxwell model begins
to slip, a bristle snaps.  Such a law keeps a flag for each form among its state, with
rate zero, and says by `guards` where a form ends, by `after_event` what follows, and by
`on_reversal` with which flags a motion begins; `on_velocity_jump` follows from these.
"""

import abc
from collections.abc import Mapping
from typing import ClassVar, Literal, TypeAlias

import jax.numpy as jnp

from ..core import AbstractModel, Scalar, ScalarLike
from ..integration import Term, constant

State: TypeAlias = tuple[Scalar, ...]
"""State of a contact: one scalar a component, none for a law without memory."""

Terms: TypeAlias = tuple[Term, ...]
"""A component of a rate: a number, or a series."""


_YIELDING = 1e-7
"""The deflection at which a contact yields counts as a displacement [m] of so much at least."""


def deflection_scale(yielding: ScalarLike) -> Scalar:
    """The `error_scale` of a deflection that yields at `yielding` [m].

    A contact with little friction yields at some 1e-9 m: an error that the motion does not feel is then large beside
    it, and beside its derivatives.
    """
    return jnp.maximum(1.0, _YIELDING / jnp.asarray(yielding, float))


class AbstractFriction(AbstractModel):
    """A contact force as a function of the relative velocity v = y' - x_e' [m/s].

    `sign` is +1 where v > 0 and -1 where v < 0; within one sign and one set of flags the
    law is smooth in its state and in v, and |v| stands for `sign * v`.  A positive force
    pulls the end-effector forward, along with the advancing platform.  The state is a
    tuple of scalars, empty for a law without memory.  `rate`, `force` and `guards` use
    + - * / and the functions of `pdssjax.integration.taylor_series`: then the Taylor integrator can expand them.
    """

    at_rest: ClassVar[Literal["elastic", "set-valued", "viscous"]] = "elastic"
    """What carries a load at v = 0.

    Elastic: a displacement of the contact, in `equilibrium_state`.  Set-valued: the contact sticks, and takes
    whatever lies between its breakaway forces.  Viscous: nothing; under any load the contact creeps.
    """

    without_rate: ClassVar[Mapping[str, float] | None] = None
    """Parameters and the numbers of them with which the force depends on the path alone, not on how fast it is
    travelled; empty where it never knows the rate, None where it always does."""

    flags_shape_force: ClassVar[bool] = True
    """Whether the force of a law with events depends on the flags that they set, as bonds and saturation do.

    Not where a flag only ends a step: then `rate` and `force` are right whatever it says.
    """

    @abc.abstractmethod
    def initial(self) -> State:
        """The internal state of the undisturbed contact."""

    @abc.abstractmethod
    def rate(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        """Time derivative of the state on the branch `sign`; the integer 0 for flags."""

    @abc.abstractmethod
    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        """Friction force on the end-effector [N] on the branch `sign`."""

    @abc.abstractmethod
    def error_scale(self) -> State:
        """Displacement [m] that one unit of each state stands for: the scale of its error.

        `deflection_scale` for a deflection.  1 for a flag: it has no error, and two states whose flags differ are far
        apart.
        """

    @abc.abstractmethod
    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        """The state in which the contact at rest carries `force` [N], near `state`; `state` unless it is elastic.

        The second value is the relative displacement [m] by which the contact yields on
        the way there, to first order in the distance.
        """

    def equilibrium_after(self, state: State, force: Scalar, sign: ScalarLike) -> tuple[State, Scalar]:
        """The `equilibrium_state` to which a motion in the direction `sign` leads, and the displacement [m] to it.

        Another one only where the force at rest depends on the direction.
        """
        return self.equilibrium_state(state, force)

    def under_load(self, force: Scalar) -> State:
        """The state of a contact that came to rest carrying `force` [N], raised slowly from 0 in one direction.

        A force beyond the largest that the contact holds leaves a state from which it slides.
        """
        return self.equilibrium_state(self.initial(), force)[0]

    @classmethod
    @abc.abstractmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        """Ranges in which to look for the law's parameters when nothing is known of them.

        **Arguments:** end-effector `mass` [kg], the peak `acceleration` of the platform
        [m/s2] and its natural frequency `rate` [rad/s]: an actuator in stick-slip motion slips at a
        fraction of that acceleration, on a contact not much faster or slower than that.
        """

    def guards(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        """Guards of the law, positive while it keeps its form; always as many, in the same order."""
        return ()

    def after_event(self, state: State, v: Scalar, sign: ScalarLike, which: Scalar) -> State:
        """The state just after `guards(...)[which]` has fallen through zero."""
        return state

    def on_reversal(self, state: State, sign: ScalarLike) -> State:
        """The state with which a motion in the direction `sign` begins, from v = 0."""
        return state

    def on_velocity_jump(self, state: State, v: Scalar, sign: ScalarLike) -> State:
        """The state just after v has jumped to `v` [m/s], in the direction `sign`.

        A guard that this leaves below zero has been carried past its event.
        """
        for which, guard in enumerate(self.guards(state, v, sign)):
            after, passed = self.after_event(state, v, sign, jnp.asarray(float(which))), constant(guard) < 0.0
            state = tuple(jnp.where(passed, new, old) for new, old in zip(after, state, strict=True))
        return state

    @classmethod
    def slides_in_closed_form(cls) -> bool:
        """Whether the law has a closed form of sliding at a constant velocity (`slide`)."""
        return cls.slide is not AbstractFriction.slide

    def slide(self, state: State, v: Scalar, elapsed: Scalar, sign: ScalarLike) -> State:
        """The state after sliding for `elapsed` [s] at the constant velocity `v` [m/s], through all events of the law.

        **Arguments:** `sign` is that of `v`, which is not 0; the `state` is one with which that motion goes on.

        **Raises:** `NotImplementedError` where the law has no closed form (`slides_in_closed_form`).
        """
        raise NotImplementedError(f"{type(self).__name__} knows no closed form")

    def extra_error_terms(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        """Functions of v that the state hardly shows, as displacements [m]; steps resolve them, too.

        A curve in v, such as Stribeck's (`_stribeck_curve`).  Without it a step may run past the curve, and the
        derivatives by its parameters are wrong.
        """
        return ()

    def breakaway_force(self, state: State, sign: ScalarLike) -> ScalarLike:
        """The force [N] beyond which the contact at rest lets go in the direction `sign`."""
        return constant(self.force(self.on_reversal(state, sign), 0.0, sign))
