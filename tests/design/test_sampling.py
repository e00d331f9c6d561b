"""Windows of a recorder: their times, what a recorder can take, and the grid from which they are interpolated."""

import dataclasses

import numpy as np
import pytest

from pdssjax.design.sampling import (
    Schedule,
    contact_schedules,
    graded_grid,
    improved_schedule,
    neighbours,
    possible_schedules,
)

PERIOD, FINEST, DURATION = 0.2, 1e-3, 2.0
BURSTS = Schedule(first=1, windows=4, lead=0.01, samples=10, interval=1e-3, shifts=4)


def test_windows_follow_the_cycles_of_the_drive():
    times = BURSTS.times(PERIOD)
    assert times[:10] == pytest.approx(0.21 + 1e-3 * np.arange(10))
    assert times[10] == pytest.approx(0.41 + 0.25e-3)
    assert BURSTS.count == times.size == 40
    assert BURSTS.times(0.1)[0] == pytest.approx(0.11)


def test_equivalent_time_samples_lie_between_each_other():
    phases = np.sort(np.mod(BURSTS.times(PERIOD), PERIOD))
    assert np.diff(phases) == pytest.approx(np.full(39, 0.25e-3), abs=1e-9)


@pytest.mark.parametrize(
    ("change", "fits"),
    [
        ({}, True),
        ({"interval": 0.5e-3}, False),  # finer than the recorder
        ({"windows": 20}, False),  # longer than the longest record
        ({"samples": 300}, False),  # a window longer than the period
        ({"samples": 4}, False),
        ({"first": -1}, False),
    ],
)
def test_a_recorder_has_limits(change, fits):
    assert dataclasses.replace(BURSTS, **change).fits(PERIOD, FINEST, DURATION) is fits


def test_a_step_is_recorded_once():
    assert not BURSTS.fits(None, FINEST, DURATION)
    assert dataclasses.replace(BURSTS, windows=1, first=0).fits(None, FINEST, DURATION)


@pytest.mark.parametrize("period", [PERIOD, None])
def test_all_schedules_that_are_tried_fit(period):
    found = possible_schedules(period, [0.0, 0.01], 200, 500, FINEST, DURATION)
    assert len(found) > 10
    assert all(schedule.fits(period, FINEST, DURATION) and schedule.count <= 500 for schedule in found)
    ticks = np.array([schedule.interval / FINEST for schedule in found])
    assert ticks == pytest.approx(np.round(ticks))


def test_a_contact_is_sampled_from_the_start_of_its_motion():
    found = contact_schedules(0.1, 200, 500, FINEST, DURATION)
    assert found and all(schedule.times(0.1)[0] == 0.0 and schedule.windows == 1 for schedule in found)


def test_a_grid_is_fine_after_corners_and_covers_the_cycle():
    grid = graded_grid(PERIOD, [0.0, 0.05], 1e-4, DURATION)
    steps = np.diff(grid.times)
    assert np.all(steps > 0) and grid.cycles == 4 and grid.times[-1] == pytest.approx(4 * PERIOD)
    near = steps[np.searchsorted(grid.times, 0.0501)]
    assert near == pytest.approx(1e-4) and steps.max() > 8e-4


def test_between_its_points_a_grid_is_linear_and_before_the_drive_zero():
    grid = graded_grid(None, [0.0], 1e-3, 1.0)
    columns = np.column_stack([grid.times, 2.0 - grid.times])
    times = np.array([-0.1, 0.0123, 0.4567])
    assert grid.interpolated(columns, times) == pytest.approx(
        np.array([[0.0, 0.0], [0.0123, 1.9877], [0.4567, 1.5433]])
    )


def test_beyond_its_cycles_a_walk_goes_on_by_equal_steps():
    grid = graded_grid(PERIOD, [0.0], 1e-4, DURATION)
    walk = lambda t: np.floor(t / PERIOD + 1e-9) * 3.0 + np.sin(2 * np.pi * t / PERIOD)
    times = np.array([0.35, 0.85, 1.33, 1.91])
    found = grid.interpolated(walk(grid.times)[:, None], times)[:, 0]
    assert found == pytest.approx(walk(times), abs=1e-3)


def test_neighbours_have_no_more_samples_and_whole_intervals():
    for other in neighbours(BURSTS, FINEST):
        assert other.count <= BURSTS.count
        assert other.interval / FINEST == pytest.approx(round(other.interval / FINEST))


def test_a_local_search_ends_at_the_best_neighbour():
    score = lambda schedule: abs(schedule.lead - 0.031) + schedule.interval
    best, least = improved_schedule(
        BURSTS, FINEST, lambda schedule: schedule.fits(PERIOD, FINEST, DURATION), score, rounds=40
    )
    assert best.lead == pytest.approx(0.031) and best.interval == FINEST and least == pytest.approx(score(best))
