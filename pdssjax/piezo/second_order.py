"""Piezo stack and platform as one second-order system (4.2, 5.27-5.29).

    y'' + 2 xi w y' + w^2 y = C w^2 u   [ - F / m_g with friction feedback (5.25) ]

On a straight piece of voltage u = u0 + k s it moves as
y = C (u - 2 xi k / w) + a damped oscillation, exactly; a harmonic of the voltage adds its
own response.
"""

import jax.numpy as jnp

from ..quantity import quantity
from .base import AbstractPiezo


class SecondOrder(AbstractPiezo):
    """Gain, natural frequency and damping ratio; underdamped."""

    closed = True

    gain: float = quantity(1.007e-7, "m/V")
    """Steady displacement per volt C [m/V]."""
    natural_frequency: float = quantity(6736.0, "rad/s")
    """Undamped natural frequency w [rad/s]."""
    damping_ratio: float = quantity(0.1772, "", high=1.0)
    """Damping ratio xi [1], below 1."""
    mass: float = quantity(0.56, "kg", optional=True)
    """Moving mass of stack and platform m_g [kg]; only friction feedback (5.25) uses it."""

    def initial(self):
        return (jnp.zeros(()), jnp.zeros(()))

    def rate(self, state, voltage, force):
        return state[1], self.acceleration(state, voltage) + force * (1.0 / self.mass)

    def platform(self, state):
        return state

    def acceleration(self, state, voltage):
        y, w = state
        rate = self.natural_frequency
        return rate * (rate * (self.gain * voltage.level - y) - 2.0 * self.damping_ratio * w)

    def steady(self, state, segment, after, force):
        lag = 2.0 * self.damping_ratio / self.natural_frequency
        level = segment.start + segment.slope * (after - lag)
        yields = force / (self.mass * self.natural_frequency**2)
        return self.gain * level + yields, self.gain * segment.slope

    def motion(self, state, segment, after, lapse):
        y0, w0 = self._forced(segment, after)
        y1, w1 = self._forced(segment, after + lapse)
        decay = self.damping_ratio * self.natural_frequency
        ring = self.natural_frequency * jnp.sqrt(1.0 - self.damping_ratio**2)
        a = state[0] - y0
        b = (state[1] - w0 + decay * a) / ring
        fade = jnp.exp(-decay * lapse)
        c, s = fade * jnp.cos(ring * lapse), fade * jnp.sin(ring * lapse)
        oscillation = a * c + b * s
        return y1 + oscillation, w1 - decay * oscillation + ring * (b * c - a * s)

    def _forced(self, segment, after):
        """The response that the segment forces, without the transient."""
        y, w = self.steady((), segment, after, 0.0)
        if segment.wave is None:
            return y, w
        amplitude, rate, phase = segment.wave
        ratio = rate / self.natural_frequency
        stiff, lossy = 1.0 - ratio**2, 2.0 * self.damping_ratio * ratio
        size = self.gain * amplitude / (stiff**2 + lossy**2)
        cosine, sine = jnp.cos(rate * after + phase), jnp.sin(rate * after + phase)
        return (
            y + size * (stiff * cosine + lossy * sine),
            w + size * rate * (lossy * cosine - stiff * sine),
        )

    def length(self):
        return jnp.ones(()), 1.0 / self.fastest()

    def per_volt(self):
        return jnp.asarray(self.gain, float)

    def fastest(self):
        return jnp.asarray(self.natural_frequency, float)
