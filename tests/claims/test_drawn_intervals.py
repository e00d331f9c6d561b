"""Intervals by drawing, from the command line to the results: of a platform, whose fits take milliseconds."""

import json
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import jax
import numpy as np
import pytest
from platform_study import write_platform

import pdssjax
from pdssjax.cli.main import main
from pdssjax.files import EXAMPLE, DrawsFile
from pdssjax.inference.draws import InMemory
from pdssjax.inference.uncertainty import drawn_intervals
from pdssjax.inference.uncertainty.randomize_then_optimize import NothingToDraw

pytestmark = pytest.mark.usefixtures("undrawn")
STACK = "piezo.gain", "piezo.natural_frequency", "piezo.damping_ratio"
COMPILED = "/jax/core/compile/backend_compile_duration"


@pytest.mark.slow
def test_a_bootstrap_of_a_platform_has_its_linear_intervals_and_compiles_nothing_anew(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path))
    linear, counts, compiled = pdssjax.identify(study), [], []

    class Counting(InMemory):
        def keep(self, entry):
            counts.append(len(compiled))
            super().keep(entry)

    jax.monitoring.register_event_duration_secs_listener(
        lambda name, seconds, **details: compiled.append(name) if name == COMPILED else None
    )
    drawing = pdssjax.Drawing(200, seed=3, store=Counting())
    estimate = pdssjax.identify(study, intervals="bootstrap", drawing=drawing)
    assert len(counts) == 200
    assert counts[0] == counts[-1], "a replicate compiled anew"
    assert estimate.draws is not None and estimate.draws.failed == 0
    for path, drawn in zip(estimate.draws.names, estimate.draws.parameters, strict=True):
        expected, found = linear.parameters[path], estimate.parameters[path]
        assert found.value == expected.value
        if path in STACK:
            assert found.standard_error == expected.standard_error
            # Four standard deviations of the quantile of 200 draws, and of their deviation.
            np.testing.assert_allclose(
                found.interval, expected.interval, atol=4 * 2.67 / 200**0.5 * expected.standard_error
            )
            assert drawn.deviation == pytest.approx(expected.standard_error, rel=4.0 / 400**0.5)
        else:
            assert np.isnan(found.interval).all()


def test_the_command_goes_on_where_it_was_broken_off(tmp_path, monkeypatch, capsys):
    study = str(write_platform(tmp_path))
    command = ["identify", study, "--intervals", "bootstrap", "--replicates", "8", "--seed", "5", "--out"]
    assert main([*command, str(tmp_path / "whole")]) == 0
    printed = capsys.readouterr().out
    assert "[[Bootstrap]]" in printed and "8 replicates, seed 5; 0 did not converge" in printed
    keep, count = DrawsFile.keep, []

    def broken(self, entry):
        count.append(entry)
        if len(count) == 4:
            raise KeyboardInterrupt
        keep(self, entry)

    monkeypatch.setattr(DrawsFile, "keep", broken)
    assert main([*command, str(tmp_path / "parts")]) == 130
    assert "the same command with --resume goes on" in capsys.readouterr().err
    monkeypatch.setattr(DrawsFile, "keep", keep)
    assert main([*command, str(tmp_path / "parts")]) == 2
    assert "found results already" in capsys.readouterr().err
    assert main([*command, str(tmp_path / "parts"), "--resume"]) == 0
    whole, parts = (json.loads((tmp_path / name / "estimate.json").read_text()) for name in ("whole", "parts"))
    assert whole["draws"] == parts["draws"] and whole["draws"]["draws"] == 8
    assert whole["parameters"] == parts["parameters"]
    other = [number if number != "5" else "6" for number in command]
    assert main([*other, str(tmp_path / "parts"), "--resume"]) == 2
    assert "seed: found 6 where the run that should go on has 5" in capsys.readouterr().err
    refused_where_the_study_is_another(study, [*command, str(tmp_path / "parts"), "--resume"], capsys)
    refused_where_the_fit_is_none(tmp_path / "parts" / "draws.jsonl", [*command, str(tmp_path / "parts")], capsys)


def refused_where_the_study_is_another(study, command, capsys):
    """Draws around a fit of another study would go on around what is no optimum."""
    place = Path(study)
    text = place.read_text()
    for old, new, said in (
        (
            'sigma1" = { value = 45 }',
            'sigma1" = { value = 90 }',
            "parameters: friction.sigma1: value: found 90.0 where",
        ),
        ('noise = "0.01 um"', 'noise = "0.02 um"', "records: step: noise: found 2e-08 where the run that should go on"),
        ('"50 V"', '"51 V"', "records: step: drive: found "),
        ('gain" = {}', 'gain" = { max = "1 um/V" }', "parameters: piezo.gain: max: found 1e-06 where"),
    ):
        assert text.count(old) == 1, old
        place.write_text(text.replace(old, new))
        assert main(command) == 2
        assert said in capsys.readouterr().err
    place.write_text(text)


