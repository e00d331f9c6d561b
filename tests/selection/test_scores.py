"""Held-out scores under coloured noise: what is worse beyond chance, what matters, and which model is chosen."""

from types import SimpleNamespace

import numpy as np
import pytest
from compared_laws import TIME

from pdssjax.metrics import StationaryNoise
from pdssjax.selection.held_out import Part, parts_of
from pdssjax.selection.scores import Fitness, Scores, choose, common_noise, groups_of, scores_of, whitener

N = 240


def record(noise=None, offset=0.0, time=TIME, frequency=None, measured=None, **more):
    drive = None if frequency is None else SimpleNamespace(cycle_frequency=lambda: frequency)
    shown = {"role": "fit", "measures": "effector", "name": "one"} | more
    measured = np.zeros(time.size) if measured is None else measured
    return SimpleNamespace(time=time, measured=measured, noise=noise, offset=offset, drive=drive, motion=None, **shown)


def autoregression(coefficient, size, seed=0):
    random, out = np.random.default_rng(seed), np.zeros(size)
    for k in range(1, size):
        out[k] = coefficient * out[k - 1] + random.standard_normal()
    return out


def test_whitened_noise_is_white_and_its_log_score_that_of_the_normal_distribution():
    from scipy.stats import multivariate_normal

    e = autoregression(0.8, TIME.size)
    one = record()
    found = common_noise(one, -e, TIME.size)
    assert found.process.coefficients[0] == pytest.approx(0.8, abs=0.1)
    assert found.size.independent < 0.5 * TIME.size and found.size.correlation_time > TIME[1]
    rows = np.zeros(TIME.size, bool)
    rows[20:140] = True
    white = whitener(one, found, rows)
    places = np.arange(120)
    covariance = found.process.autocovariance(120)[np.abs(places[:, None] - places)]
    w = white(e[rows])
    expected = multivariate_normal(np.zeros(120), covariance).logpdf(e[rows])
    assert -0.5 * (w @ w + white.log_volume) == pytest.approx(expected, rel=1e-3)


def test_noise_that_is_told_stands_unless_the_residuals_exceed_it_beyond_chance():
    e = np.random.default_rng(3).standard_normal(TIME.size)
    told = common_noise(record(noise=1.05), -e, TIME.size)
    assert told.size.told and told.size.deviation == 1.05
    exceeded = common_noise(record(noise=0.5), -e, TIME.size)
    assert not exceeded.size.told and exceeded.size.deviation == pytest.approx(1.0, abs=0.1)


def test_samples_that_stand_out_are_compared_for_no_model():
    e = np.random.default_rng(3).standard_normal(TIME.size)
    e[100] = 50.0
    found = common_noise(record(measured=e), np.zeros(TIME.size), TIME.size)
    assert not found.used[100] and found.used.sum() == TIME.size - 1
    assert whitener(record(), found, np.ones(TIME.size, bool)).samples == TIME.size - 1


def scored(kinds, misfits, noise_of=0.0, seed=0):
    """Scores of models whose residuals are the same noise, and a wave of the size of each of their `misfits`."""
    random = np.random.default_rng(seed)
    parts = tuple(Part(k, np.ones(N, bool), kind) for k, kind in enumerate(kinds))
    common = [random.standard_normal(N) + noise_of for _ in parts]
    wave = np.sin(np.linspace(0.0, 40.0, N))
    sizes = {name: size if isinstance(size, tuple) else (size,) * len(parts) for name, size in misfits.items()}
    whitened = {name: tuple(e + s * wave for e, s in zip(common, size, strict=True)) for name, size in sizes.items()}
    return Scores(parts, whitened, (0.0,) * len(parts))


def test_a_difference_has_the_error_that_noise_gives_it():
    """Over many draws of the noise the difference of two predictions scatters by what is said."""
    found = [scored(["time"], {"a": 0.0, "b": 0.3}, seed=k).difference("a", "b") for k in range(300)]
    totals = np.array([each.total for each in found])
    assert np.std(totals) == pytest.approx(found[0].standard_error, rel=0.15)
    assert np.mean(totals) == pytest.approx(0.5 * found[0].standard_error ** 2, rel=0.15)


def test_the_simplest_model_that_is_not_worse_is_chosen():
    scores = scored(["time"] * 4, {"simple": 1.0, "right": 0.0, "richer": 0.01})
    assert choose(["simple", "right", "richer"], scores)[0] == "right"
    alike = scored(["time"] * 4, {"simple": 0.02, "right": 0.0, "richer": 0.01})
    chosen, best = choose(["simple", "right", "richer"], alike)
    assert chosen == "simple"
    assert groups_of(["simple", "right", "richer"], chosen, best, alike) == [["simple", "right", "richer"]]


