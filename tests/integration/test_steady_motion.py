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
from pdssjax.integration import PERIODS, cosine_and_sine, steady_state
from pdssjax.integration.steady_motion import _remaining

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


def distances(places, cycle):
    """How far cycle number `cycle` of a motion, one place a cycle, and those before are from earlier ones."""
    return jnp.array(
        [[abs(places[k] - places[k - n]) for n in range(1, PERIODS + 1)] for k in range(cycle - PERIODS, cycle + 1)]
    )


@pytest.mark.parametrize("ratio", [0.3, 0.9, -0.8])
def test_what_is_still_to_come_is_that_of_a_geometric_series(ratio):
    places = 1e-8 * ratio ** np.arange(40)
    for cycle in (10, 30):
        remaining = _remaining(distances(places, cycle), 1e-30)
        assert float(remaining[0]) == pytest.approx(
            abs(places[cycle - 1]) if ratio > 0 else abs(places[cycle - 1]) * 9, rel=1e-6
        )
        # It comes near to repeating after two and three cycles, too, but that is not what it does.
        assert np.isinf(remaining[1:]).all()


@pytest.mark.parametrize(("pattern", "period"), [([0.0, 1e-6], 2), ([0.0, 1e-6, 4e-6], 3), ([0.0], 1)])
def test_a_motion_that_repeats_late_is_told_apart(pattern, period):
    places = np.resize(pattern, 40) + 1e-8 * 0.5 ** np.arange(40)
    for cycle in (20, 21, 22):
        found = np.asarray(_remaining(distances(places, cycle), 2e-11)) < 2e-11
        assert found.any() and int(np.argmax(found)) + 1 == period


def test_nothing_is_said_before_enough_cycles_were_seen():
    apart = jnp.full((PERIODS + 1, PERIODS), jnp.inf).at[-1, 0].set(1e-9)
    assert np.isinf(_remaining(apart, 2e-11)).all()


def test_cycles_that_are_equal_to_rounding_are_enough():
    apart = jnp.full((PERIODS + 1, PERIODS), jnp.inf).at[-1, 0].set(1e-13)
    assert float(_remaining(apart, 2e-11)[0]) == 1e-13


RESTITUTION, RATE = 0.5, 2.0 * np.pi
COARSE = Accuracy(tolerance=1e-14, method=Taylor(4), max_steps=256)
DOUBLES = np.hypot((1 - RESTITUTION) / (2 * (1 + RESTITUTION)), 1 / RATE)
"""The W at which the motion that bounces in every period gives way to one that repeats in every second."""


class Period(NamedTuple):
    duration: Any


class BouncingBall(AbstractHybridSystem):
    """x' = v, v' = -1; at x = 0 the plane turns the ball round.  A flag besides never changes: it is no deviation."""

    strength: Any
    begin: Any

    def initial(self):
        return (self.begin[0], self.begin[1], jnp.ones(()))

    def segment(self, index):
        return Period(jnp.ones(()) + 0.0 * index)

    def field(self, segment, t_local, x, mode):
        return (x[1], x[0] * 0.0 - 1.0, 0)

    def guards(self, segment, t_local, x, mode):
        return (x[0],)

    def after_event(self, segment, t_local, x, mode, which):
        struck = (1.0 + RESTITUTION) * self.strength * jnp.cos(RATE * t_local)
        return (jnp.zeros_like(x[0]), struck - RESTITUTION * x[1], x[2]), mode

    def state_scale(self):
        return (jnp.ones(()), jnp.ones(()), jnp.ones(()))

    def period(self):
        return (0, 1)


def impact_phase(strength, periods):
    """phi where the ball bounces once in so many periods."""
    return np.arccos(periods * (1 - RESTITUTION) / (2 * (1 + RESTITUTION) * strength))


def mapped(impact, strength):
    """The next impact: phase and velocity after it."""
    phase = impact[0] + 2 * RATE * impact[1]
    return np.array([phase, RESTITUTION * impact[1] + (1 + RESTITUTION) * strength * np.cos(phase)])


def jacobian(impact, strength):
    bend = (1 + RESTITUTION) * strength * np.sin(impact[0] + 2 * RATE * impact[1])
    return np.array([[1.0, 2 * RATE], [-bend, RESTITUTION - 2 * RATE * bend]])


@functools.cache
def finder():
    find = lambda strength, begin: steady_state(BouncingBall(strength, begin), 1.0, COARSE, 1e-10)
    return jax.jit(find)


def settled(strength, periods):
    """From near the motion that bounces once in so many periods."""
    since = 1.0 - impact_phase(strength, periods) / RATE
    velocity = 0.5 * periods + 1e-3
    begin = jnp.array([velocity * since - 0.5 * since**2, velocity - since])
    return jax.tree.map(np.asarray, finder()(jnp.asarray(strength), begin))


@pytest.mark.slow
@pytest.mark.parametrize(("strength", "periods"), [(0.2, 1), (0.36, 2), (0.52, 3)])
def test_a_ball_that_bounces_once_in_some_periods_has_the_multipliers_of_the_closed_form(strength, periods):
    motion = settled(strength, periods)
    assert int(motion.period) == periods and int(motion.failure) == 0
    trace = 1 + RESTITUTION - 2 * (1 + RESTITUTION) * RATE * strength * np.sin(impact_phase(strength, periods))
    expected = np.sort(np.abs(np.roots([1.0, -trace, RESTITUTION])))[::-1]
    np.testing.assert_allclose(motion.multipliers, [*expected, 0.0], rtol=1e-6)
    since = 1.0 - impact_phase(strength, periods) / RATE
    np.testing.assert_allclose(motion.x[:2], [0.5 * periods * since - 0.5 * since**2, 0.5 * periods - since], atol=1e-9)


@pytest.mark.slow
def test_where_the_period_doubles_the_motion_of_two_periods_is_found_with_its_multipliers():
    below, above = settled(0.99 * DOUBLES, 1), settled(1.03 * DOUBLES, 1)
    assert int(below.period) == 1 and int(above.period) == 2
    impact = np.array([impact_phase(1.03 * DOUBLES, 1), 0.5 + 1e-3])
    for _ in range(2000):
        impact = mapped(impact, 1.03 * DOUBLES)
    monodromy = jacobian(mapped(impact, 1.03 * DOUBLES), 1.03 * DOUBLES) @ jacobian(impact, 1.03 * DOUBLES)
    expected = np.sort(np.abs(np.linalg.eigvals(monodromy)))[::-1]
    np.testing.assert_allclose(above.multipliers, [*expected, 0.0], rtol=1e-6)


@pytest.mark.slow
def test_a_motion_of_four_periods_is_said_not_to_repeat():
    motion = settled(0.2467, 1)
    assert int(motion.period) == 0 and np.isnan(motion.multipliers).all() and int(motion.cycles) == 200
