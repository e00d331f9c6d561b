"""Every voltage: its segments, its values, what it says of itself, its derivatives, and its staircase."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parts import Cycloidal, Sampled, Sawtooth, SecondOrder, Sine, Step, Trapezoid, Triangle

from pdssjax import AbstractDrive
from pdssjax.actuator import ZeroOrderHold
from pdssjax.core import member, members, quantities
from pdssjax.drive.base import Segment, Voltage
from pdssjax.simulation import platform

OWN = {
    f"{name} {number}": drive
    for name in members("drive")
    for number, drive in enumerate(member("drive", name).examples(), 1)
}
SAMPLES = OWN["sampled 2"]
DRIVES = OWN | {"held": ZeroOrderHold(Triangle(30.0, 20.0, 0.3), 1e-3), "held samples": ZeroOrderHold(SAMPLES, 7e-4)}
EVERY = pytest.mark.parametrize("name", DRIVES)
EVERY_OWN = pytest.mark.parametrize("name", OWN)
END = 0.45
COUNT = 1024
"""Segments that are looked at, as many of every drive: another number would be compiled anew."""


@jax.jit
def segments_of(drive, indices) -> Segment:
    return jax.vmap(drive.segment)(indices)


@functools.cache
def segments(name: str) -> Segment:
    """The first segments, as arrays."""
    return jax.tree.map(np.asarray, segments_of(DRIVES[name], np.arange(COUNT, dtype=float)))


@jax.jit
def _voltage_and_derivatives(found: Segment, after) -> tuple:
    parts = lambda x: [jnp.broadcast_to(part, x.shape) for part in found.voltage(x)]
    return jax.jvp(parts, (after,), (jnp.ones_like(after),))


def voltage_at(name: str, part: float) -> tuple[np.ndarray, Voltage, Voltage]:
    """Times at a part of each segment that has some length and begins before `END`, its voltage and the derivatives.

    Of an endless segment its first second.
    """
    found = segments(name)
    begin = np.append(0.0, np.cumsum(found.duration)[:-1])
    kept = (found.duration > 0.0) & (begin < END)
    after = part * np.minimum(found.duration, 1.0)
    both = _voltage_and_derivatives(found, after)
    return (begin + after)[kept], *(Voltage(*(np.asarray(part)[kept] for part in parts)) for parts in both)


def cycle(name: str, later: int = 0) -> Segment:
    """The segments of one period, `later` periods after the first."""
    first, count = DRIVES[name].period()
    return jax.tree.map(lambda leaf: leaf[first + later * count :][:count], segments(name))


def at(drive: AbstractDrive, times) -> np.ndarray:
    """The voltage at times, as many for every drive: another number would be compiled anew."""
    return drive.sampled_at(np.pad(np.asarray(times, float), (0, 4096 - len(times))))[: len(times)]


@EVERY
def test_segments_join_up_to_the_voltage_and_reach_as_far_as_they_say(name):
    drive = DRIVES[name]
    assert np.sum(segments(name).duration[: drive.segments(END)]) >= END
    for part in (0.01, 0.37, 0.99):
        times, voltage, _ = voltage_at(name, part)
        np.testing.assert_allclose(voltage.level, at(drive, times), rtol=0.0, atol=1e-9)
    np.testing.assert_array_equal(at(drive, [-1.0, -1e-9]), 0.0)


@EVERY
def test_slope_and_bend_are_derivatives_of_the_voltage(name):
    _, voltage, derivatives = voltage_at(name, 0.37)
    np.testing.assert_allclose(voltage.slope, derivatives.level, rtol=1e-10, atol=1e-9)
    np.testing.assert_allclose(voltage.bend, derivatives.slope, rtol=1e-10, atol=1e-9)


@EVERY
def test_segments_repeat_where_a_drive_says_so_at_its_frequency(name):
    drive, frequency = DRIVES[name], DRIVES[name].cycle_frequency()
    if name in OWN:  # a staircase has the frequency of its drive, but need not repeat
        assert (frequency is None) == (drive.period() is None)
    if drive.period() is None:
        return
    jax.tree.map(lambda here, later: np.testing.assert_allclose(here, later, 1e-12), cycle(name), cycle(name, 3))
    assert float(frequency) == pytest.approx(1.0 / np.sum(cycle(name).duration), rel=1e-12)
    times = np.linspace(1.02, 1.98, 50) / frequency
    np.testing.assert_allclose(at(drive, times), at(drive, times + 3.0 / frequency), atol=1e-9)


@EVERY
def test_a_drive_has_jumps_and_corners_where_its_voltage_or_its_slope_differs_on_both_sides(name):
    drive = DRIVES[name]
    (_, after, _), (_, before, _) = voltage_at(name, 0.0), voltage_at(name, 1.0)
    steps = after.level - np.append(0.0, before.level[:-1])
    bends = after.slope - np.append(0.0, before.slope[:-1])
    jumps = bool(np.any(np.abs(steps) > 1e-9 * drive.peak()))
    assert drive.has_jumps() == jumps
    assert drive.has_corners() == (jumps or bool(np.any(np.abs(bends) > 1e-6 * drive.peak())))


@EVERY
def test_told_by_its_peak_a_drive_is_the_same(name):
    drive, time = DRIVES[name], np.linspace(-0.1, END, 1000)
    told = drive.with_peak_voltage()
    np.testing.assert_allclose(at(told, time), at(drive, time), rtol=1e-12, atol=1e-12)
    if isinstance(drive, Sawtooth):
        assert told.voltage == pytest.approx(np.sign(drive.voltage) * drive.peak()) and told.told_by == 0.0


@pytest.mark.parametrize("drive", [Sawtooth(30.0, 20.0, 1e-3), SAMPLES], ids=["sawtooth", "sampled"])
def test_what_is_sampled_is_the_voltage_at_the_times(drive):
    time = np.linspace(-0.1, END, 37)
    np.testing.assert_allclose(drive.sampled_at(time), drive.at(jnp.asarray(time)), rtol=1e-12, atol=1e-12)


def test_no_times_have_no_voltages():
    assert Sawtooth().sampled_at(np.zeros(0)).shape == (0,)


@EVERY_OWN
def test_the_peak_is_the_largest_voltage_of_two_periods(name):
    frequency = DRIVES[name].cycle_frequency()
    until = 0.25 if frequency is None else 2.0 / frequency
    # Also just inside every segment, since a jump hides its ends from an even grid.
    ends = np.concatenate([voltage_at(name, part)[0] for part in (1e-9, 1.0 - 1e-9)])
    times = np.concatenate([np.linspace(0.0, until, 2000), ends[ends <= until]])
    assert np.max(np.abs(at(DRIVES[name], times))) == pytest.approx(float(DRIVES[name].peak()), rel=1e-5)


@EVERY
def test_flanks_are_the_segments_of_a_cycle(name):
    flanks = DRIVES[name].flanks()
    if flanks is None:
        return
    found = cycle(name)
    fast, slow = np.argsort(found.duration)
    assert float(flanks.fast) == pytest.approx(found.duration[fast], abs=1e-15)
    rise = found.voltage(found.duration).level - found.voltage(0.0 * found.duration).level
    assert float(flanks.slope) == pytest.approx(float(rise[slow]) / found.duration[slow], rel=1e-12)


@EVERY_OWN
def test_examples_keep_their_conditions_and_a_drive_without_voltage_does_not(name):
    drive = DRIVES[name]
    assert drive.broken_conditions() == {}
    if "voltage" in drive.numbers():
        assert "0 V" in drive.with_numbers({"voltage": 0.0}).broken_conditions()["voltage"]


@pytest.mark.parametrize("name", members("drive"))
def test_numbers_are_taken_and_given_back(name):
    drive = member("drive", name)()
    other = {field: 0.9 * number + 1e-3 for field, number in drive.numbers().items()}
    changed = drive.with_numbers(other)
    assert changed.numbers() == other and type(changed) is type(drive)
    assert set(other) == set(drive.declared())
    traced = jax.jit(lambda numbers: drive.with_numbers(numbers).at(jnp.asarray([0.07])))(other)
    np.testing.assert_allclose(traced, changed.sampled_at(np.array([0.07])), rtol=1e-12)


def test_a_sawtooth_rises_over_its_whole_first_cycle_or_jumps_up_in_every_one():
    forward, backward = (Sawtooth(30.0, 20.0, 1e-3, direction) for direction in ("forward", "backward"))
    times = [0.0, 0.025, 0.05 - 1e-9, 0.0505, 0.051, 0.0755, 0.1 - 1e-9]
    np.testing.assert_allclose(at(forward, times), [0.0, 15.0, 30.0, 15.0, 0.0, 15.0, 30.0], atol=1e-4)
    times = [0.0, 0.0005, 0.001, 0.0255, 0.05 - 1e-9, 0.0505]
    np.testing.assert_allclose(at(backward, times), [0.0, 15.0, 30.0, 15.0, 0.0, 15.0], atol=1e-4)


@pytest.mark.parametrize("direction", ["forward", "backward"])
def test_the_fall_time_can_be_differentiated_at_zero(direction):
    duration = lambda fall: jnp.stack([Sawtooth(64.2, 5.0, fall, direction).segment(k).duration for k in (2, 3)])
    lengths, slopes = jax.jit(lambda fall: jax.jvp(duration, (fall,), (1.0,)))(0.0)
    np.testing.assert_allclose(lengths, [0.0, 0.2], atol=1e-15)
    np.testing.assert_allclose(slopes, [1.0, -1.0])


def test_the_duty_is_the_share_of_the_slow_flank():
    drive = Sawtooth(30.0, 20.0, direction="backward", duty=0.8)
    times = [0.0, 0.005, 0.01, 0.03, 0.05 - 1e-12]
    np.testing.assert_allclose(at(drive, times), [0.0, 15.0, 30.0, 15.0, 0.0], atol=1e-6)
    assert float(drive.segment(1.0).duration) == pytest.approx(0.8 * 0.05)
    assert float(Sawtooth(30.0, 20.0, 1e-3, duty=0.8).segment(3.0).duration) == pytest.approx(0.8 * 0.05 - 1e-3)


def test_a_triangle_peaks_where_its_symmetry_says():
    times = [0.0, 0.0075, 0.015, 0.0325, 0.05]
    np.testing.assert_allclose(at(Triangle(30.0, 20.0, 0.3), times), [0, 15, 30, 15, 0], atol=1e-9)


def test_a_sine_starts_at_rest_and_stays_between_its_ends():
    level = at(Sine(30.0, 20.0), np.linspace(0.0, 0.2, 4001))
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


def test_a_trapezoid_rises_stays_falls_and_rests():
    drive = Trapezoid(30.0, 20.0, 0.4, 5e-3, 1e-2)
    times = [0.0, 0.0025, 0.005, 0.019, 0.02, 0.025, 0.03, 0.049, 0.0525]
    np.testing.assert_allclose(at(drive, times), [0.0, 15.0, 30.0, 30.0, 30.0, 15.0, 0.0, 0.0, 15.0], atol=1e-9)


def test_a_trapezoid_without_flanks_is_a_square_wave():
    times = [-1e-9, 1e-9, 0.02 - 1e-9, 0.02 + 1e-9, 0.05 - 1e-9, 0.05 + 1e-9]
    square = at(Trapezoid(30.0, 20.0, 0.4), times)
    np.testing.assert_array_equal(square, [0.0, 30.0, 30.0, 0.0, 0.0, 30.0])


LENGTHS = [
    (name, field)
    for name in members("drive")
    for field, declared in quantities(member("drive", name)).items()
    if declared.unit == "s" and not declared.positive
]
"""Every length of a waveform that may be zero."""


@pytest.mark.parametrize(("name", "field"), LENGTHS)
def test_a_flank_longer_than_its_cycle_breaks_a_condition(name, field):
    drive = member("drive", name)()
    if drive.cycle_frequency() is not None:
        long = 1.0 / float(drive.cycle_frequency())
        assert set(drive.with_numbers({field: long}).broken_conditions()) == {field}


def test_a_flank_that_is_too_long_leaves_no_plateau_and_breaks_a_condition():
    drive = Trapezoid(30.0, 20.0, 0.4, 0.03, 0.04)
    assert float(drive.segment(1.0).duration) == 0.0
    assert at(drive, [0.02]) == pytest.approx(30.0)
    assert drive.broken_conditions() == {
        "rise_time": "0.03 s, expected less than the part of the period that its width leaves to rise and plateau, "
        "0.02 s",
        "fall_time": "0.04 s, expected less than what its width leaves to fall and rest, 0.03 s",
    }


def test_samples_hold_their_first_voltage_from_the_begin_and_their_last_for_good():
    times = [0.0, 0.005, 0.015, 0.02, 9.0]
    np.testing.assert_allclose(at(Sampled([0.01, 0.02], [4.0, 6.0]), times), [4.0, 4.0, 5.0, 6.0, 6.0])
    np.testing.assert_allclose(at(Sampled([0.01, 0.02], [4.0, 6.0], "held"), times), [4.0, 4.0, 4.0, 6.0, 6.0])


def test_a_held_drive_has_the_value_of_its_drive_at_every_begin():
    held = ZeroOrderHold(Sawtooth(64.0, 5.0), 50e-6)
    ticks = np.arange(0, 12000, 7)
    levels = jax.jit(jax.vmap(held.segment))(ticks.astype(float)).start
    exact = [0.0 if k == 0 else 64.0 * ((k % 4000) / 4000) for k in ticks]
    np.testing.assert_allclose(levels, exact, atol=1e-6)
    np.testing.assert_allclose(at(held, (ticks + 0.5) * 50e-6), exact, atol=1e-6)


def test_a_staircase_answers_for_what_it_holds():
    drive = Sawtooth(30.0, 20.0, 1e-3)
    held = ZeroOrderHold(drive, 2e-3)
    answers = lambda d: (d.cycle_frequency(), d.peak(), d.flanks(), d.numbers(), d.declared())
    assert answers(held) == answers(drive)
    highest = at(held, np.linspace(0.0, END, 2000)).max()
    assert drive.peak() * (1.0 - 1.1 * 2e-3 * 20.0) < highest <= drive.peak()
    assert held.with_numbers({"voltage": 40.0}) == ZeroOrderHold(drive.with_numbers({"voltage": 40.0}), 2e-3)


@pytest.mark.parametrize(("name", "field"), LENGTHS)
def test_a_motion_is_differentiated_by_a_length_that_is_zero_or_nearly_so(name, field):
    nominal = member("drive", name)()
    drive = nominal.with_numbers({f: 200.0 for f in nominal.numbers() if f == "frequency"})
    times, count = jnp.linspace(1e-4, 8e-3, 60), drive.segments(8e-3)
    moved = lambda length: platform(SecondOrder(), drive.with_numbers({field: length}), times, count)
    run = jax.jit(lambda length: jax.jvp(moved, (length,), (1.0,)))
    h = 1e-7
    at = lambda length: run(jnp.asarray(length))[0]
    # At zero only one side is there: the three-point formula of second order.
    expected = {
        0.0: (-3.0 * at(0.0) + 4.0 * at(h) - at(2.0 * h)) / (2.0 * h),
        3e-6: (at(3e-6 + h) - at(3e-6 - h)) / (2.0 * h),
    }
    for length, differences in expected.items():
        slope = run(jnp.asarray(length))[1]
        assert float(jnp.abs(differences).max()) > 0.0
        np.testing.assert_allclose(slope, differences, rtol=0.0, atol=2e-4 * float(jnp.abs(differences).max()))


BY_EVERY_NUMBER = {
    "triangle": Triangle(30.0, 20.0, 0.3),
    "sine, shifted": Sine(30.0, 20.0, 5.0, 1.0),
    "cycloidal": Cycloidal(30.0, 20.0, 1e-3),
    "held samples": ZeroOrderHold(SAMPLES, 7e-4),
    "sawtooth, duty 80 %": Sawtooth(30.0, 20.0, duty=0.8),
    "trapezoid": Trapezoid(30.0, 20.0, 0.4, 5e-3, 1e-2),
}


@pytest.mark.parametrize("name", BY_EVERY_NUMBER)
def test_the_platform_has_the_derivatives_of_central_differences_in_every_number_of_a_drive(name):
    leaves, structure = jax.tree.flatten(jax.tree.map(lambda leaf: jnp.asarray(leaf, float), BY_EVERY_NUMBER[name]))
    times, count = jnp.linspace(1e-3, 0.119, 30), BY_EVERY_NUMBER[name].segments(0.12)

    def motion(change):
        # Neither what is 0, the end of its range, nor a choice.
        moved = [leaf + change * (0.01 + 0.1 * jnp.abs(leaf)) * ((leaf != 1.0) & (leaf != 0.0)) for leaf in leaves]
        return platform(SecondOrder(), jax.tree.unflatten(structure, moved), times, count)

    both = jax.jit(lambda change: jax.jvp(motion, (change,), (1.0,)))
    expected = (both(1e-7)[0] - both(-1e-7)[0]) / 2e-7
    assert float(jnp.abs(expected).max()) > 1e-8
    np.testing.assert_allclose(both(0.0)[1], expected, rtol=0.0, atol=2e-5 * float(jnp.abs(expected).max()))


def test_a_step_of_one_sample_is_the_step():
    times = jnp.linspace(0.0, 0.01, 50)
    moved = jax.jit(lambda drive: platform(SecondOrder(), drive, times, 2))
    np.testing.assert_allclose(moved(Sampled([0.0], [48.2])), moved(Step(48.2)), atol=1e-18)
