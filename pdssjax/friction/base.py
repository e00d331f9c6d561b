"""The interface of every friction law: an internal state, its rate, and the force.

Some laws change their form while the direction stays: an element of a Maxwell model begins
to slip, a bristle snaps.  Such a law keeps a flag for each form among its state, with
rate zero, and says by `guards` where a form ends, by `after_event` what follows, and by
`on_reversal` with which flags a motion begins.
"""

import abc
from typing import ClassVar, Literal, TypeAlias

import equinox as eqx
import jax.numpy as jnp

from ..core import Scalar, ScalarLike, described, quantity
from ..integration import Term, constant, exp

State: TypeAlias = tuple[Scalar, ...]
"""Of a contact: one scalar a component, none for a law without memory."""

Terms: TypeAlias = tuple[Term, ...]
"""What a field is made of, one a component."""

CURVE = 1e-8
"""The Stribeck curve, from 1 at rest to 0 far out, as a displacement [m]: how well a step resolves it.

The motion hardly feels how the curve bends within a step; its derivatives by the curve's parameters do.
"""


class AbstractFriction(eqx.Module):
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

    def __repr__(self) -> str:
        return described(self)

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

        1 for a flag: it has no error, and two states whose flags differ are far apart.
        """

    @abc.abstractmethod
    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        """The state in which the contact at rest carries `force` [N], near `state`; `state` unless it is elastic.

        The second value is the relative displacement [m] by which the contact yields on
        the way there, to first order in the distance.
        """

    @classmethod
    @abc.abstractmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        """Ranges in which to look for the law's parameters when nothing is known of them.

        **Arguments:** end-effector `mass` [kg], the peak `acceleration` of the platform
        [m/s2] and its natural frequency `rate` [rad/s]: an actuator in stick-slip motion slips at a
        fraction of that acceleration, on a contact not much faster or slower than that.
        """

    def guards(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        """Positive while the law keeps its form; always as many, in the same order."""
        return ()

    def after_event(self, state: State, v: Scalar, sign: ScalarLike, which: Scalar) -> State:
        """The state just after `guards(...)[which]` has fallen through zero."""
        return state

    def on_reversal(self, state: State, sign: ScalarLike) -> State:
        """The state with which a motion in the direction `sign` begins, from v = 0."""
        return state

    def extra_error_terms(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        """What the law makes of v and the state hardly shows, as displacements [m]; steps resolve it, too.

        A curve in v, such as Stribeck's: times `CURVE`.  Without it a step may run past the curve, and the
        derivatives by its parameters are wrong.
        """
        return ()

    def breakaway_force(self, state: State, sign: ScalarLike) -> ScalarLike:
        """The force [N] beyond which the contact at rest lets go in the direction `sign`."""
        return constant(self.force(self.on_reversal(state, sign), 0.0, sign))


class AbstractStribeckBristle(AbstractFriction):
    """A mean bristle that yields at the Stribeck curve: the parameters that LuGre and its relatives share.

    The deflection z [m] is the first of the state; F = s0 z + s1 z' + s2 v.  That a step resolves the curve is
    said here; the flag of fast sliding, with its `stribeck_guard`, is the member's.
    """

    sigma0: float = quantity(1.0e6, "N/m")
    """Bristle stiffness s0 [N/m]."""
    sigma1: float = quantity(45.0, "N s/m")
    """Bristle damping s1 [N s/m]."""
    sigma2: float = quantity(0.0, "N s/m", positive=False, low=0.0, optional=True)
    """Viscous friction s2 [N s/m]."""
    f_c: float = quantity(0.55, "N")
    """Coulomb force f_c, of fast sliding without its viscous part [N]."""
    f_s: float = quantity(0.65, "N")
    """Static force f_s, of infinitely slow sliding [N]; below f_c, friction grows with the velocity."""
    v_s: float = quantity(1e-3, "m/s")
    """Stribeck velocity v_s [m/s]."""

    def initial(self) -> State:
        return tuple(jnp.zeros(()) for _ in self.error_scale())

    def force(self, state: Terms, v: Term, sign: ScalarLike) -> Term:
        return self.sigma0 * state[0] + self.sigma1 * self.rate(state, v, sign)[0] + self.sigma2 * v

    def extra_error_terms(self, state: Terms, v: Term, sign: ScalarLike) -> Terms:
        return (stribeck_curve(v, 0.0, CURVE, self.v_s),)

    def equilibrium_state(self, state: State, force: Scalar) -> tuple[State, Scalar]:
        target = force / self.sigma0
        return (target, *state[1:]), target - state[0]

    @classmethod
    def search_ranges(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        stiffness, damping, force = lugre_ranges(mass, acceleration, rate)
        return {
            "sigma0": stiffness,
            "sigma1": damping,
            "sigma2": damping,
            "f_c": force,
            "f_s": force,
            "v_s": stribeck_range(acceleration, rate),
        }


def lugre_ranges(mass: float, acceleration: float, rate: float) -> tuple[tuple[float, float], ...]:
    """Ranges for stiffness [N/m], damping [N s/m] and breakaway force [N] of a bristle contact."""
    stiff = mass * (0.2 * rate) ** 2, mass * (1.5 * rate) ** 2
    critical = 2.0 * mass * 0.5 * rate
    return stiff, (0.02 * critical, critical), (0.004 * mass * acceleration, 0.3 * mass * acceleration)


def stribeck_curve(v: Term, f_c: ScalarLike, f_s: ScalarLike, v_s: ScalarLike) -> Term:
    """f_c + (f_s - f_c) exp(-(v/v_s)^2) (5.10) [N], of a series or of a number.

    Between f_c and f_s whichever is larger: with f_s < f_c friction grows with the velocity.
    """
    x = v * (1.0 / v_s)
    return exp(x * x * (-1.0)) * (f_s - f_c) + f_c


def stribeck_guard(fast: Term, v: Term, sign: ScalarLike, v_s: ScalarLike, far: ScalarLike = 4.0) -> Term:
    """The guard of a flag that tells `fast` sliding, far out where the Stribeck curve is flat.

    The Taylor coefficients of e^(-x^2) about x grow up to the order 2 x^2 or so before they fall.  Far
    out the first dozen is small and says nothing of the others: a step that brakes would run past
    the curve unseen.  At x = 4, where e^-16 is left, it is seen.  So steps end at `far` times
    v_s when braking, and past 1.1 times that when speeding up.
    """
    speed = v * (sign / v_s)
    return (speed - far) * fast + (1.1 * far - speed) * (1.0 - fast)


def stribeck_range(acceleration: float, rate: float) -> tuple[float, float]:
    """Range for the Stribeck velocity [m/s]: fractions of the peak velocity of the platform."""
    return 1e-3 * acceleration / rate, 0.3 * acceleration / rate
