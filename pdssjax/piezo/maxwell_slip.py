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

import jax.numpy as jnp

from ..core import Scalar, ScalarLike, quantities, quantity
from ..drive.base import Segment, Voltage
from ..integration import N, Term
from ._oscillator import accelerated
from .base import USUAL_SWING, AbstractPiezo, Shown, State, Terms, slew_sign

_COUNT = 4

_ROUNDING = 1e-12
"""Part of its threshold by which an element that slips may seem short of it."""


class MaxwellSlip(AbstractPiezo):
    """Displacement, velocity, voltage seen [V], s_1 … s_4 [V]; then flags: the sign of u', which elements slip."""

    has_steady_state = False

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

    def initial(self) -> State:
        zero = jnp.zeros(())
        return (*(zero for _ in range(3 + _COUNT)), zero + 1.0, *(zero for _ in range(_COUNT)))

    def rate(self, state: Terms, voltage: Voltage[Term], force: Term) -> Terms:
        _, w, _, _, _, slips = _parts(state)
        slope = voltage.slope
        stretches = (slope * (1.0 - slip) for slip in slips)
        pushed = self.acceleration(state, voltage) + force * (1.0 / self.mass)
        return (w, pushed, slope, *stretches, 0, *(0 for _ in range(_COUNT)))

    def platform(self, state: tuple[N, ...]) -> tuple[N, N]:
        return state[0], state[1]

    def acceleration(self, state: Terms, voltage: Voltage[Term]) -> Term:
        y, w, _, stops, _, _ = _parts(state)
        drives = voltage.level
        for s, share in zip(stops, self._shares(), strict=True):
            drives = drives - s * share
        return accelerated(y, w, drives * self.gain, self.natural_frequency, self.damping_ratio)

    def steady(self, state: State, segment: Segment, t_local: ScalarLike, force: ScalarLike) -> State:
        return state

    def guards(self, state: Terms, voltage: Voltage[Term]) -> Terms:
        _, _, seen, stops, rises, slips = _parts(state)
        elements = zip(stops, slips, self._thresholds(), strict=True)
        held = ((r - s * rises) * (1.0 - slip) + slip for s, slip, r in elements)
        return (seen * 0.0 + voltage.slope * rises, *held)

    def after_event(self, state: State, voltage: Voltage[Scalar], which: Scalar) -> State:
        y, w, seen, stops, rises, slips = _parts(state)
        turns = which == 0
        slips = (jnp.where(turns, 0.0, jnp.where(which == i, 1.0, slip)) for i, slip in enumerate(slips, start=1))
        return (y, w, seen, *stops, jnp.where(turns, -rises, rises), *slips)

    def on_segment_start(self, state: State, segment: Segment) -> State:
        y, w, seen, stops, rises, _ = _parts(state)
        voltage = segment.voltage(0.0)
        change = voltage.level - seen
        rises = slew_sign(voltage, rises)
        moved = []
        for s, r in zip(stops, self._thresholds(), strict=True):
            s = s + change
            moved.append(jnp.where(s > r, r, jnp.where(s < -1.0 * r, -1.0 * r, s)))
        elements = zip(moved, self._thresholds(), strict=True)
        slips = (jnp.where(rises * s >= r * (1.0 - _ROUNDING), 1.0, 0.0) for s, r in elements)
        return (y, w, voltage.level, *moved, rises, *slips)

    def error_scale(self) -> State:
        metre, volt = jnp.ones(()), self.static_gain()
        return (
            metre,
            1.0 / self.frequency_scale(),
            *(volt for _ in range(1 + _COUNT)),
            *(metre for _ in range(1 + _COUNT)),
        )

    def static_gain(self) -> Scalar:
        return jnp.asarray(self.gain, float)

    def frequency_scale(self) -> Scalar:
        return jnp.asarray(self.natural_frequency, float)

    def _shares(self) -> tuple[float, float, float, float]:
        return self.share_1, self.share_2, self.share_3, self.share_4

    def _thresholds(self) -> tuple[float, float, float, float]:
        return self.threshold_1, self.threshold_2, self.threshold_3, self.threshold_4


def _parts(state: tuple[N, ...]) -> tuple[N, N, N, list[N], N, list[N]]:
    """y, w, voltage seen, the stops, the sign of u', the flags of the elements."""
    y, w, seen, *flags = state
    return y, w, seen, flags[:_COUNT], flags[_COUNT], flags[_COUNT + 1 :]
