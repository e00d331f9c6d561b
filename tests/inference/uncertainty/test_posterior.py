"""Draws from a posterior: of Gaussian and banana-shaped densities that are known, in parts and in one go."""

import sys
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from drawn_posteriors import DESIGN, EVERYWHERE, LINEAR, drawn, linear, slow_nuts
from scipy import stats

from pdssjax import Drawing, InputError
from pdssjax.inference.draws import InMemory
from pdssjax.inference.prior import Prior
from pdssjax.inference.uncertainty import posterior
from pdssjax.inference.uncertainty.drawn_intervals import (
    _density_in_words,
    about_better_optima,
    about_endless,
    about_tails,
    summary_of_chains,
)
from pdssjax.inference.uncertainty.posterior import posterior_model
from pdssjax.inference.uncertainty.profile_likelihood import SIDES, End, Verdict
from pdssjax.inference.uncertainty.second_order import Linearisation
from pdssjax.metrics import effective_size, rhat


def bent(stiffness):
    """Residuals of a banana: x0 is normal around 1, x1 around its square."""
    return lambda x: jnp.concatenate([jnp.stack([stiffness * (x[1] - x[0] ** 2), x[0] - 1.0]), jnp.zeros(5)])


def wavy(x):
    """No polynomial: waves of a fifth of a standard deviation."""
    return linear(x) + 0.2 * jnp.sin(4.0 * linear(x))


def kinked(x):
    """Slopes that jump all the time: what passes for curvature folds over everywhere."""
    waves = jnp.abs(jnp.mod(10.0 * linear(x) + 1.0, 2.0) - 1.0) - 0.5
    return linear(x) + 0.15 * waves


@pytest.mark.parametrize(
    ("noises", "apart", "wide"), [([1.0], [], False), ([1.0, None], [], True), ([1.0], ["piezo.gain"], True)]
)
def test_that_one_factor_enlarges_what_it_need_not_is_said(noises, apart, wide):
    records = [SimpleNamespace(time=np.zeros(3), noise=noise) for noise in noises]
    problem = SimpleNamespace(records=records, residual=SimpleNamespace(prior=Prior(tuple(apart))))
    told = _density_in_words(problem, 4.0, [])  # pyright: ignore[reportArgumentType]
    assert "its variance enlarged by 4" in told and ("too wide there" in told) is wide
    assert "enlarged" not in _density_in_words(problem, 1.0, [])  # pyright: ignore[reportArgumentType]


@slow_nuts
def test_of_a_gaussian_they_have_its_moments_to_the_monte_carlo_error(sampler):
    for factor in (1.0, 4.0):
        chains = drawn(linear, [0.0, 0.0], Drawing(500, sampler=sampler), factor=factor)
        covariance = factor * np.linalg.inv(DESIGN.T @ DESIGN)
        assert chains.failed < 0.2 * chains.free[:, :, 0].size
        for i in range(2):
            draws = chains.free[:, :, i]
            size, deviation = effective_size(draws), np.sqrt(covariance[i, i])
            assert rhat(draws) < 1.01 and size > 500
            assert abs(np.mean(draws)) < 4.0 * deviation / np.sqrt(size)
            assert np.std(draws) == pytest.approx(deviation, rel=4.0 * np.sqrt(0.5 / effective_size(draws**2)))


@slow_nuts
@pytest.mark.parametrize("stiffness", [pytest.param(20.0, marks=pytest.mark.slow), 2000.0])
def test_of_a_banana_too_however_narrow_it_is(stiffness, sampler):
    """Means 1 and 2, variances 1 and 6 + 1 / stiffness^2."""
    chains = drawn(bent(stiffness), [1.0, 1.0], Drawing(1000, seed=1, sampler=sampler))
    for i, (mean, variance) in enumerate([(1.0, 1.0), (2.0, 6.0 + stiffness**-2)]):
        draws = chains.free[:, :, i]
        size = effective_size(draws)
        assert rhat(draws) < 1.01 and size > 400
        assert np.mean(draws) == pytest.approx(mean, abs=4.0 * np.sqrt(variance / size))
        assert np.var(draws) == pytest.approx(variance, rel=0.25)
    assert chains.failed < 0.2 * chains.free[:, :, 0].size
    straight = chains.free[:, :, 1] - chains.free[:, :, 0] ** 2
    assert np.std(straight) == pytest.approx(1.0 / stiffness, rel=0.1)