def rewrite(folder, document, entries):
    """A file of draws with the digests of what somebody made of it."""
    file = DrawsFile(folder, resume=False)
    file.begin(document)
    for entry in entries:
        file.keep(entry)


def refused_where_the_fit_is_none(draws, command, capsys):
    head, *rest = (json.loads(line) for line in draws.read_text().splitlines())
    document = {key: value for key, value in head.items() if key not in ("format", "digest")}
    for changed in (
        {"free": "x"},
        {"free": document["free"][:1]},
        {"noise": []},
        {"starts": 3},
        {"ending": 99},
        {"success": "yes"},
        {"multistart": "x"},
        {"multistart": {"names": []}},
    ):
        rewrite(draws.parent, document | changed, rest)
        assert main([*command, "--resume"]) == 2
        assert "draws.jsonl: the fit: found " in capsys.readouterr().err
    rewrite(draws.parent, {key: value for key, value in document.items() if key != "message"}, rest)
    assert main([*command, "--resume"]) == 2
    assert "draws.jsonl: the fit: found no 'message'" in capsys.readouterr().err


def test_a_problem_can_be_sent_to_another_process(tmp_path):
    problem, _ = pdssjax.pose_problem(pdssjax.load_study(write_platform(tmp_path)))
    sent = pickle.loads(pickle.dumps(problem))
    np.testing.assert_array_equal(sent.residual.comparison.measured[0], problem.residual.comparison.measured[0])
    assert sent.residual.transform.paths == problem.residual.transform.paths
    np.testing.assert_array_equal(sent.bounds[0], problem.bounds[0])


@pytest.mark.slow  # two processes that import and compile
def test_replicates_may_be_fitted_in_other_processes(tmp_path):
    study = pdssjax.load_study(write_platform(tmp_path))
    asked = lambda executor: (
        pdssjax.identify(study, intervals="bootstrap", drawing=pdssjax.Drawing(6), executor=executor).draws
    )
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as processes:
        np.testing.assert_allclose(asked(processes).values, asked(None).values, rtol=1e-9)


@pytest.mark.slow  # the sampler alone is held by tests/inference/uncertainty/test_posterior.py
@pytest.mark.parametrize("sampler", ["rto", "nuts"])
def test_a_posterior_of_a_platform_is_the_linear_normal_distribution(tmp_path, capsys, sampler):
    command = ["identify", str(write_platform(tmp_path)), "--intervals", "posterior", "--draws", "500"]
    assert main([*command, "--sampler", sampler, "--out", str(tmp_path / "out")]) == 0
    assert "[[Posterior]]" in capsys.readouterr().out
    document = json.loads((tmp_path / "out" / "estimate.json").read_text())
    assert (tmp_path / "out" / "posterior.nc").exists()
    drawn = document["draws"]
    assert (drawn["chains"], drawn["draws"]) == (4, 500)
    assert drawn["failed"] < 0.2 * 4 * 500
    for path in STACK:
        parameter, summary = document["parameters"][path], drawn["parameters"][path]
        assert summary["rhat"] < 1.01 and summary["effective"] > 400
        error = parameter["standard_error"]
        assert abs(summary["mean"] - parameter["value"]) < 4.0 * error / summary["effective"] ** 0.5
        assert summary["deviation"] == pytest.approx(error, rel=4.0 / (2.0 * summary["effective"]) ** 0.5)


def test_draws_that_are_proposals_of_another_kind_cannot_go_on(tmp_path):
    class OfAnEarlierVersion(InMemory):
        def begun(self):
            begun = super().begun()
            return begun and {name: value for name, value in begun.items() if name != "proposals"}

    store = OfAnEarlierVersion()
    study = pdssjax.load_study(write_platform(tmp_path))
    drawing = pdssjax.Drawing(50, store=store)
    assert pdssjax.identify(study, intervals="posterior", drawing=drawing).draws
    with pytest.raises(pdssjax.InputError, match=r"proposals: found 'randomized residuals, exp.*has nothing; expected"):
        pdssjax.identify(study, intervals="posterior", drawing=drawing)


