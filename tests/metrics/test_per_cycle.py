"""Metrics of walking (thesis, 3.4 and 3.5) give back what an analytic motion was made of, noise and all."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.metrics import cycle_metrics, force_metrics, turning_points

STROKE, BACK, FREQUENCY = 6.5e-6, 3.2e-6, 5.0
NOISE, QUANTUM = 1e-8, 1e-8


@functools.partial(jax.jit, static_argnames="fall")
def stick_slip(time, fall=0.0, bend=0.0, stroke=STROKE, back=BACK, frequency=FREQUENCY):
    """An end-effector that slips at t = 0, 1/f, ...: back by `back` within `fall`, then forth by `stroke` [m].

    `bend` lifts the middle of the slow flank off its chord, as hysteresis does.
    """
    cycle, phase = jnp.divmod(time * frequency, 1.0)
    fall_share = fall * frequency
    rise = jnp.clip((phase - fall_share) / (1 - fall_share), 0.0)
    drop = jnp.clip(phase / fall_share, 0.0, 1.0) if fall else 1.0
    return cycle * (stroke - back) - back * drop + stroke * rise + 4 * bend * rise * (1 - rise)


def measured(time, seed=0, **made):
    """The same with noise, rounded to the sensor's resolution."""
    noise = np.random.default_rng(seed).normal(0.0, NOISE, len(time))
    return np.round((stick_slip(time, **made) + noise) / QUANTUM) * QUANTUM


def samples(cycles, interval=1e-3):
    """Times in the middles of their intervals, so that rounding puts none on the wrong side of a slip."""
    return (np.arange(round(cycles / FREQUENCY / interval)) + 0.5) * interval


def test_an_ideal_sawtooth_gives_its_stroke_back_slip_efficiency_and_speed():
    time = samples(8)
    found = cycle_metrics(time, stick_slip(time), FREQUENCY, 0.0, 7)
    np.testing.assert_allclose(found.stroke, STROKE, rtol=1e-12)
    np.testing.assert_allclose(found.back_slip, BACK, rtol=1e-12)
    np.testing.assert_allclose(found.net_step, STROKE - BACK, rtol=1e-12)
    np.testing.assert_allclose(found.efficiency, (STROKE - BACK) / STROKE, rtol=1e-12)
    np.testing.assert_allclose(found.speed, FREQUENCY * (STROKE - BACK), rtol=1e-12)
    np.testing.assert_allclose(found.noise, 0.0, atol=1e-18)


def test_backward_motion_is_the_mirror_image():
    time = samples(4)
    forward, backward = (cycle_metrics(time, sign * stick_slip(time), FREQUENCY, 0.0, 3) for sign in (1, -1))
    np.testing.assert_allclose(backward.stroke, -forward.stroke)
    np.testing.assert_allclose(backward.speed, -forward.speed)
    np.testing.assert_allclose(backward.efficiency, forward.efficiency)


@pytest.mark.parametrize(("fall", "bend"), [(0.015, 0.0), (0.0, 0.3e-6)])
def test_neither_a_slip_that_takes_time_nor_a_bent_flank_changes_the_stroke(fall, bend):
    time = samples(6)
    found = cycle_metrics(time, stick_slip(time, fall, bend), FREQUENCY, 0.0, 5, fall)
    np.testing.assert_allclose(found.stroke, STROKE, rtol=1e-12)
    np.testing.assert_allclose(found.back_slip, BACK, rtol=1e-12)
    np.testing.assert_allclose(found.net_step, STROKE - BACK, rtol=1e-12)


def test_noise_and_rounding_leave_no_bias_and_scatter_as_least_squares_says():
    cycles = 400
    time = samples(cycles + 1)
    found = cycle_metrics(time, measured(time), FREQUENCY, 0.0, cycles)
    # Rounding adds a uniform error; a slope scatters by sigma / sqrt(sum of squared times about their mean).
    sigma = np.hypot(NOISE, QUANTUM / np.sqrt(12))
    flank = time[(time >= 0.04) & (time <= 0.16)]
    stroke_error = sigma / np.sqrt(np.sum((flank - flank.mean()) ** 2)) / FREQUENCY
    for entry, truth in [
        (found.stroke, STROKE),
        (found.back_slip, BACK),
        (found.net_step, STROKE - BACK),
        (found.efficiency, (STROKE - BACK) / STROKE),
    ]:
        error = np.std(entry, ddof=1) / np.sqrt(cycles)
        assert abs(np.mean(entry) - truth) < 3 * error
    assert np.std(found.stroke) == pytest.approx(stroke_error, rel=0.15)
    assert np.std(found.net_step) == pytest.approx(sigma * np.sqrt(2 / len(flank)), rel=0.15)
    assert np.sqrt(np.mean(found.noise**2)) == pytest.approx(sigma, rel=0.02)


