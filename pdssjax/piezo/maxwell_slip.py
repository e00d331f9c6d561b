"""A second-order system behind four elastoplastic elements: rate-independent hysteresis with a full memory.

    y'' + 2 xi w y' + w^2 y = C w^2 (u - b_1 s_1 - … - b_4 s_4)   [ - F / m_g with friction feedback (5.25) ]
    s_i' = u' while |s_i| < r_i; at |s_i| = r_i the element slips, s_i' = 0, until u' turns

Each s_i is a stop operator on the voltage: a spring on a block that slips at the threshold r_i
[V].  Right after a turn the platform follows with C (1 - b_1 - … - b_4) per volt; whenever an element
begins to slip its part b_i is added, and in the end it follows with C.  Since u - s_i is
what a play operator makes of u, this is a Prandtl-Ishlinskii operator: loops between the
same voltages have the same shape wherever they begin, and a loop that closes is forgotten.
A path cannot create energy as long as the b_i are positive.

The elements do not know how fast the voltage goes, so a jump is passed exactly.  Flags
tell which of them slip, one more the sign of u'.  The data do not tell which element is
which.

M. Goldfarb and N. Celanovic, Journal of Dynamic Systems, Measurement, and Control 119(3), 1997,
whose elements stand between charge and voltage.
"""

from collections.abc import Mapping

from ..core import quantities, quantity
from ._ceramic import Ceramic, Elements
from ._dynamics import Modal
from ._stack import AbstractStack, oscillator
from .base import USUAL_SWING, Shown

_COUNT = 4


class MaxwellSlip(AbstractStack):
    """Displacement, velocity, voltage [V], s_1 … s_4 [V]; then flags: the sign of u', which elements slip."""

    closed_on_lines = True

    hysteretic = tuple(f"{word}_{j}" for word in ("share", "threshold") for j in range(1, 5))

    gain: float = quantity(1.007e-7, "m/V")
    """Displacement per volt C while all elements slip [m/V]."""
    natural_frequency: float = quantity(6736.0, "rad/s")
    """Undamped natural frequency w [rad/s]."""
    damping_ratio: float = quantity(0.1772, "", high=1.0)
    """Damping ratio xi [1], below 1."""
    share_1: float = quantity(0.08, "", positive=False, low=0.0)
    """Part b_1 of the gain that the first element holds back [1]; all four together below 1."""
    share_2: float = quantity(0.06, "", positive=False, low=0.0)
    """Part b_2 that the second element holds back [1]."""
    share_3: float = quantity(0.05, "", positive=False, low=0.0)
    """Part b_3 that the third element holds back [1]."""
    share_4: float = quantity(0.04, "", positive=False, low=0.0)
    """Part b_4 that the fourth element holds back [1]."""
    threshold_1: float = quantity(4.0, "V")
    """Voltage r_1 at which the first element slips [V]."""
    threshold_2: float = quantity(10.0, "V")
    """Voltage r_2 at which the second element slips [V]."""
    threshold_3: float = quantity(18.0, "V")
    """Voltage r_3 at which the third element slips [V]."""
    threshold_4: float = quantity(28.0, "V")
    """Voltage r_4 at which the fourth element slips [V]."""
    mass: float = quantity(0.56, "kg", optional=True)
    """Moving mass of stack and platform m_g [kg]; only friction feedback (5.25) uses it."""

    def broken_conditions(self) -> tuple[str, ...]:
        together = float(sum(self._shares()))
        if together < 1.0:
            return ()
        return (f"piezo.share_1 to piezo.share_{_COUNT} together are {together:.4g}, not below 1",)

    @classmethod
    def first_guess(cls, shown: Shown, known: Mapping[str, float]) -> dict[str, float]:
        guess = super().first_guess(shown, known)
        if shown.swing:
            # An element slips only where its threshold is below the swing of the voltage, or half of it between turns.
            thresholds = {f"threshold_{i}": quantities(cls)[f"threshold_{i}"].nominal for i in range(1, _COUNT + 1)}
            guess |= {name: nominal * shown.swing / USUAL_SWING for name, nominal in thresholds.items()}
        return guess

    @property
    def dynamics(self) -> Modal:
        return oscillator(self.natural_frequency, self.damping_ratio, self.mass)

    @property
    def ceramic(self) -> Ceramic:
        held = tuple(self.gain * share for share in self._shares())
        thresholds = self.threshold_1, self.threshold_2, self.threshold_3, self.threshold_4
        return Ceramic((self.gain - sum(held),), Elements(held, thresholds), (), ())

    def _shares(self) -> tuple[float, float, float, float]:
        return self.share_1, self.share_2, self.share_3, self.share_4