@slow_nuts
def test_the_prior_is_flat_in_the_values_where_the_fit_sees_their_logarithms(sampler):
    """A damping known to 2.7 standard errors: normal, and cut off at zero; in its logarithm it would have no end."""
    deviation = 0.37
    residuals = lambda x: jnp.concatenate([jnp.stack([(jnp.exp(x[0]) - 1.0) / deviation, x[1]]), jnp.zeros(5)])
    logarithmic = np.array([True, False])
    draws = np.exp(drawn(residuals, [0.0, 0.0], Drawing(1000, seed=3, sampler=sampler), logarithmic=logarithmic).free)
    exact = stats.truncnorm(-1.0 / deviation, np.inf, 1.0, deviation)
    damping = draws[:, :, 0]
    size = effective_size(damping)
    assert rhat(damping) < 1.01 and size > 400
    assert np.mean(damping) == pytest.approx(exact.mean(), abs=4.0 * exact.std() / np.sqrt(size))
    for share in (0.025, 0.975):
        place = exact.ppf(share)
        error = np.sqrt(share * (1.0 - share) / effective_size((damping < place) * 1.0))
        assert np.mean(damping < place) == pytest.approx(share, abs=4.0 * error)


@pytest.mark.parametrize(
    ("sampler", "count", "residuals"),
    [
        ("rto", 2000, wavy),
        pytest.param("rto", 2000, kinked, marks=pytest.mark.slow),
        pytest.param("nuts", 600, wavy, marks=pytest.mark.slow),
    ],
)
def test_what_no_polynomial_describes_is_drawn_from_the_model_all_the_same(sampler, count, residuals):
    chains = drawn(residuals, [0.0, 0.0], Drawing(count, seed=2, sampler=sampler))
    low, high = np.quantile(chains.free, [0.0005, 0.9995], axis=(0, 1))
    axes = [np.linspace(2 * low[i], 2 * high[i], 801) for i in range(2)]
    grid = jnp.stack(jnp.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    density = np.exp(-0.5 * np.sum(np.asarray(jax.vmap(residuals)(grid)) ** 2, axis=1))
    # Of the proposals; how many trajectories end at an edge depends on where the polynomial folds.
    assert (0.01 if sampler == "rto" else 0.0) <= chains.failed / chains.free[:, :, 0].size < 0.9
    for i in range(2):
        draws = chains.free[:, :, i]
        deviation = np.sqrt(np.sum(density * np.asarray(grid[:, i]) ** 2) / np.sum(density))
        assert rhat(draws) < 1.02
        assert np.std(draws) == pytest.approx(deviation, rel=4.0 * np.sqrt(0.5 / effective_size(draws**2)))


class Broken(InMemory):
    """Is broken off after five blocks."""

    def keep(self, entry):
        if len(self.kept()) == 5:
            raise KeyboardInterrupt
        super().keep(entry)


@slow_nuts
def test_a_run_that_was_broken_off_ends_as_if_it_had_not_been(sampler):
    whole = drawn(wavy, [0.0, 0.0], Drawing(150, seed=4, sampler=sampler), chains=2)
    store = Broken()
    with pytest.raises(KeyboardInterrupt):
        drawn(wavy, [0.0, 0.0], Drawing(150, seed=4, store=store, sampler=sampler), chains=2)
    rest = InMemory()
    for entry in store.kept():
        rest.keep(entry)
    resumed = drawn(wavy, [0.0, 0.0], Drawing(150, seed=4, store=rest, sampler=sampler), chains=2)
    assert resumed.failed == whole.failed
    np.testing.assert_array_equal(resumed.free, whole.free)
    for name, values in whole.statistics.items():
        np.testing.assert_array_equal(resumed.statistics[name], values)
    more = drawn(wavy, [0.0, 0.0], Drawing(170, seed=4, store=rest, sampler=sampler), chains=2)
    np.testing.assert_array_equal(more.free[:, :150], whole.free)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ({"chain": 0}, "draws in memory: draws of the chains: found no 'block'"),
        ({"chain": 0, "block": "x"}, "chain, block = "),
        ({"chain": 0, "block": 0, "end": [0.0], "free": [[1.0, 2.0]]}, "of block 0 of chain 0 without"),
        ({"chain": 0, "block": -1, "end": [0.0, 0.0]}, "draws of the chains: found no '(step_size|free)'"),
    ],
)
@slow_nuts
def test_a_block_that_is_none_is_said_in_a_line(entry, said, sampler):
    store = InMemory()
    store.keep(entry)
    with pytest.raises(InputError, match=said):
        drawn(wavy, [0.0, 0.0], Drawing(150, seed=4, store=store, sampler=sampler), chains=2)


