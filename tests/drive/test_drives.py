"""Every voltage: its segments, its values, its curvature, its derivatives, and what a converter makes of it."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax.actuator import ZeroOrderHold
from pdssjax.core import member, members
from pdssjax.drive.cycloidal import Cycloidal
from pdssjax.drive.sampled import Sampled
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.drive.sine import Sine
from pdssjax.drive.step import Step
from pdssjax.drive.trapezoid import Trapezoid
from pdssjax.drive.triangle import Triangle
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import platform

OWN = [drive for name in members("drive") for drive in member("drive", name).examples()]
SAMPLES = OWN[[type(drive) for drive in OWN].index(Sampled) + 1]
DRIVES = {str(drive): drive for drive in OWN} | {
    "held": ZeroOrderHold(Triangle(30.0, 20.0, 0.3), 1e-3),
    "held samples": ZeroOrderHold(SAMPLES, 7e-4),
}
EVERY = pytest.mark.parametrize("drive", DRIVES.values(), ids=DRIVES)


def pieces(drive, until):
    """(begin, segment) of every segment of some length."""
    segments = [drive.segment(jnp.asarray(float(k))) for k in range(drive.segments(until))]
    begins = itertools.accumulate((float(s.duration) for s in segments), initial=0.0)
    return [(b, s) for b, s in zip(begins, segments, strict=False) if s.duration > 0 and b < until]


@EVERY
def test_segments_join_up_to_the_voltage_and_reach_as_far_as_they_say(drive):
    found = pieces(drive, 0.17)
    for begin, segment in found:
        elapsed = np.linspace(0.01, 0.99, 9) * min(float(segment.duration), 1.0)
        shown = [float(segment.voltage(x).level) for x in elapsed]
        np.testing.assert_allclose(shown, drive.at(jnp.asarray(begin + elapsed)), rtol=0.0, atol=1e-9)
    last, segment = found[-1]
    assert last + float(segment.duration) >= 0.17
    np.testing.assert_array_equal(drive.at(jnp.asarray([-1.0, -1e-9])), 0.0)


@EVERY
def test_slope_and_bend_are_derivatives_of_the_voltage(drive):
    for _, segment in pieces(drive, 0.12):
        after = 0.37 * min(float(segment.duration), 0.1)
        level = lambda x, s=segment: jnp.asarray(s.voltage(x).level, float)
        slope = lambda x, s=segment: jnp.asarray(s.voltage(x).slope, float)
        voltage = segment.voltage(after)
        assert float(voltage.slope) == pytest.approx(float(jax.grad(level)(after)), rel=1e-10, abs=1e-9)
        assert float(voltage.bend) == pytest.approx(float(jax.grad(slope)(after)), rel=1e-10, abs=1e-9)


@EVERY
def test_segments_repeat_where_a_drive_says_so(drive):
    if drive.period() is None:
        return
    first, count = drive.period()
    for k in range(first, first + count):
        here, later = (jax.tree.leaves(drive.segment(jnp.asarray(float(i)))) for i in (k, k + 3 * count))
        np.testing.assert_array_equal(here, later)
    cycle = 1.0 / drive.cycle_frequency()
    times = cycle * jnp.linspace(1.02, 1.98, 50)
    np.testing.assert_allclose(drive.at(times), drive.at(times + 3.0 * cycle), atol=1e-9)


def test_the_duty_is_the_share_of_the_slow_flank():
    drive = Sawtooth(30.0, 20.0, direction="backward", duty=0.8)
    times = jnp.asarray([0.0, 0.005, 0.01, 0.03, 0.05 - 1e-12])
    np.testing.assert_allclose(drive.at(times), [0.0, 15.0, 30.0, 15.0, 0.0], atol=1e-6)
    assert float(drive.segment(1.0).duration) == pytest.approx(0.8 * 0.05)
    assert float(Sawtooth(30.0, 20.0, 1e-3, duty=0.8).segment(3.0).duration) == pytest.approx(0.8 * 0.05 - 1e-3)


def test_a_duty_of_one_is_the_plain_sawtooth():
    times = jnp.linspace(0.0, 0.3, 301)
    np.testing.assert_array_equal(Sawtooth(30.0, 20.0, 1e-3).at(times), Sawtooth(30.0, 20.0, 1e-3, duty=1.0).at(times))


def test_a_triangle_peaks_where_its_symmetry_says():
    np.testing.assert_allclose(
        Triangle(30.0, 20.0, 0.3).at(jnp.asarray([0.0, 0.0075, 0.015, 0.0325, 0.05])), [0, 15, 30, 15, 0], atol=1e-9
    )


def test_a_sine_starts_at_rest_and_stays_between_its_ends():
    level = np.asarray(Sine(30.0, 20.0).at(jnp.linspace(0.0, 0.2, 4001)))
    assert (level[0], level.min(), level.max()) == (0.0, 0.0, pytest.approx(30.0))
    voltage = Sine(30.0, 20.0).segment(jnp.zeros(())).voltage(0.0)
    assert (float(voltage.slope), float(voltage.bend)) == (0.0, pytest.approx(15.0 * (40 * np.pi) ** 2))


@pytest.mark.parametrize("direction", ["forward", "backward"])
def test_a_cycloid_begins_and_ends_without_slope_and_curvature(direction):
    segment = Cycloidal(30.0, 20.0, 1e-3, direction).segment(jnp.asarray(3.0))
    ends = [segment.voltage(x) for x in (0.0, float(segment.duration))]
    levels = [0.0, 30.0] if direction == "forward" else [30.0, 0.0]
    assert [float(end.level) for end in ends] == pytest.approx(levels, abs=1e-9)
    assert [float(end.slope) for end in ends] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert [float(end.bend) for end in ends] == pytest.approx([0.0, 0.0], abs=1e-6)
    assert abs(float(segment.voltage(0.5 * segment.duration).slope)) == pytest.approx(2 * 30.0 / 0.049)


def test_samples_hold_their_first_voltage_from_the_begin_and_their_last_for_good():
    drive = Sampled([0.01, 0.02], [4.0, 6.0])
    np.testing.assert_allclose(drive.at(jnp.asarray([0.0, 0.005, 0.015, 0.02, 9.0])), [4.0, 4.0, 5.0, 6.0, 6.0])
    held = Sampled([0.01, 0.02], [4.0, 6.0], "held")
    np.testing.assert_allclose(held.at(jnp.asarray([0.005, 0.015, 0.02, 9.0])), [4.0, 4.0, 6.0, 6.0])


def test_a_held_drive_has_the_value_of_its_drive_at_every_begin():
    drive = Sawtooth(64.0, 5.0)
    held = ZeroOrderHold(drive, 50e-6)
    ticks = np.arange(0, 12000, 7)
    levels = jax.vmap(held.segment)(jnp.asarray(ticks, float)).start
    exact = [0.0 if k == 0 else 64.0 * ((k % 4000) / 4000) for k in ticks]
    np.testing.assert_allclose(levels, exact, atol=1e-6)
    np.testing.assert_allclose(held.at(jnp.asarray((ticks + 0.5) * 50e-6)), exact, atol=1e-6)


BY_EVERY_NUMBER = {
    "triangle": Triangle(30.0, 20.0, 0.3),
    "sine, shifted": Sine(30.0, 20.0, 5.0, 1.0),
    "cycloidal": Cycloidal(30.0, 20.0, 1e-3),
    "sampled": SAMPLES,
    "held samples": ZeroOrderHold(SAMPLES, 7e-4),
    "sawtooth, duty 80 %": Sawtooth(30.0, 20.0, duty=0.8),
    "trapezoid": Trapezoid(30.0, 20.0, 0.4, 5e-3, 1e-2),
}


@pytest.mark.parametrize("name", BY_EVERY_NUMBER)
def test_the_platform_has_the_derivatives_of_central_differences_in_every_number_of_a_drive(name):
    leaves, structure = jax.tree.flatten(jax.tree.map(lambda leaf: jnp.asarray(leaf, float), BY_EVERY_NUMBER[name]))
    times, count = jnp.linspace(1e-3, 0.119, 30), BY_EVERY_NUMBER[name].segments(0.12)

    @jax.jit
    def motion(change):
        # Neither what is 0, the end of its range, nor a choice.
        moved = [leaf + change * (0.01 + 0.1 * jnp.abs(leaf)) * ((leaf != 1.0) & (leaf != 0.0)) for leaf in leaves]
        return platform(SecondOrder(), jax.tree.unflatten(structure, moved), times, count)

    expected = (motion(1e-7) - motion(-1e-7)) / 2e-7
    slope = jax.jit(jax.jacfwd(motion))(0.0)
    assert float(jnp.abs(expected).max()) > 1e-8
    np.testing.assert_allclose(slope, expected, rtol=0.0, atol=2e-5 * float(jnp.abs(expected).max()))


def test_a_step_of_one_sample_is_the_step():
    times = jnp.linspace(0.0, 0.01, 50)
    expected = platform(SecondOrder(), Step(48.2), times, 2)
    np.testing.assert_allclose(platform(SecondOrder(), Sampled([0.0], [48.2]), times, 2), expected, atol=1e-18)