def test_turning_points_are_exact_without_noise_and_widened_by_it():
    time = samples(50)
    corners = np.arange(50) / FREQUENCY
    time = np.sort(np.concatenate([time, corners - 1e-9, corners + 4e-3 + 1e-9]))
    exact = turning_points(time, stick_slip(time, 4e-3), FREQUENCY, 0.0, 50, 4e-3)
    steps = np.arange(50) * (STROKE - BACK)
    np.testing.assert_allclose(exact.before, steps, atol=1e-12)
    np.testing.assert_allclose(exact.after, steps - BACK, atol=1e-12)
    noise = 0.1e-6  # some samples' worth of the flank, so that several compete for the extreme
    loud = stick_slip(time, 4e-3) + np.random.default_rng(2).normal(0.0, noise, len(time))
    noisy = turning_points(time, loud, FREQUENCY, 0.0, 50, 4e-3)
    assert np.mean(noisy.before - noisy.after) - BACK > noise
    lines = cycle_metrics(time, loud, FREQUENCY, 0.0, 49, 4e-3).back_slip
    assert abs(np.mean(lines) - BACK) < 3 * np.std(lines) / np.sqrt(49)


def test_a_drift_of_the_zero_adds_to_stroke_and_net_step_alike():
    time, drift = samples(5), 1e-6
    still, moving = (cycle_metrics(time, stick_slip(time) + d * time, FREQUENCY, 0.0, 4) for d in (0.0, drift))
    np.testing.assert_allclose(moving.stroke - still.stroke, drift / FREQUENCY, rtol=1e-9)
    np.testing.assert_allclose(moving.net_step - still.net_step, drift / FREQUENCY, rtol=1e-9)


def test_cycles_that_are_not_there_are_nan():
    time = samples(3)
    found = cycle_metrics(time, stick_slip(time), FREQUENCY, 0.0, 5)
    np.testing.assert_array_equal(np.isnan(found.net_step), [False, False, True, True, True])
    few = cycle_metrics(time[::50], stick_slip(time[::50]), FREQUENCY, 0.0, 2)
    assert np.isnan(few.stroke).all()


def test_metrics_work_under_jit_and_vmap_and_have_the_analytic_gradient():
    time = samples(4)
    efficiency = jax.jit(
        lambda stroke, back: cycle_metrics(
            time, stick_slip(time, stroke=stroke, back=back), FREQUENCY, 0.0, 3
        ).efficiency[1]
    )
    backs = jnp.array([1e-6, 2e-6, 7e-6])
    np.testing.assert_allclose(jax.vmap(efficiency, (None, 0))(STROKE, backs), 1 - backs / STROKE, rtol=1e-12)
    slope = jax.grad(efficiency, (0, 1))(STROKE, BACK)
    np.testing.assert_allclose(slope, (BACK / STROKE**2, -1 / STROKE), rtol=1e-10)
    speed = lambda frequency: cycle_metrics(time, stick_slip(time, frequency=frequency), frequency, 0.0, 2).speed[0]
    # 4.9 Hz, so that no sample lies on the end of a fitted part.
    assert jax.grad(speed)(4.9) == pytest.approx(STROKE - BACK, rel=1e-9)


def test_the_gradient_of_a_noiseless_record_is_finite():
    time = samples(4)
    total = lambda shift: sum(jnp.sum(entry) for entry in cycle_metrics(time, stick_slip(time) + shift, 5.0, 0.0, 3))
    assert np.isfinite(jax.grad(total)(jnp.zeros_like(time))).all()


def blocked(time):
    """A force that falls to 0.1 N, rises for a third of the period and stays at 0.4 N [N]."""
    phase = np.mod(time * FREQUENCY, 1.0)
    return np.minimum(0.1 + 0.9 * phase, 0.4)


def test_the_output_force_is_free_of_noise_where_the_highest_sample_is_not():
    cycles, noise = 200, 5e-3
    time = samples(cycles)
    force = blocked(time) + np.random.default_rng(1).normal(0.0, noise, len(time))
    found = force_metrics(time, force, FREQUENCY, 0.0, cycles)
    assert abs(np.mean(found.output) - 0.4) < 3 * np.std(found.output) / np.sqrt(cycles)
    # The expected maximum of 130 normal deviates is 2.6 standard deviations.
    assert np.mean(found.maximum) == pytest.approx(0.4 + 2.6 * noise, abs=0.2 * noise)
    assert np.mean(found.mean) == pytest.approx(np.mean(blocked(time)), abs=noise / np.sqrt(cycles * 200) * 3)


def test_the_output_force_of_a_rising_sawtooth_is_its_corner():
    time = samples(3)
    found = force_metrics(time, 0.4 * np.mod(time * FREQUENCY, 1.0), FREQUENCY, 0.0, 3)
    np.testing.assert_allclose(found.output, 0.4, rtol=1e-12)
    np.testing.assert_allclose(found.minimum, 0.4 * 0.5e-3 * FREQUENCY, rtol=1e-9)
