"""A bootstrap on models that cost nothing: its spread, what it draws, where it runs, and how it goes on."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from types import SimpleNamespace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import Drawing, InputError
from pdssjax.files import DrawsFile
from pdssjax.inference import Fit, Problem
from pdssjax.inference.draws import InMemory, each_done
from pdssjax.inference.parameter_transform import ParameterTransform
from pdssjax.inference.prior import Prior
from pdssjax.inference.uncertainty.bootstrap import bootstrap, cycles_redrawn, phases_of
from pdssjax.inference.uncertainty.drawn_intervals import _about_replicates, summary_of_replicates

TIME = np.linspace(0.0, 1.0, 41)
DESIGN = np.stack([np.ones(41), TIME], axis=1)
NOISE = 0.2
TRUTH = np.array([1.0, -2.0])


class Samples(eqx.Module):
    """What was measured."""

    measured: tuple[np.ndarray, ...]
    prior: Prior = eqx.field(default_factory=Prior)


class LineResidual(eqx.Module):
    """Of a straight line."""

    comparison: Samples
    transform: ParameterTransform


def of_a_line(measured) -> tuple[Problem, Fit]:
    """The problem of a straight line through what was `measured`, and its fit."""
    everywhere = np.full(2, np.inf)
    transform = ParameterTransform(("a", "b"), np.zeros(2, bool), np.ones(2), -everywhere, everywhere)
    record = SimpleNamespace(time=TIME, drive=None, noise=NOISE)
    problem = Problem(LineResidual(Samples((measured,)), transform), (record,), np.array([NOISE]))  # pyright: ignore
    return problem, run(problem, None, None)


def run(problem, starts, report, limit=200):
    """The fit in closed form."""
    measured = problem.residual.comparison.measured[0]
    free = np.linalg.lstsq(DESIGN, measured, rcond=None)[0]
    state = SimpleNamespace(residual=(measured - DESIGN @ free) / NOISE, jacobian=-DESIGN / NOISE)
    return Fit(free, state, True, "", 1, 1)  # pyright: ignore


def drawn(count, executor=None, **how):
    problem, fit = of_a_line(DESIGN @ TRUTH + np.random.default_rng(8).normal(0.0, NOISE, 41))
    return problem, fit, bootstrap(problem, fit, run, 1.0, Drawing(count, **how), executor, lambda message: None)


def test_of_a_linear_model_it_is_the_textbook_s_normal_distribution():
    count = 1500
    problem, fit, replicates = drawn(count)
    free = np.stack([replicate.free for replicate in replicates])
    covariance = NOISE**2 * np.linalg.inv(DESIGN.T @ DESIGN)
    errors = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(np.mean(free, axis=0), fit.free, atol=4.0 * np.max(errors) / np.sqrt(count))
    np.testing.assert_allclose(np.cov(free.T), covariance, rtol=4.0 * np.sqrt(2.0 / count))
    for i, summary in enumerate(summary_of_replicates(problem, fit.free, free)):
        # The standard error of a normal quantile at 2.5 % is 2.67 standard deviations over the root of the count.
        atol = 4.0 * 2.67 * errors[i] / np.sqrt(count)
        ends = fit.free[i] + 1.96 * errors[i] * np.array([-1.0, 1.0])
        np.testing.assert_allclose(summary.percentile, ends, atol=atol)
        np.testing.assert_allclose(summary.basic, ends, atol=atol)
        assert summary.basic == pytest.approx(2.0 * fit.free[i] - np.array(summary.percentile)[::-1])
        assert summary.deviation == pytest.approx(np.std(free[:, i], ddof=1))


def test_a_larger_variance_is_drawn_than_that_of_the_noise_given_but_not_of_noise_that_was_estimated():
    problem, fit = of_a_line(DESIGN @ TRUTH)
    estimated = problem._replace(records=(SimpleNamespace(time=TIME, drive=None, noise=None),))  # pyright: ignore
    ends = [
        bootstrap(posed, fit, run, factor, Drawing(2), None, lambda message: None)[0].free - fit.free
        for posed, factor in ((problem, 1.0), (problem, 4.0), (estimated, 4.0))
    ]
    np.testing.assert_allclose(ends[1], 2.0 * ends[0])
    np.testing.assert_allclose(ends[2], ends[0])


def same(some, others):
    assert [replicate.number for replicate in some] == [replicate.number for replicate in others]
    assert all(np.array_equal(first.free, second.free) for first, second in zip(some, others, strict=True))


def test_where_it_runs_and_in_what_order_makes_no_difference():
    _, _, here = drawn(12)
    with ThreadPoolExecutor(3) as pool:
        _, _, there = drawn(12, executor=pool)
    same(here, there)
    _, _, other = drawn(12, seed=1)
    assert not np.array_equal(here[0].free, other[0].free)


class Broken(InMemory):
    """Is broken off after three replicates."""

    def keep(self, entry):
        if len(self.kept()) == 3:
            raise KeyboardInterrupt
        super().keep(entry)


@pytest.mark.parametrize("threads", [0, 2])
def test_a_run_that_was_broken_off_ends_as_if_it_had_not_been(threads):
    store = Broken()
    with ThreadPoolExecutor(threads or 1) as pool:
        with pytest.raises(KeyboardInterrupt):
            drawn(10, store=store, executor=pool if threads else None)
        assert len(store.kept()) == 3
        rest = InMemory()
        for entry in store.kept():
            rest.keep(entry)
        _, _, resumed = drawn(10, store=rest)
    same(resumed, drawn(10)[2])
    assert len(rest.kept()) == 10


def test_a_file_of_draws_goes_on_where_its_last_line_was_cut(tmp_path):
    whole = drawn(6)[2]
    file = DrawsFile(tmp_path, resume=False)
    file.begin({"seed": 0})
    drawn(6, store=file)
    path = tmp_path / "draws.jsonl"
    path.write_text(path.read_text()[:-25])
    resumed = DrawsFile(tmp_path, resume=True)
    assert resumed.begun() == {"format": "pdssjax-draws/5", "seed": 0}
    assert len(resumed.kept()) == 5
    same(drawn(6, store=resumed)[2], whole)
    assert len(path.read_text().splitlines()) == 7
    same(drawn(8, store=DrawsFile(tmp_path, resume=True))[2], drawn(8)[2])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "there is no such file, expected that of a run to go on with"),
        ("", 'line 1: found no "format": "pdssjax-draws/5"'),
        ('{"format": "pdssjax-draws/4"}\n', 'line 1: found no "format": "pdssjax-draws/5"'),
    ],
)
def test_what_cannot_be_resumed_is_said(tmp_path, text, said):
    if text is not None:
        (tmp_path / "draws.jsonl").write_text(text)
    with pytest.raises(InputError, match=said):
        DrawsFile(tmp_path, resume=True)


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (dict(count=1), "count: found 1, expected at least 2"),
        (dict(count=2.5), "count: found 2.5, expected an integer"),
        (dict(count=10**12), "count: found 1000000000000, expected at most 1000000"),
        (dict(seed=-1), "seed: found -1, expected 0 or more"),
        (dict(seed=2**64), "seed: found 18446744073709551616, expected at most 9223372036854775807"),
        (dict(seed=10**5000), "seed: found an integer of 16610 bits, expected at most 9223372036854775807"),
        (dict(seed="a"), "seed: found 'a', expected an integer"),
        (dict(resampled="x"), 'resampled: found "x", expected "noise" or "cycles"'),
        (dict(sampler="gibbs"), 'sampler: found "gibbs", expected "rto" or "nuts"'),
    ],
)
def test_a_wrong_drawing_is_refused(wrong, said):
    with pytest.raises(InputError, match=said):
        Drawing(**wrong)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"number": 0}, "draws in memory: replicates: found no 'success', expected what a run of this version"),
        ({"chain": 0, "block": 0}, "found no 'number'"),
        ({"number": 0, "free": [1.0], "success": True, "message": ""}, "1 numbers for 2 parameters in replicate 0"),
        ({"number": 0, "free": ["a", "b"], "success": True, "message": ""}, "could not convert"),
        ({"number": 0, "free": [1.0, np.nan], "success": True, "message": ""}, "not finite in replicate 0"),
        ({"number": "x", "free": [1.0, 2.0], "success": True, "message": ""}, "number = 'x'"),
    ],
)
def test_a_replicate_that_is_none_is_said_in_a_line(entry, said):
    store = InMemory()
    store.keep(entry)
    with pytest.raises(InputError, match=said):
        drawn(4, store=store)


def test_cycles_are_drawn_whole_and_what_repeats_stays():
    random = np.random.default_rng(2)
    misfit = np.sin(np.arange(20))
    noise = np.repeat(random.normal(size=(30, 1)), 20, axis=1)  # a cycle is off as a whole
    residual = (misfit + noise).ravel()[:-7]
    places = np.arange(residual.size)
    cycles = np.stack([cycles_redrawn(residual, places, 20, random)[:580].reshape(29, 20) for _ in range(200)])
    assert cycles_redrawn(residual, places, 20, random).size == residual.size
    np.testing.assert_allclose(np.mean(cycles, axis=(0, 1)), np.mean(noise[:29, 0]) + misfit, atol=0.06)
    within = np.std(cycles - np.mean(cycles, axis=(0, 1)), axis=2)
    assert np.max(within) < 1e-9
    spread = np.std(cycles - np.mean(cycles, axis=(0, 1)))
    assert spread == pytest.approx(np.std(noise[:29, 0], ddof=1), rel=0.05)


@pytest.mark.parametrize(
    ("frequency", "interval", "samples", "found"),
    [(5.0, 1e-3, 801, 200), (5.0, 1e-3, 500, None), (7.0, 1e-3, 4000, None), (None, 1e-3, 801, None)],
)
def test_cycles_are_whole_where_three_of_them_fall_on_the_samples(frequency, interval, samples, found):
    drive = SimpleNamespace(cycle_frequency=lambda: frequency)
    record = SimpleNamespace(time=0.2 + interval * np.arange(samples), drive=drive)
    phases = phases_of(record)  # pyright: ignore
    assert (None if phases is None else phases[1]) == found


def test_samples_that_are_left_out_keep_the_phases_of_the_others():
    random = np.random.default_rng(3)
    kept = np.delete(np.arange(600), np.arange(100, 131))
    drive = SimpleNamespace(cycle_frequency=lambda: 50.0)
    places, cycle = phases_of(SimpleNamespace(time=0.2 + 1e-3 * kept, drive=drive))  # pyright: ignore
    np.testing.assert_array_equal(places, kept)
    assert cycle == 20
    misfit = np.sin(kept % 20)
    residual = misfit + 0.01 * random.normal(size=kept.size)
    redrawn = np.mean([cycles_redrawn(residual, places, cycle, random) for _ in range(200)], axis=0)
    np.testing.assert_allclose(redrawn, misfit, atol=0.02)
    # No three cycles are whole where every one lacks a sample.
    gappy = np.delete(np.arange(600), np.arange(7, 600, 20))
    assert phases_of(SimpleNamespace(time=1e-3 * gappy, drive=drive)) is None  # pyright: ignore


def test_replicates_that_fail_and_too_few_of_them_are_said():
    replicates = drawn(20)[2]
    bad = [replicate._replace(success=False, message="stalled") for replicate in replicates[:3]]
    first, second = _about_replicates([*bad, *replicates[3:]], 3)
    assert first.startswith("3 of 20 replicates of the bootstrap did not converge and are left out; the intervals then")
    assert first.endswith("too short: stalled.")
    assert "17 replicates only" in second


def test_arrays_keep_their_digits_in_another_process():
    """JAX begins in single precision there, and its arrays are unpickled before anything is computed."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as processes:
        [(_, found)] = each_done(np.asarray, [jnp.asarray(1.0 / 3.0)], processes)
    assert float(found) == 1.0 / 3.0