def test_where_nothing_can_be_drawn_the_fit_is_kept(tmp_path, monkeypatch):
    def nothing(*given):
        raise NothingToDraw("posterior: found parameters between the bounds for 2 of 6400 randomized residuals.")

    study = pdssjax.load_study(write_platform(tmp_path))
    linear = pdssjax.identify(study)
    monkeypatch.setattr(drawn_intervals, "sample_posterior", nothing)
    estimate = pdssjax.identify(study, intervals="posterior", drawing=pdssjax.Drawing(50))
    assert estimate.draws is None and estimate.converged
    assert estimate.parameters["piezo.gain"].interval == linear.parameters["piezo.gain"].interval
    assert any(note.startswith("No posterior, intervals are linear: posterior: found par") for note in estimate.notes)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--replicates", "9"], "option --replicates: found with --intervals linear, expected bootstrap"),
        (["--intervals", "bootstrap", "--replicates", "1"], "option --replicates: found 1, expected at least 2"),
        (["--intervals", "bootstrap", "--seed", "-1"], "option --seed: found -1, expected 0 or more"),
        (["--seed", "5"], "option --seed: found with --intervals linear, expected bootstrap or posterior"),
        (["--resample", "cycles"], "option --resample: found with --intervals linear, expected bootstrap"),
        (["--intervals", "posterior", "--resample", "noise"], "option --resample: found with --intervals posterior"),
        (["--intervals", "posterior", "--draws", "1000001"], "option --draws: found 1000001, expected at most 1000000"),
        (["--starts", "100001"], "option --starts: found 100001, expected at most 100000"),
        (["--method", "both"], "the sequential method expects some of the platform, for the piezo, and some of the"),
        (["--sampler", "nuts"], "option --sampler: found with --intervals linear, expected posterior"),
        (["--resume"], "option --resume: found with --intervals linear, expected bootstrap or posterior"),
        (["--intervals", "bootstrap", "--resume"], "draws.jsonl: there is no such file"),
    ],
)
def test_wrong_options_are_refused_before_any_work(tmp_path, capsys, options, said):
    assert main(["identify", str(write_platform(tmp_path)), "--out", str(tmp_path / "out"), *options]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow  # ten minutes of a core
def test_both_samplers_draw_the_same_posterior_of_the_example():
    study, executor = pdssjax.load_study(EXAMPLE / "study.toml"), ThreadPoolExecutor(2)
    asked = lambda sampler, count: pdssjax.identify(
        study, intervals="posterior", drawing=pdssjax.Drawing(count, sampler=sampler), executor=executor
    )
    independent, walked = asked("rto", 4000), asked("nuts", 1000)
    assert not walked.notes
    for first, second in zip(independent.draws.parameters, walked.draws.parameters, strict=True):
        assert second.rhat < 1.01 and min(second.effective, second.effective_tails) > 400
        sizes = [min(drawn.effective, drawn.effective_tails) for drawn in (first, second)]
        error = first.deviation * sum(1.0 / size for size in sizes) ** 0.5
        assert abs(first.mean - second.mean) < 4.0 * error
        assert second.deviation == pytest.approx(first.deviation, rel=4.0 * sum(0.5 / size for size in sizes) ** 0.5)
        # A quantile at 2.5 % of a normal distribution scatters 2.67 times as much as its mean.
        np.testing.assert_allclose(second.percentile, first.percentile, atol=4.0 * 2.67 * error)


def without_prior(draws, place):
    """The middle 95 % of a parameter's draws, each weighted so that priors are flat in the logarithms."""
    values = np.concatenate(draws.values)
    weights = 1.0 / np.prod(values / np.mean(values, axis=0), axis=1)
    order = np.argsort(values[:, place])
    below = np.cumsum(weights[order]) / np.sum(weights)
    return np.interp([0.025, 0.975], below, values[order, place])


@pytest.mark.slow  # a minute and more of two cores
def test_the_posterior_of_the_example_ends_where_its_profiles_do_whatever_the_seed():
    """It lacked up to a fifth of the longest tail with some seeds, all chains in agreement.

    Its priors are flat in the values, which moves what is known to 11 % by a tenth of a standard error; chi-square
    is nearly a parabola in the logarithms.
    """
    study, executor = pdssjax.load_study(EXAMPLE / "study.toml"), ThreadPoolExecutor(2)
    profiles = pdssjax.identify(study, intervals="profile", executor=executor)
    for seed in range(4):
        drawing = pdssjax.Drawing(1000, seed=seed)
        drawn = pdssjax.identify(study, intervals="posterior", drawing=drawing, executor=executor)
        assert not drawn.notes
        for place, summary in enumerate(drawn.draws.parameters):
            assert summary.rhat < 1.01 and min(summary.effective, summary.effective_tails) > 1000
            error = 2.67 * summary.deviation / summary.effective_tails**0.5
            expected = profiles.parameters[summary.path].interval
            np.testing.assert_allclose(without_prior(drawn.draws, place), expected, atol=4.0 * error)
