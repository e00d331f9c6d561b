"""The sensor's low-pass and delay, tilt, the force sensor in the way: each against another route."""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float
from parts import AnisotropicLuGre, Sawtooth, SecondOrder, SimplifiedLuGre, Static, Step
from scipy.integrate import cumulative_simpson

from pdssjax import Accuracy, Actuator, Effector, Sensor, Stop, Taylor
from pdssjax.actuator import GRAVITY, DrivenPlatform
from pdssjax.integration import integrate_steps, states_at
from pdssjax.simulation import STOP_FORCE, PlatformOnly, StickSlip, sensor_samples

UM = 1e6
QUICK = Accuracy(method=Taylor(10))
"""Compiled in two thirds of the time."""
DRIVE = Sawtooth(64.0, 50.0, 5e-4)
TIMES = jnp.linspace(0.0, 0.05, 20001)
"""Dense enough for a quadrature of the low-pass."""
LEVEL = Effector()
FAR = Stop(gap=1.0)
"""Out of reach."""


class Moved(NamedTuple):
    """All of one run."""

    on_stop: Float[Array, " samples"]
    """The force [N]."""
    platform: Float[Array, " samples"]
    effector: Float[Array, " samples"]
    speed: Float[Array, " samples"]
    """Of the end-effector [m/s]."""
    friction: Float[Array, " samples"]


def run(stop, effector=LEVEL):
    """The true motion, with and without a stop in reach: one program for all stops and effectors."""
    return _run(stop, effector)


@jax.jit
def _run(stop, effector):
    actuator = Actuator(SecondOrder(), SimplifiedLuGre(), effector, stop=stop)
    system = StickSlip(actuator, DRIVE, Sensor(filters=False))
    x, segment, t_local, mode = states_at(system, integrate_steps(system, TIMES[-1], QUICK), TIMES)
    y, w = jax.vmap(actuator.driven_platform.platform)(x.driven)
    friction = jax.vmap(system.force)(segment, t_local, x, mode)
    return Moved(jax.vmap(system.shown_force)(x), y, y - x.d, w - x.v, friction)


@jax.jit
def seen_and_slope(bandwidth, delay, on_platform, direction):
    """What is shown, and its derivative along a direction of bandwidth and delay: one program for both."""
    actuator = Actuator(SecondOrder(), SimplifiedLuGre())

    def shown(bandwidth, delay):
        return sensor_samples(StickSlip(actuator, DRIVE, Sensor(bandwidth, delay), on_platform), TIMES, QUICK)

    return jax.jvp(shown, (bandwidth, delay), direction)


def seen(bandwidth, delay, on_platform):
    return seen_and_slope(bandwidth, delay, on_platform, (0.0, 0.0))[0]


@jax.jit
def seen_unloaded(bandwidth, delay):
    return sensor_samples(
        PlatformOnly(Actuator(SecondOrder(), SimplifiedLuGre()).driven_platform, DRIVE, Sensor(bandwidth, delay)),
        TIMES,
        QUICK,
    )


def low_passed(motion: np.ndarray, bandwidth: float) -> np.ndarray:
    """The convolution of a motion that starts from 0 with the filter's decay, by Simpson's rule."""
    time, pole = np.asarray(TIMES), 2.0 * np.pi * bandwidth
    grown = cumulative_simpson(motion * np.exp(pole * (time - time[-1])), x=time, initial=0.0)
    return pole * np.exp(-pole * (time - time[-1])) * grown


@pytest.mark.parametrize("on_platform", [0.0, 1.0])
def test_the_sensor_shows_the_motion_low_passed(on_platform):
    true = run(FAR)
    motion = np.asarray(true.platform if on_platform else true.effector)
    shown = np.asarray(seen(300.0, 0.0, on_platform))
    assert np.ptp(motion - shown) * UM > 0.1
    np.testing.assert_allclose(shown * UM, low_passed(motion, 300.0) * UM, atol=2e-5)


def test_the_platform_alone_is_seen_like_the_platform_of_the_actuator():
    np.testing.assert_allclose(
        np.asarray(seen_unloaded(300.0, 1e-4)) * UM, np.asarray(seen(300.0, 1e-4, 1.0)) * UM, atol=1e-5
    )


def test_the_delay_shifts_the_record():
    late, now = np.asarray(seen(300.0, 2.5e-3, 0.0)), np.asarray(seen(300.0, 0.0, 0.0))
    np.testing.assert_allclose(late[1000:] * UM, now[:-1000] * UM, atol=1e-7)
    assert (late[:1000] == 0.0).all()