def test_without_numpyro_it_is_asked_for(monkeypatch):
    monkeypatch.setitem(sys.modules, "numpyro", None)
    with pytest.raises(
        InputError, match=r'sampler: found "nuts" without NumPyro, .*pip install "pdssjax\[posterior\]"'
    ):
        Drawing(50, sampler="nuts")


def test_what_cannot_be_simulated_is_said():
    nowhere = lambda x: jnp.full(7, jnp.nan) * x[0]
    optimum = Linearisation(np.zeros(2), np.full(7, np.nan), np.full((7, 2), np.nan))
    evaluate = lambda at: (nowhere(at), jax.jacfwd(nowhere)(at))
    with pytest.raises(InputError, match="found a model that cannot be simulated at its optimum"):
        posterior_model(evaluate, nowhere, optimum, np.arange(2), EVERYWHERE, LINEAR, 1.0, None, print)


def test_an_independence_chain_stays_where_the_model_is_likelier_than_the_proposals_say():
    random = np.random.default_rng(0)
    # Proposals uniform among five states, of which the model has the weights 1 to 5.
    proposed = random.integers(0, 5, 200_000)
    places = posterior.independence_chain(np.log(1.0 + proposed), random)
    shares = np.bincount(proposed[places], minlength=5) / proposed.size
    np.testing.assert_allclose(shares, np.arange(1, 6) / 15.0, atol=5e-3)
    failed = np.array([-np.inf, 0.0, -np.inf, -np.inf])
    np.testing.assert_array_equal(posterior.independence_chain(failed, random), [1, 1, 1, 1])
    np.testing.assert_array_equal(posterior.independence_chain(np.full(3, -np.inf), random), [0, 1, 2])


def test_an_independence_chain_begins_where_the_posterior_is():
    """Of proposals nine in ten may be far out; a chain that began at the first of them would show it."""
    weights = np.where(np.arange(60) % 10 == 5, 0.0, -1e5)
    begins = [posterior.independence_chain(weights, np.random.default_rng(seed))[0] for seed in range(200)]
    assert {int(begin) for begin in begins} == {5, 15, 25, 35, 45}


def test_a_tail_that_draws_do_not_reach_is_said():
    optimum = Linearisation(np.zeros(1), np.zeros(1), np.zeros((1, 1)))
    end = lambda side, verdict: {(0, side): End(side * 2.4, verdict, optimum, 1)}
    ends = end(-1.0, Verdict.BOUNDED) | end(1.0, Verdict.BOUNDED)
    whole = np.random.default_rng(1).standard_normal((4, 1000, 1))
    told = lambda draws, ends: about_tails(summary_of_chains(("x",), draws, np.array([True])), draws, ends)
    assert told(whole, ends) == []
    cut = np.where(whole > 2.3, 0.0, whole)
    (note,) = told(cut, ends)
    assert note.startswith(
        "Fewer draws of the posterior than 20 % of what was expected lie beyond where the likelihood"
    )
    assert " likelihood ends: x above. " in note and "--intervals profile" in note
    # Too few draws to tell, and an end that is none.
    assert told(cut[:, :100], ends) == []
    assert told(cut, ends | end(1.0, Verdict.FLAT)) == []


