"""Steady motions are those of the closed form, with its derivatives; what does not attract, or repeats late, is told.

The oscillator is J. P. den Hartog's (Transactions of the ASME 53, 1931): with Coulomb friction F beside a spring,
forced by P cos(w t), with mass and stiffness 1.  Between a peak and the trough that follows friction pushes forwards,

    x = X cos s - Y / w sin s + F + (x0 - F - X) cos t + Y sin t,    s = w t
    X = x0,   Y = -F sin(pi/w) / (1 + cos(pi/w)),   x0 = sqrt( (V P)^2 - (Y/w)^2 ),   V = 1 / (1 - w^2)

where the forcing is ahead of the peak by the angle phi, V P cos phi = X, V P w sin phi = Y.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import AbstractHybridSystem, Accuracy, Taylor
from pdssjax.integration import cosine_and_sine, steady_state

FINE = Accuracy(tolerance=1e-14, method=Taylor(8), max_steps=256)
TOLERANCE = 1e-11
DRIFT = 0.25
FORCED = jnp.array([1.0, 0.3, 1.3])
"""P, F and w: the mass never stops for longer than an instant."""


class Cycle(NamedTuple):
    duration: Any


class CoulombOscillator(AbstractHybridSystem):
    """q' = v + `DRIFT`, v' = P cos(w t) - x - F sign v, x' = v: nothing depends on q."""

    amplitude: Any
    friction: Any
    rate: Any

    def initial(self):
        return (jnp.zeros(()), jnp.zeros(()), jnp.zeros(()))

    def segment(self, index):
        return Cycle(2.0 * jnp.pi / jnp.asarray(self.rate, float) + 0.0 * index)

    def field(self, segment, t_local, x, mode):
        cosine, _ = cosine_and_sine(self.rate * t_local)
        pushed = self.amplitude * cosine - x[2] - self.friction * mode
        return (x[1] + DRIFT, pushed, x[1])

    def guards(self, segment, t_local, x, mode):
        return (x[1] * mode,)

    def after_event(self, segment, t_local, x, mode, which):
        return (x[0], jnp.zeros(()), x[2]), -mode

    def on_segment_start(self, segment, x, mode):
        # A cycle may begin in the midst of a motion: then the velocity tells the mode.
        return x, jnp.where(mode != 0, mode, jnp.where(x[1] < 0, -1.0, 1.0))

    def state_scale(self):
        return (jnp.ones(()), jnp.ones(()), jnp.ones(()))

    def period(self):
        return (0, 1)

    def shifting_components(self):
        return (0,)


def closed_form(numbers):
    """Velocity and place where the forcing is at its top with the gain of a cycle, and the peak."""
    amplitude, friction, rate = numbers
    c, s = jnp.cos(jnp.pi / rate), jnp.sin(jnp.pi / rate)
    gain = 1.0 / (1.0 - rate**2)
    y = -friction * s / (1.0 + c)
    x0 = jnp.sqrt((gain * amplitude) ** 2 - (y / rate) ** 2)
    phi = jnp.arctan2(y / (gain * rate), x0 / gain)
    # The top is met this long after a peak; half a period later everything is mirrored.
    turn = jnp.mod(-phi, 2.0 * jnp.pi)
    mirrored = turn > jnp.pi
    t = jnp.where(mirrored, turn - jnp.pi, turn) / rate

    def place(t):
        return x0 * jnp.cos(rate * t) - y / rate * jnp.sin(rate * t) + friction - friction * jnp.cos(t) + y * jnp.sin(t)

    x, v = jax.jvp(place, (t,), (jnp.ones(()),))
    sign = jnp.where(mirrored, -1.0, 1.0)
    return jnp.stack([sign * v, sign * x, DRIFT * 2.0 * jnp.pi / rate]), x0


def steady(numbers):
    """Velocity, place and gain of a cycle, and the whole motion."""
    system = CoulombOscillator(*numbers)
    motion = steady_state(system, 2.0 * jnp.pi / numbers[2], FINE, TOLERANCE)
    return jnp.concatenate([motion.x[1:], motion.gain[:1]]), motion


@functools.cache
def found():
    """The steady state of `FORCED`."""
    return jax.tree.map(np.asarray, jax.jit(steady)(FORCED))


def test_a_coulomb_oscillator_moves_as_den_hartog_says():
    values, motion = found()
    expected, _ = closed_form(FORCED)
    assert int(motion.period) == 1 and int(motion.failure) == 0
    # Its transient decays by a quarter in a cycle: integration alone is not near after 24 of them.
    assert int(motion.cycles) == 24 and int(motion.looks) > 2
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=1e-10)


@pytest.mark.slow
def test_its_derivatives_are_those_of_the_closed_form_that_by_the_period_too():
    slopes = jax.jit(jax.jacfwd(lambda n: steady(n)[0]))(FORCED)
    np.testing.assert_allclose(slopes, jax.jacfwd(lambda n: closed_form(n)[0])(FORCED), rtol=1e-7, atol=1e-9)


def test_its_multipliers_are_those_of_the_two_reversals():
    """Without damping only the reversals contract: each by the accelerations after it and before it (Liouville)."""
    _, motion = found()
    (_, friction, rate), (_, x0) = FORCED, closed_form(FORCED)
    at_peak = -x0 + x0 * (1.0 - rate**2)
    contraction = (at_peak + friction) / (at_peak - friction)
    assert float(motion.multipliers[:2].prod()) == pytest.approx(float(contraction**2), rel=1e-8)
    assert float(motion.multipliers[2]) == 0.0