def test_a_simpler_model_whose_fit_is_as_good_is_not_worse_for_a_block_that_tells_a_parameter_nearly_alone():
    scores = scored(["time"] * 4 + ["record"], {"right": (1.0, 0.0, 0.0, 0.0, 0.0), "richer": 0.0})
    assert choose(["right", "richer"], scores)[0] == "richer"
    as_good = scores._replace(fits={"right": Fitness(5, 100.0, 134.0), "richer": Fitness(6, 102.0, 142.9)})
    assert choose(["right", "richer"], as_good)[0] == "right"
    assert groups_of(["right", "richer"], "right", "richer", as_good) == [["right", "richer"]]
    poorer = scores._replace(fits={"right": Fitness(5, 130.0, 164.0), "richer": Fitness(6, 102.0, 142.9)})
    assert choose(["right", "richer"], poorer)[0] == "richer"
    whole = scored(["time"] * 4 + ["record"], {"right": (0.0, 0.0, 0.0, 0.0, 1.0), "richer": 0.0})
    assert choose(["right", "richer"], whole._replace(fits=as_good.fits))[0] == "richer"


def test_a_richer_model_that_fits_as_well_is_not_told_apart_by_blocks_that_show_its_parameters_untold():
    """As Coulomb's and LuGre's laws on the record of Liu et al., whose likelihoods are the same."""
    scores = scored(["time"] * 4 + ["record"], {"simple": 0.0, "richer": (1.0, 1.0, 1.0, 1.0, 0.0)})
    assert scores.only("time").difference("simple", "richer").is_significant
    as_good = scores._replace(fits={"simple": Fitness(5, 100.0, 134.0), "richer": Fitness(10, 99.5, 168.3)})
    assert choose(["simple", "richer"], as_good)[0] == "simple"
    assert groups_of(["simple", "richer"], "simple", "simple", as_good) == [["simple", "richer"]]
    poorer = scores._replace(fits={"simple": Fitness(5, 100.0, 134.0), "richer": Fitness(10, 110.0, 178.8)})
    assert groups_of(["simple", "richer"], "simple", "simple", poorer) == [["simple"], ["richer"]]
    alike = scores._replace(fits={"simple": Fitness(5, 100.0, 134.0), "richer": Fitness(5, 99.5, 133.5)})
    assert groups_of(["simple", "richer"], "simple", "simple", alike) == [["simple"], ["richer"]]
    whole = scored(["time"] * 4 + ["record"], {"simple": 0.0, "richer": (0.0, 0.0, 0.0, 0.0, 1.0)})
    judged = whole._replace(fits=as_good.fits)
    assert groups_of(["simple", "richer"], "simple", "simple", judged) == [["simple"], ["richer"]]


def test_the_scatter_of_two_cycles_is_no_doubt_about_a_law_that_alone_explains_both():
    """As LuGre's law in the first two cycles of a walk: of one cycle held out the other tells the parameters badly."""
    cycles = (Part(0, np.ones(N, bool), "time"),) * 2
    scores = scored(["time"] * 2, {"simple": (5.0, 1.0), "right": (2.0, 1.0)})._replace(parts=cycles)
    fits = {"simple": Fitness(2, 400.0, 414.0), "right": Fitness(5, 100.0, 134.0, explains=True)}
    assert choose(["simple", "right"], scores._replace(fits=fits))[0] == "right"
    # Nor is what it leaves of one beyond noise, twice the difference, a reason to keep the other.
    close = scores._replace(whitened=scored(["time"] * 2, {"simple": (2.2, 1.5), "right": (2.0, 1.0)}).whitened)
    assert choose(["simple", "right"], close._replace(fits=fits))[0] == "right"
    unexplained = fits | {"right": Fitness(5, 100.0, 134.0)}
    for each in (scores, close):
        assert choose(["simple", "right"], each._replace(fits=unexplained))[0] == "simple"


def test_a_model_that_predicts_whole_records_worse_is_never_chosen():
    kinds = ["time"] * 4 + ["record"] * 2
    scores = scored(kinds, {"follows": (0.0,) * 4 + (1.0,) * 2, "predicts": (0.6,) * 4 + (0.0,) * 2})
    assert scores.only("time").difference("follows", "predicts").is_significant
    assert choose(["follows", "predicts"], scores) == ("predicts", "predicts")


