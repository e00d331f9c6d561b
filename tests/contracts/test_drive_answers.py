"""What every waveform says of itself is what its segments do: frequency, jumps, peak, flanks."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import AbstractDrive
from pdssjax.actuator import ZeroOrderHold
from pdssjax.core import member, members, quantities
from pdssjax.drive.base import Segment
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import platform

NOMINAL = [member("drive", name)() for name in members("drive")]
DRIVES = [drive for name in members("drive") for drive in member("drive", name).examples()]
EVERY = pytest.mark.parametrize("drive", DRIVES, ids=str)
END = 0.45


def pieces(drive: AbstractDrive) -> list[tuple[float, Segment]]:
    """(begin, segment) of every segment of some length that begins before `END`."""
    segments = [drive.segment(jnp.asarray(float(k))) for k in range(drive.segments(END))]
    begins = itertools.accumulate((float(s.duration) for s in segments), initial=0.0)
    return [(b, s) for b, s in zip(begins, segments, strict=False) if s.duration > 0 and b < END]


def corner_steps(drive: AbstractDrive) -> list[float]:
    """By how much [V] the voltage differs on both sides of every corner, that at t = 0 included."""
    before, steps = 0.0, []
    for _, segment in pieces(drive):
        steps.append(float(segment.voltage(0.0).level) - before)
        before = float(segment.voltage(min(float(segment.duration), 1.0)).level)
    return steps


@EVERY
def test_the_frequency_is_one_over_the_durations_of_a_period(drive):
    frequency = drive.cycle_frequency()
    assert (frequency is None) == (drive.period() is None)
    if frequency is not None:
        first, count = drive.period()
        durations = [float(drive.segment(jnp.asarray(float(k))).duration) for k in range(first, first + count)]
        assert float(frequency) == pytest.approx(1.0 / sum(durations), rel=1e-12)


@EVERY
def test_a_drive_has_jumps_where_its_voltage_differs_on_both_sides_of_a_corner(drive):
    assert drive.has_jumps() == any(abs(step) > 1e-9 * drive.peak() for step in corner_steps(drive))


@EVERY
def test_what_is_sampled_is_the_voltage_at_the_times(drive):
    time = np.linspace(-0.1, END, 37)
    np.testing.assert_allclose(drive.sampled_at(time), drive.at(jnp.asarray(time)), rtol=1e-12, atol=1e-12)


def test_no_times_have_no_voltages():
    assert Sawtooth().sampled_at(np.zeros(0)).shape == (0,)


@EVERY
def test_told_by_its_peak_a_drive_is_the_same(drive):
    told, time = drive.with_peak_voltage(), jnp.linspace(-0.1, END, 1001)
    np.testing.assert_allclose(told.at(time), drive.at(time), rtol=1e-12, atol=1e-12)
    if isinstance(drive, Sawtooth):
        assert told.voltage == pytest.approx(np.sign(drive.voltage) * drive.peak()) and told.told_by == 0.0


@EVERY
def test_a_drive_has_corners_where_its_voltage_or_its_rate_differs_on_both_sides(drive):
    before, bends = 0.0, any(abs(step) > 1e-9 * drive.peak() for step in corner_steps(drive))
    for _, segment in pieces(drive):
        lasts = min(float(segment.duration), 1.0)
        bends |= abs(float(segment.voltage(0.0).slope) - before) > 1e-6 * drive.peak()
        before = float(segment.voltage(lasts).slope)
    assert drive.has_corners() == bends


@EVERY
def test_the_peak_is_the_largest_voltage_of_two_periods(drive):
    frequency = drive.cycle_frequency()
    until = 0.25 if frequency is None else 2.0 / frequency
    # Also just inside every piece, since a jump hides its ends from an even grid.
    ends = [begin + part * min(float(s.duration), 1.0) for begin, s in pieces(drive) for part in (1e-9, 1.0 - 1e-9)]
    times = np.concatenate([np.linspace(0.0, until, 20001), [t for t in ends if t <= until]])
    assert float(np.max(np.abs(drive.at(jnp.asarray(times))))) == pytest.approx(float(drive.peak()), rel=1e-6)


@EVERY
def test_flanks_are_the_pieces_of_a_cycle(drive):
    flanks = drive.flanks()
    if flanks is None:
        return
    first, count = drive.period()
    cycle = [drive.segment(jnp.asarray(float(k))) for k in range(first, first + count)]
    fast, slow = sorted(cycle, key=lambda segment: float(segment.duration))
    assert float(flanks.fast) == pytest.approx(float(fast.duration), abs=1e-15)
    rise = float(slow.voltage(slow.duration).level - slow.voltage(0.0).level)
    assert float(flanks.slope) == pytest.approx(rise / float(slow.duration), rel=1e-12)


@pytest.mark.parametrize("drive", NOMINAL, ids=str)
def test_numbers_are_taken_and_given_back(drive):
    other = {field: 0.9 * number + 1e-3 for field, number in drive.numbers().items()}
    changed = drive.with_numbers(other)
    assert changed.numbers() == other and type(changed) is type(drive)
    assert set(other) == set(drive.declared())
    traced = jax.jit(lambda numbers: drive.with_numbers(numbers).at(jnp.asarray([0.07])))(other)
    np.testing.assert_allclose(traced, changed.at(jnp.asarray([0.07])), rtol=1e-12)


LENGTHS = [
    (name, field)
    for name in members("drive")
    for field, declared in quantities(member("drive", name)).items()
    if declared.unit == "s" and not declared.positive
]
"""Every length of a waveform that may be zero."""


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


@EVERY
def test_examples_keep_their_conditions_and_a_drive_without_voltage_does_not(drive):
    assert drive.broken_conditions() == {}
    if "voltage" in drive.numbers():
        assert "0 V" in drive.with_numbers({"voltage": 0.0}).broken_conditions()["voltage"]


@pytest.mark.parametrize(("name", "field"), LENGTHS)
def test_a_flank_longer_than_its_cycle_breaks_a_condition(name, field):
    drive = member("drive", name)()
    if drive.cycle_frequency() is not None:
        long = 1.0 / float(drive.cycle_frequency())
        assert set(drive.with_numbers({field: long}).broken_conditions()) == {field}


def test_a_staircase_answers_for_what_it_holds():
    drive = Sawtooth(30.0, 20.0, 1e-3)
    held = ZeroOrderHold(drive, 2e-3)
    answers = lambda d: (d.cycle_frequency(), d.peak(), d.flanks(), d.numbers(), d.declared())
    assert answers(held) == answers(drive) and held.has_jumps()
    assert any(abs(step) > 0.0 for step in corner_steps(held))
    highest = max(float(segment.start) for _, segment in pieces(held))
    assert drive.peak() * (1.0 - 1.1 * 2e-3 * 20.0) < highest <= drive.peak()
    assert held.with_numbers({"voltage": 40.0}) == ZeroOrderHold(drive.with_numbers({"voltage": 40.0}), 2e-3)