def test_a_jump_of_the_platform_is_shown_low_passed():
    volts, bandwidth, times = 60.0, 100.0, np.linspace(0.0, 0.01, 101)
    platform = PlatformOnly(DrivenPlatform(Static()), Step(volts), Sensor(bandwidth))
    shown = jax.jit(lambda times: sensor_samples(platform, times, Accuracy()))(jnp.asarray(times))
    expected = Static().gain * volts * (1.0 - np.exp(-2.0 * np.pi * bandwidth * times))
    np.testing.assert_allclose(shown, expected, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("parameter", [0, 1])
def test_bandwidth_and_delay_can_be_differentiated(parameter):
    given, step = np.array([300.0, 1.013e-4]), (0.03, 1e-8)[parameter]
    moved = lambda by: np.asarray(seen(*map(float, given + by * np.eye(2)[parameter]), 0.0))
    differences = (moved(step) - moved(-step)) / (2.0 * step)
    _, slope = seen_and_slope(*map(float, given), 0.0, tuple(map(float, np.eye(2)[parameter])))
    assert np.abs(slope - differences).max() < 1e-4 * np.abs(differences).max()


def test_a_tilt_is_a_load():
    angle = 0.02
    tilted, loaded = run(FAR, Effector(tilt=angle)), run(FAR, Effector(load=0.086 * GRAVITY * math.sin(angle)))
    level = run(FAR)
    np.testing.assert_allclose(tilted.effector * UM, loaded.effector * UM, atol=1e-6)
    assert (tilted.effector[-1] - level.effector[-1]) * UM > 0.01


def test_the_force_sensor_is_pushed_by_what_the_balance_of_forces_leaves():
    stop = Stop(stiffness=2e5, dissipation=20.0, gap=1e-6)
    force, _, x, w, friction = (np.asarray(a) for a in run(stop))
    touching = x > 1e-6
    assert 0.2 < touching.mean() < 0.9
    assert (force[~touching] == 0.0).all() and (force >= -1e-9).all()
    np.testing.assert_allclose(force[force > 0], (2e5 * (x - 1e-6) * (1.0 + 20.0 * w))[force > 0], atol=1e-9)
    # Newton's law over the whole record: impulse of friction less that of the sensor is the momentum.
    impulse = cumulative_simpson(friction - force, x=np.asarray(TIMES), initial=0.0)
    assert np.abs(impulse - 0.086 * w).max() < 2e-3 * np.abs(0.086 * w).max()


def test_a_soft_sensor_feels_less_and_none_is_pushed_further_than_the_contact_can_hold():
    held = [np.asarray(run(Stop(stiffness=k)).on_stop).max() for k in (1e3, 1e5)]
    assert held[0] < held[1] < 1.3 * SimplifiedLuGre().f_ss


@pytest.mark.slow
def test_the_gradient_of_the_force_is_right():
    stiffness, step = 1e5, 10.0
    force = lambda k: run(Stop(stiffness=k)).on_stop
    differences = (np.asarray(force(stiffness + step)) - np.asarray(force(stiffness - step))) / (2 * step)
    slope = np.asarray(jax.jvp(force, (jnp.asarray(stiffness),), (jnp.asarray(1.0),))[1])
    # At the instants of touching the slope jumps; there differences straddle it.
    wrong = np.abs(slope - differences) > 1e-3 * np.abs(differences).max()
    assert wrong.mean() < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [1e4, 1e5])
def test_a_contact_that_rests_before_it_touches_wakes_and_is_differentiated(stiffness):
    # In the deflection state ties at v = 0 are many; at rest, reversals of rounding size are no events.
    times = jnp.linspace(0.0, 2.0, 401)

    @jax.jit
    def force(k):
        drive = Sawtooth(64.0, 5.0, 5e-4)
        actuator = Actuator(SecondOrder(), AnisotropicLuGre(), stop=Stop(stiffness=k))
        system = StickSlip(actuator, drive, Sensor(filters=False))
        return sensor_samples(system, times, Accuracy(max_steps=16000), STOP_FORCE)

    step = 3e-5 * stiffness
    differences = (np.asarray(force(stiffness + step)) - np.asarray(force(stiffness - step))) / (2 * step)
    slope = np.asarray(jax.jvp(force, (jnp.asarray(stiffness),), (jnp.asarray(1.0),))[1])
    assert np.isfinite(slope).all()
    assert (np.abs(slope - differences) > 3e-3 * np.abs(differences).max()).mean() < 0.01
