"""A second-order system with the hysteresis of Bouc and Wen between the voltage and what drives it.

    y'' + 2 xi w y' + w^2 (y - C u + h) = 0   [ - F / m_g with friction feedback (5.25) ]
    h' = a C u' - b |u'| h - g u' |h|

h lags behind the voltage and does not know how fast that goes: along the path of u it obeys
dh/du = a C - (b + g) h on a loading branch (u' and h of one sign), with b - g for b + g while h
still has the sign of the turn before.  A long loading branch ends at h = a C / (b + g); after a
turn the platform first follows with C (1 - a) per volt and in the end with C, so a loop on
the plane of y and u runs counter-clockwise, as that of a piezo ceramic.  On such a branch h is
exponential in u, and a jump of the voltage is passed exactly.  With |g| up to b no path
creates energy.

Flags tell the signs of u' and h; within one set of them all is smooth.

T. S. Low and W. Guo, Journal of Microelectromechanical Systems 4(4), 1995.
"""

from collections.abc import Mapping

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantities, quantity
from ..drive.base import Segment, Voltage
from ..integration import N, Term
from ._ceramic import after_jump
from ._oscillator import accelerated
from .base import USUAL_SWING, AbstractPiezo, Shown, State, Terms, slew_sign


class BoucWen(AbstractPiezo):
    """Displacement y, velocity, hysteresis h [m], voltage seen [V]; then flags: the signs of u' and of h."""

    has_steady_state = False

    hysteretic = ("alpha", "beta", "gamma")

    gain: float = quantity(1.007e-7, "m/V")
    """Displacement per volt C at the end of a long branch [m/V]."""
    natural_frequency: float = quantity(6736.0, "rad/s")
    """Undamped natural frequency w [rad/s]."""
    damping_ratio: float = quantity(0.1772, "", high=1.0)
    """Damping ratio xi [1], below 1."""
    alpha: float = quantity(0.3, "", positive=False, low=0.0, high=1.0)
    """Part a of the gain that is missing right after a turn [1]; 0 takes the hysteresis away."""
    beta: float = quantity(0.03, "1/V")
    """Rate b with which h forgets along the path [1/V]."""
    gamma: float = quantity(0.01, "1/V", positive=False)
    """Difference g of that rate between loading and unloading, halved [1/V]; from -beta to beta."""
    mass: float = quantity(0.56, "kg", optional=True)
    """Moving mass of stack and platform m_g [kg]; only friction feedback (5.25) uses it."""

    def broken_conditions(self) -> tuple[str, ...]:
        if abs(float(self.gamma)) <= float(self.beta):
            return ()
        return (
            f"piezo.gamma is {float(self.gamma):.4g} 1/V, beyond piezo.beta, {float(self.beta):.4g} 1/V, "
            "so that this stack creates energy on some paths (|gamma| <= beta would not)",
        )

    @classmethod
    def first_guess(cls, shown: Shown, known: Mapping[str, float]) -> dict[str, float]:
        guess = super().first_guess(shown, known)
        if shown.swing:
            # As many times as over the usual swing h forgets over this one.
            beta = known.get("beta", quantities(cls)["beta"].nominal * USUAL_SWING / shown.swing)
            guess |= {"beta": beta, "gamma": beta / 3.0}
        return guess

    def initial(self) -> State:
        zero = jnp.zeros(())
        return zero, zero, zero, zero, zero + 1.0, zero + 1.0

    def rate(self, state: Terms, voltage: Voltage[Term], force: Term) -> Terms:
        _, w, h, _, rises, sign = state
        slope = voltage.slope
        lags = slope * (self.alpha * self.gain) - slope * h * (rises * self.beta + sign * self.gamma)
        return w, self.acceleration(state, voltage) + force * (1.0 / self.mass), lags, slope, 0, 0

    def platform(self, state: tuple[N, ...]) -> tuple[N, N]:
        return state[0], state[1]

    def acceleration(self, state: Terms, voltage: Voltage[Term]) -> Term:
        y, w, h, *_ = state
        return accelerated(y, w, voltage.level * self.gain - h, self.natural_frequency, self.damping_ratio)

    def steady(self, state: State, segment: Segment, t_local: ScalarLike, force: ScalarLike) -> State:
        return state

    def guards(self, state: Terms, voltage: Voltage[Term]) -> Terms:
        _, _, h, _, rises, sign = state
        return h * 0.0 + voltage.slope * rises, h * (sign * (1.0 / self.gain))

    def after_event(self, state: State, voltage: Voltage[Scalar], which: Scalar) -> State:
        y, w, h, seen, rises, sign = state
        return y, w, h, seen, jnp.where(which == 0, -rises, rises), jnp.where(which == 1, -sign, sign)

    def on_segment_start(self, state: State, segment: Segment) -> State:
        y, w, h, seen, rises, _ = state
        voltage = segment.voltage(0.0)
        h = after_jump(h, voltage.level - seen, self.alpha * self.gain, self.beta, self.gamma)
        rises = slew_sign(voltage, rises)
        return y, w, h, voltage.level, rises, jnp.where(h == 0.0, rises, jnp.where(h > 0.0, 1.0, -1.0))

    def error_scale(self) -> State:
        metre = jnp.ones(())
        return metre, 1.0 / self.frequency_scale(), metre, self.static_gain(), metre, metre

    def static_gain(self) -> Scalar:
        return jnp.asarray(self.gain, float)

    def frequency_scale(self) -> Scalar:
        return jnp.asarray(self.natural_frequency, float)