def test_where_no_model_is_right_small_differences_do_not_matter():
    """The same difference counts beside a model that leaves noise, and not beside one that leaves four times that."""
    right = scored(["time"] * 6, {"a": 0.0, "b": 0.6})
    assert right.difference("a", "b").is_significant
    wrong = scored(["time"] * 6, {"a": 3.0, "b": 3.06})
    difference = wrong.difference("a", "b")
    assert difference.total > 20.0 and not difference.matters


def test_a_misfit_that_one_block_alone_shows_is_no_chance_where_the_other_model_leaves_noise():
    """Blocks that differ, such as the first cycle from later ones, say nothing against the difference."""
    misfit = (3.0, 0.2, 0.2, 0.2)
    scores = scored(["time"] * 4, {"a": 0.0, "b": misfit})
    blocks = tuple(part._replace(record=0) for part in scores.parts)
    assert scores._replace(parts=blocks).difference("a", "b").is_significant


def test_a_model_that_leaves_much_more_than_a_wrong_one_is_worse_all_the_same():
    assert scored(["time"] * 6, {"a": 1.0, "b": 3.0}).difference("a", "b").is_significant


def test_a_part_in_which_all_samples_stand_out_is_dropped():
    one = record(time=TIME)
    noise = common_noise(one, np.random.default_rng(0).standard_normal(TIME.size), TIME.size)
    rows = np.zeros(TIME.size, bool)
    rows[:3] = True
    hidden = noise._replace(used=~rows)
    parts = [Part(0, rows, "time"), Part(0, ~rows, "time")]
    found = scores_of([one], [hidden], parts, {"a": [np.zeros(3), np.zeros(TIME.size - 3)]})
    assert [part.rows.sum() for part in found.parts] == [TIME.size - 3]


def test_blocks_are_cycles_or_slices_spread_over_a_record_and_cover_it_once():
    time = np.arange(0.0, 1.0, 0.002)
    cyclic, rest = record(time=time, frequency=10.0), record(time=time, name="two", measures="platform")
    study = SimpleNamespace(records=(cyclic, rest, record(time=time, role="validate", frequency=10.0)))
    parts = parts_of(study)
    assert [part.kind for part in parts].count("validation") == 1 and not any(p.kind == "record" for p in parts)
    for place in (0, 1):
        blocks = np.array([part.rows for part in parts if part.record == place])
        np.testing.assert_array_equal(blocks.sum(axis=0), 1)
    first = [np.flatnonzero(np.diff(part.rows.astype(int))).size for part in parts if part.record == 0]
    spread = [np.flatnonzero(np.diff(part.rows.astype(int))).size for part in parts if part.record == 1]
    assert max(first) <= 2 and min(spread) >= 8


def test_whole_records_are_held_out_where_another_one_measures_the_same():
    study = SimpleNamespace(records=(record(), record(name="two"), record(name="three", measures="platform")))
    assert [(part.record, part.kind) for part in parts_of(study) if part.kind != "time"] == [
        (0, "record"),
        (1, "record"),
    ]


def test_a_few_samples_are_not_held_out():
    study = SimpleNamespace(records=(record(time=TIME[:30]),))
    assert parts_of(study) == ()
    assert isinstance(common_noise(record(time=TIME[:30]), np.zeros(30), 30).process, StationaryNoise)


def test_a_right_model_is_not_refused_for_a_fitted_record_that_alone_tells_some_of_its_parameters():
    """As LuGre's law with a record that was planned to show its Stribeck effect."""
    off = {"simple": (1.0, 1.0, 1.0, 1.0, 0.0), "right": (0.0, 0.0, 0.0, 0.0, 3.0)}
    fits = {"simple": Fitness(5, 400.0, 434.0), "right": Fitness(7, 100.0, 148.0, explains=True)}
    scores = scored(["time"] * 4 + ["record"], off)._replace(fits=fits)
    assert choose(["simple", "right"], scores) == ("right", "right")
    assert groups_of(["simple", "right"], "right", "right", scores) == [["right"], ["simple"]]
    unexplained = scores._replace(fits=fits | {"right": Fitness(7, 100.0, 148.0)})
    close = scores._replace(fits=fits | {"simple": Fitness(5, 119.0, 153.0)})
    unseen = scored(["time"] * 4 + ["validation"], off)._replace(fits=fits)
    assert [choose(["simple", "right"], each)[0] for each in (unexplained, close, unseen)] == ["simple"] * 3
