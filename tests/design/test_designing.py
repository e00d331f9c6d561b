"""Plans of a small rig: what they promise is what a fit of their records has; the samples that a recorder can take."""

import dataclasses

import numpy as np
import pytest
from fabricated_plan import SOURCE

import pdssjax
from pdssjax import Aim, InputError, Limits, Resources, design_experiment
from pdssjax.design import rehearse
from pdssjax.design.sampling import (
    Schedule,
    contact_schedules,
    graded_grid,
    improved_schedule,
    neighbours,
    possible_schedules,
)
from pdssjax.inference import pose

LIMITS = Limits(
    kinds=("platform",),
    waveforms=("step", "sawtooth"),
    voltage=(20.0, 60.0),
    frequency=(10.0, 40.0),
    interval=1e-4,
    duration=0.3,
    noise={"platform": 1e-8},
)
"""A platform alone, whose motion is known in closed form: quick to compile."""
BUDGET = Resources(240, 2)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A rig whose stack is free, and nothing else."""
    file = tmp_path_factory.mktemp("rig") / "rig.toml"
    file.write_text(SOURCE.replace('"friction.sigma1" = { start', '"friction.sigma1" = { value'))
    study = pdssjax.load_study(file, virtual=True)
    fixed = study.with_values({"friction.f_ss": 0.65})
    damped = dataclasses.replace(fixed.parameters["piezo.damping_ratio"], value=None, start=0.18)
    return dataclasses.replace(fixed, parameters=dict(fixed.parameters) | {"piezo.damping_ratio": damped})


@pytest.fixture(scope="module")
def plan(study):
    """Best for all parameters of the stack."""
    return design_experiment(study, BUDGET, limits=LIMITS, draws=1)


def jacobian_errors(study, records):
    """Standard errors [SI] of a fit of these records, by the Jacobian of the fit's own residuals."""
    whole = dataclasses.replace(study, records=tuple(records))
    problem = pose(whole, whole.values(), whole.accuracy)
    free = problem.encode(whole.values())
    jacobian = np.asarray(problem.jacobian(free))
    errors = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return dict(zip(problem.residual.transform.paths, problem.residual.transform.slope(free) * errors, strict=True))


def test_a_plan_keeps_its_budget_and_promises_what_the_fits_jacobian_says(study, plan):
    assert plan.samples <= 240 and len(plan.records) <= 2
    told = jacobian_errors(study, [planned.record(study) for planned in plan.records])
    assert plan.after == pytest.approx(told, rel=1e-6)
    assert all(planned.contributes > 1.0 for planned in plan.records)


def test_a_plan_beats_even_samples_of_the_same_records(study, plan):
    records = [planned.record(study) for planned in plan.records]
    even = [
        dataclasses.replace(r, time=np.linspace(0.0, 0.29, r.time.size), measured=np.zeros(r.time.size))
        for r in records
    ]
    errors = jacobian_errors(study, even)
    gain = np.mean([np.log(errors[path] / plan.after[path]) for path in errors])
    assert np.exp(gain) > 1.5


def test_one_parameter_is_better_known_by_a_plan_for_it(study, plan):
    path = "piezo.gain"
    aimed = design_experiment(study, BUDGET, limits=LIMITS, draws=1, aim=Aim("parameter", (path,)))
    assert aimed.after[path] < plan.after[path]


def test_what_nothing_sees_is_named(study):
    """The platform does not feel the end-effector."""
    mass = dataclasses.replace(study.parameters["effector.mass"], value=None, start=0.086)
    free = dataclasses.replace(study, parameters=dict(study.parameters) | {"effector.mass": mass})
    with pytest.raises(InputError, match=r"found no experiment within the limits that changes with effector\.mass"):
        design_experiment(free, BUDGET, limits=LIMITS, draws=1)


@pytest.mark.slow
def test_a_rehearsal_has_the_errors_that_were_promised(plan):
    rehearsal = rehearse(plan, seed=3)
    assert rehearsal.estimate.converged
    assert rehearsal.ratio == pytest.approx(1.0, rel=0.2)


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
