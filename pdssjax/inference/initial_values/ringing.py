"""Gain, natural frequency and damping ratio of a platform that rings under any voltage, by responses of one mode.

For frequencies all over what the samples can show, and a few damping ratios, the response of

    y'' + 2 xi w y' + w^2 y = K w^2 u

to the voltage, a straight line from sample to sample, is laid over the motion by least squares, with a constant, a
drift and what rings on from before the record.  From the best the two numbers are refined.  It rings if that leaves
less than a lag does, w^2 -> infinity with 2 xi / w = tau, of any tau.
"""

import cmath
import math

import numpy as np
from jaxtyping import Complex, Float

_RATIO = 1.03
"""Of one frequency tried to the one before."""

_DAMPING = (0.02, 0.1, 0.4)
"""Damping ratios tried."""

_LEAST_CYCLES = 3.0
"""In the record, of the slowest that is tried."""

_NYQUIST = 0.8
"""Part of the Nyquist frequency up to which frequencies are tried."""

_RINGS = 0.7
"""Sum of squares of a mode that rings, in parts of what is left without, up to which the record shows it."""

_MOST = 20_000
"""Samples that are looked at."""


def ringing(
    time: Float[np.ndarray, " n"], motion: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"]
) -> dict[str, float]:
    """ "gain" [m/V], "natural_frequency" [rad/s] and "damping_ratio" of a platform; empty where no ringing is seen.

    **Arguments:** `motion` [m], up to a constant, and `volts` [V] at increasing `time` [s].
    """
    from scipy.optimize import minimize

    count = min(time.size, _MOST)
    interval = float(time[count - 1] - time[0]) / max(count - 1, 1)
    even = time[0] + interval * np.arange(count)
    motion, volts = np.interp(even, time, motion), np.interp(even, time, volts)
    left = _Left(motion, volts, interval)
    slowest = 2.0 * math.pi * _LEAST_CYCLES / (interval * count)
    fastest = _NYQUIST * math.pi / interval
    if count < 16 or slowest >= fastest or np.ptp(volts) == 0.0:
        return {}
    rates = np.geomspace(slowest, fastest, 2 + int(math.log(fastest / slowest) / math.log(_RATIO)))
    without = min(left.of(volts)[0], *(left.by_lag(rate)[0] for rate in rates))
    _, rate, damping = min((left.by_mode(rate, damping)[0], rate, damping) for rate in rates for damping in _DAMPING)
    refined = minimize(
        lambda x: left.by_mode(*np.exp(x))[0], np.log([rate, damping]), method="Nelder-Mead", options={"maxfev": 200}
    )
    rate, damping = (float(number) for number in np.exp(refined.x))
    least, gain = left.by_mode(rate, damping)
    if not (least < _RINGS * without and gain > 0.0 and slowest <= rate <= fastest):
        return {}
    return {"gain": gain, "natural_frequency": rate, "damping_ratio": damping}


class _Left:
    """What a response, a constant, a drift and what rings on from before the record leave of a motion."""

    def __init__(self, motion: Float[np.ndarray, " n"], volts: Float[np.ndarray, " n"], interval: float) -> None:
        self._motion, self._volts, self._interval = motion - motion[0], volts - volts[0], interval
        self._elapsed = interval * np.arange(motion.size)
        self._line = [np.ones(motion.size), np.linspace(-1.0, 1.0, motion.size)]

    def of(self, response: Float[np.ndarray, " n"], *dying: Float[np.ndarray, " n"]) -> tuple[float, float]:
        """The sum of squares [m2], and by what the response [V] is multiplied [m/V]."""
        design = np.stack([response, *self._line, *dying], axis=1)
        numbers = np.linalg.lstsq(design, self._motion, rcond=None)[0]
        return float(np.sum((self._motion - design @ numbers) ** 2)), float(numbers[0])

    def by_lag(self, rate: float) -> tuple[float, float]:
        """Sum of squares [m2] and gain [m/V] by the response of a lag of the time constant 1 / `rate` [s]."""
        return self.of(np.real(self._followed(-rate)) * rate, np.exp(-rate * self._elapsed))

    def by_mode(self, rate: float, damping: float) -> tuple[float, float]:
        """Sum of squares [m2] and gain [m/V] by the response of a mode of frequency `rate` [rad/s]."""
        if not 0.0 < damping < 1.0:
            return math.inf, 0.0
        ring = rate * math.sqrt(1.0 - damping**2)
        pole = complex(-damping * rate, ring)
        dying = np.exp(pole * self._elapsed)
        return self.of(np.imag(self._followed(pole)) * rate**2 / ring, np.real(dying), np.imag(dying))

    def _followed(self, pole: complex) -> Complex[np.ndarray, " n"]:
        """z of z' = pole z + u from rest, exact where u is a straight line between samples."""
        from scipy.signal import lfilter

        step = pole * self._interval
        decay = cmath.exp(step)
        held, ramp = (decay - 1.0) / pole, (decay - 1.0 - step) / (pole * step)
        return np.asarray(lfilter([ramp, held - ramp], [1.0, -decay], self._volts), complex)
