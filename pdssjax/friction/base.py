"""The interface of every friction law: an internal state, its rate, and the force."""

import abc

import equinox as eqx
from jaxtyping import Array, Float

Number = Float[Array, ""]
State = tuple[Number, ...]


class AbstractFriction(eqx.Module):
    """A contact force as a function of the relative velocity v = y' - x_e' [m/s].

    `sign` is +1 where v > 0 and -1 where v < 0; within one sign the law is smooth in its
    state and in v, and |v| stands for `sign * v`.  A positive force pulls the
    end-effector forward, along with the advancing platform.  The state is a tuple of
    scalars, empty for a law without memory.  `rate` and `force` use + - * / only where
    the law allows it: then the Taylor integrator can expand them.
    """

    @abc.abstractmethod
    def initial(self) -> State:
        """The internal state of the undisturbed contact."""

    @abc.abstractmethod
    def rate(self, state: State, v: Number, sign: Number) -> State:
        """Time derivative of the state on the branch `sign`; zero at v = 0."""

    @abc.abstractmethod
    def force(self, state: State, v: Number, sign: Number) -> Number:
        """Friction force on the end-effector [N] on the branch `sign`."""

    @abc.abstractmethod
    def length(self) -> State:
        """Displacement [m] that one unit of each state stands for: the scale of its error."""

    @abc.abstractmethod
    def relaxed(self, state: State, force: Number) -> tuple[State, Number]:
        """The state in which the contact at rest carries `force` [N], near `state`.

        The second value is the relative displacement [m] by which the contact yields on
        the way there, to first order in the distance.
        """

    @classmethod
    @abc.abstractmethod
    def plausible(cls, mass: float, acceleration: float, rate: float) -> dict[str, tuple[float, float]]:
        """Ranges in which to look for the law's parameters when nothing is known of them.

        **Arguments:** end-effector `mass` [kg], the peak `acceleration` of the platform
        [m/s2] and its natural frequency `rate` [rad/s]: an actuator that walks slips at a
        fraction of that acceleration, on a contact not much faster or slower than that.
        """


def lugre_ranges(mass: float, acceleration: float, rate: float) -> tuple[tuple[float, float], ...]:
    """Ranges for stiffness [N/m], damping [N s/m] and breakaway force [N] of a bristle contact."""
    stiff = mass * (0.2 * rate) ** 2, mass * (1.5 * rate) ** 2
    critical = 2.0 * mass * 0.5 * rate
    return stiff, (0.02 * critical, critical), (0.004 * mass * acceleration, 0.3 * mass * acceleration)