def test_a_likelihood_without_an_end_is_said_where_the_values_have_none():
    optimum = Linearisation(np.zeros(2), np.zeros(1), np.zeros((1, 2)))
    flat = {(i, side): End(side * np.inf, Verdict.FLAT, optimum, 1) for i in (0, 1) for side in SIDES}
    told = lambda *logarithmic: about_endless(("x", "y"), flat, np.array(logarithmic))
    assert told(False, False)[0].startswith("The likelihood has no end: x below, x above, y below, y above. Draws go")
    assert "no end: x above, y above. " in told(True, True)[0]  # zero is an end of a value
    assert about_endless(("x", "y"), {}, np.array([False, False])) == []


def test_a_better_optimum_that_was_met_is_said():
    point = lambda at, residual: Linearisation(np.array(at), np.array([residual]), np.zeros((1, 2)))
    end = lambda verdict, *there: End(1.0, verdict, point(*there), 1)
    bounded = {(1, -1.0): end(Verdict.BOUNDED, [0.0, 0.0], 1.0)}
    lower = {(0, 1.0): end(Verdict.LOWER, [1.0, 2.0], 3.0), (1, 1.0): end(Verdict.LOWER, [4.0, 5.0], 2.0)}
    (note,) = about_better_optima(("x", "y"), lower | bounded, lambda at: 10.0 * at)
    assert "a better optimum was found (chi-square 4): start the fit from y = 50 in SI." in note
    assert about_better_optima(("x", "y"), bounded, lambda at: at) == []


TIMES = jnp.linspace(0.1, 3.0, 12)


def saturating(x):
    """Residuals in noises of 0.08, curved whatever the parameters are: no change of them makes this linear."""
    curve = lambda x: jnp.exp(x[0]) * (1.0 - jnp.exp(-TIMES * jnp.exp(x[1])))
    return (curve(x) - curve(jnp.array([0.0, 0.0]))) / 0.08


# By default moments are held against closed forms and grids.
@pytest.mark.slow
def test_another_sampler_finds_the_same_moments():
    """NumPyro's No-U-Turn sampler, of the model itself."""
    numpyro = pytest.importorskip("numpyro.infer")
    kernel = numpyro.NUTS(potential_fn=lambda x: 0.5 * jnp.sum(saturating(x) ** 2), dense_mass=True)
    sampler = numpyro.MCMC(kernel, num_warmup=500, num_samples=8000, progress_bar=False)
    sampler.run(jax.random.PRNGKey(0), init_params=jnp.zeros(2))
    other = np.asarray(sampler.get_samples())[None]
    ours = drawn(saturating, [0.0, 0.0], Drawing(2000, seed=6)).free
    for i in range(2):
        pair = [draws[:, :, i] for draws in (ours, other)]
        deviation, sizes = np.std(other[:, :, i]), [effective_size(draws) for draws in pair]
        error = deviation * np.sqrt(sum(1.0 / size for size in sizes))
        assert abs(np.mean(pair[0]) - np.mean(pair[1])) < 4.0 * error
        assert np.std(pair[0]) == pytest.approx(deviation, rel=0.08)
        skew = [np.mean((draws - np.mean(draws)) ** 3) / np.std(draws) ** 3 for draws in pair]
        assert max(np.abs(skew)) > 0.1, "a normal distribution"
        assert abs(skew[0] - skew[1]) < 4.0 * np.sqrt(6.0 * sum(1.0 / size for size in sizes))
