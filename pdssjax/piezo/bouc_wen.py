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

from ..core import quantities, quantity
from . import _ceramic as hysteresis
from ._ceramic import Ceramic
from ._dynamics import Modal
from ._stack import AbstractStack, oscillator
from .base import USUAL_SWING, Shown


class BoucWen(AbstractStack):
    """Displacement y, velocity, voltage [V], hysteresis h/(a C) [V]; then flags: the signs of u' and of h."""

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

    @property
    def dynamics(self) -> Modal:
        return oscillator(self.natural_frequency, self.damping_ratio, self.mass)

    @property
    def ceramic(self) -> Ceramic:
        lags = self.alpha * self.gain
        return Ceramic((self.gain - lags,), hysteresis.BoucWen((lags,), self.beta, self.gamma), (), ())
