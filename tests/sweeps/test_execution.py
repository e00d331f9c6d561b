"""Blocks run on threads, processes or whatever executor: the same numbers, few in flight, and failures are told."""

import dataclasses
import json
import multiprocessing
from concurrent.futures import Executor, Future, ProcessPoolExecutor

import numpy as np
import pytest
from quick_blocks import found_at, quick as quick, study as study

import pdssjax
from pdssjax import Accuracy, InputError, InputWarning, OneStep
from pdssjax.sweeps import POINT_FAILURES, Grid, execution, plan_sweep
from pdssjax.sweeps.execution import differences, job_document, job_text, point_function

OVER = {"drive.voltage": np.linspace(20.0, 80.0, 30), "drive.frequency": np.linspace(2.0, 50.0, 20)}
"""600 points: ten blocks."""


class Later(Executor):
    """Runs a task only when it holds three or is asked for a result: tells how many it held at most."""

    def __init__(self):
        self.held, self.most, self.sent = [], 0, []

    def submit(self, task, /, *given):
        future = Future()
        self.sent.append(given)
        self.held.append((future, task, given))
        self.most = max(self.most, len(self.held))
        if len(self.held) == 3:
            self.run()
        return future

    def run(self):
        for future, task, given in self.held:
            try:
                future.set_result(task(*given))
            except Exception as error:
                future.set_exception(error)
        self.held = []


def test_an_executor_finds_what_threads_find(study, quick):
    here = pdssjax.sweep(study, OVER, workers=2)
    executor = Later()
    there = pdssjax.sweep(
        study, OVER | {"drive.frequency": OVER["drive.frequency"][:-2]}, executor=executor, in_flight=3
    )
    assert executor.most == 3
    np.testing.assert_array_equal(there.net_step, here.net_step[:, :-2])
    np.testing.assert_allclose(here.net_step.values.ravel(), found_at(Grid(OVER).values())[:, 0])


def test_only_plain_data_is_sent_and_the_job_is_rebuilt_from_it(study, quick):
    executor = Later()
    pdssjax.sweep(study, {"drive.voltage": np.linspace(1.0, 2.0, 192)}, executor=executor, in_flight=3)
    for text, points in executor.sent:
        assert (type(text), type(points)) == (str, np.ndarray)
    for asked, cycles in ((study, 4), (study, "steady"), (dataclasses.replace(study, rests_under_load=True), 4)):
        planned = plan_sweep(asked, OVER, accuracy=Accuracy(tolerance=1e-10), cycles=cycles)
        assert planned.document["cycles"] == cycles
        again = point_function(json.loads(job_text(planned.document)))
        assert job_document(again) == planned.document
        assert again.accuracy.tolerance == 1e-10 and again.models == planned.function.models == asked.models


def test_a_worker_with_another_version_is_told_in_a_line(study, quick, monkeypatch):
    of_another = lambda document: json.dumps(document | {"pdssjax": "0.0.9"})
    monkeypatch.setattr(execution, "job_text", of_another)
    with pytest.raises(InputError, match=r"found pdssjax .* on a worker, expected 0\.0\.9 as here"):
        pdssjax.sweep(study, {"drive.voltage": np.linspace(1.0, 2.0, 192)}, executor=Later(), in_flight=3)


def test_a_step_method_that_does_not_travel_is_refused_before_any_work(study, quick):
    with pytest.raises(InputError, match="expected a Taylor series"):
        pdssjax.sweep(study, OVER, executor=Later(), accuracy=Accuracy(method=OneStep()))
    assert not quick


def test_a_block_that_cannot_be_computed_is_nan_and_says_so(study, quick, monkeypatch):
    def compute_block(function, points):
        if (points[:, 0] > 79.0).any() and (points[:, 1] > 49.0).any():
            raise MemoryError("no room")
        return found_at(points)

    monkeypatch.setattr(execution, "compute_block", compute_block)
    with pytest.warns(InputWarning, match="MemoryError: no room"):
        data = pdssjax.sweep(study, OVER)
    failed = data.failure.values == POINT_FAILURES.index("its block of points could not be computed")
    assert 0 < failed.sum() <= 128 and np.isnan(data.net_step.values[failed]).all()
    assert np.isfinite(data.net_step.values[~failed]).all()


def test_what_fails_at_once_is_raised(study, monkeypatch):
    def compute_block(function, points):
        raise TypeError("a mistake")

    monkeypatch.setattr(execution, "compute_block", compute_block)
    with pytest.raises(TypeError, match="a mistake"):
        pdssjax.sweep(study, OVER)


def test_points_whose_drive_contradicts_itself_are_skipped(study, quick):
    data = pdssjax.sweep(study, {"drive.frequency": [5.0, 50.0], "drive.fall_time": [0.0, 0.03]})
    np.testing.assert_array_equal(
        data.failure == POINT_FAILURES.index(POINT_FAILURES[3]), [[False, False], [False, True]]
    )
    assert "skipped" in POINT_FAILURES[3] and not any((block[:, 1] * block[:, 0] > 1).any() for block in quick)


def test_differences_between_jobs_are_named(study):
    document = plan_sweep(study, OVER).document
    other = plan_sweep(study.with_values({"friction.f_ss_a": 0.5}), OVER, cycles=3).document
    assert differences(document, other) == ["cycles: 3, not 4", "parameters.friction.f_ss_a: 0.5, not 0.7964"]


@pytest.mark.slow
def test_processes_that_were_spawned_find_the_same_to_the_last_bit(study):
    over = {"drive.voltage": [30.0, 64.0], "drive.frequency": [20.0, 40.0]}
    here = pdssjax.sweep(study, over)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = pdssjax.sweep(study, over, executor=pool)
    np.testing.assert_array_equal(there.net_step, here.net_step)


def test_blocks_that_are_done_together_come_in_their_order():
    """One that breaks the sweep off would else come before one that was computed, which is lost then."""

    def at_once(number):
        future = Future()
        future.set_result(number)
        return future

    assert [number for number, _ in execution._completed(at_once, iter(range(40)), 40)] == list(range(40))
