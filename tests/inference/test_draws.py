"""Random numbers of draws, work in other processes, and what a run that goes on has to have in common."""

import dataclasses
import itertools
import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import pdssjax
from pdssjax import Accuracy, Drawing, InputError
from pdssjax.files import EXAMPLE
from pdssjax.inference.draws import check_same_run, stream
from pdssjax.inference.kept_fit import run_settings


def test_streams_differ_by_purpose_and_by_every_number():
    asked = [(0, "learn", 0), (0, "learn", 0, 0), (0, "propose", 0), (0, "propose", 0, 0), (0, "correct", 0),
             (0, "correct", 1), (1, "correct", 0), (0, "move", 0, 0), (0, "warm up", 0)]  # fmt: skip
    drawn = [stream(*given).standard_normal(4000) for given in asked]
    for some, other in itertools.combinations(drawn, 2):
        assert abs(np.corrcoef(some, other)[0, 1]) < 0.08
    np.testing.assert_array_equal(stream(0, "learn", 0).random(5), stream(0, "learn", 0).random(5))


@pytest.fixture(scope="module")
def study():
    return pdssjax.load_study(EXAMPLE / "study.toml")


@pytest.mark.parametrize("intervals", ["profile", "posterior"])
def test_what_needs_threads_refuses_processes(study, intervals):
    spawning = ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))
    with spawning as pool, pytest.raises(InputError, match=r"found a ProcessPoolExecutor .* of threads"):
        pdssjax.identify(study, intervals=intervals, executor=pool)


def test_a_run_goes_on_only_with_parameters_and_records_in_the_same_order(study):
    what = lambda study: run_settings(study, "joint", "bootstrap", Drawing(), 0, Accuracy())
    check_same_run(what(study), what(study))
    for name in ("records", "parameters"):
        kept = getattr(study, name)
        turned = kept[::-1] if name == "records" else dict(reversed(kept.items()))
        with pytest.raises(InputError, match=r"^order: found \["):
            check_same_run(what(study), what(dataclasses.replace(study, **{name: turned})))
