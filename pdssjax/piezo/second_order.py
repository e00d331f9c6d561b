"""Piezo stack and platform as one second-order system (4.2, 5.27-5.29).

    y'' + 2 xi w y' + w^2 y = C w^2 u   [ - F / m_g with friction feedback (5.25) ]

On a straight piece of voltage u = u0 + k s it moves as
y = C (u - 2 xi k / w) + a damped oscillation, exactly.
"""

import jax.numpy as jnp

from ..quantity import quantity
from .base import AbstractPiezo


class SecondOrder(AbstractPiezo):
    """Gain, natural frequency and damping ratio; underdamped."""

    gain: float = quantity(1.007e-7, "m/V")
    """Steady displacement per volt C [m/V]."""
    natural_frequency: float = quantity(6736.0, "rad/s")
    """Undamped natural frequency w [rad/s]."""
    damping_ratio: float = quantity(0.1772, "", high=1.0)
    """Damping ratio xi [1], below 1."""
    mass: float = quantity(0.56, "kg", optional=True)
    """Moving mass of stack and platform m_g [kg]; only friction feedback (5.25) uses it."""

    def acceleration(self, y, w, voltage):
        rate = self.natural_frequency
        return rate * (rate * (self.gain * voltage - y) - 2.0 * self.damping_ratio * w)

    def steady(self, segment, after):
        lag = 2.0 * self.damping_ratio / self.natural_frequency
        voltage = segment.start + segment.slope * (after - lag)
        return self.gain * voltage, self.gain * segment.slope

    def motion(self, y, w, segment, after, lapse):
        y0, w0 = self.steady(segment, after)
        y1, w1 = self.steady(segment, after + lapse)
        decay = self.damping_ratio * self.natural_frequency
        ring = self.natural_frequency * jnp.sqrt(1.0 - self.damping_ratio**2)
        a = y - y0
        b = (w - w0 + decay * a) / ring
        fade = jnp.exp(-decay * lapse)
        c, s = fade * jnp.cos(ring * lapse), fade * jnp.sin(ring * lapse)
        oscillation = a * c + b * s
        return y1 + oscillation, w1 - decay * oscillation + ring * (b * c - a * s)

    def rate(self):
        return jnp.asarray(self.natural_frequency, float)
