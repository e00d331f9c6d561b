"""Whether chains agree: against values of ArviZ 0.8 (arviz_stats) on the same draws, and against what is known."""

import numpy as np
import pytest

from pdssjax.metrics import effective_size, effective_size_of_tails, rhat


def autoregressive(phi, draws, seed=0, chains=4):
    """Chains whose draws depend on the one before by `phi`."""
    random = np.random.default_rng(seed)
    noise = random.normal(size=(chains, draws))
    out = np.zeros_like(noise)
    for t in range(1, draws):
        out[:, t] = phi * out[:, t - 1] + noise[:, t]
    out[:, ::7] = np.roll(out, 1, 1)[:, ::7]  # a rejected proposal repeats the draw before
    return out


# From arviz_stats.base.array_stats: rhat(x), ess(x, method="bulk"), ess(x, method="tail", prob=(0.05, 0.95)).
OF_ARVIZ = [
    (0.0, 1000, (1.0014299813209624, 3136.6662456584118, 3061.7936933177407)),
    (0.5, 101, (1.0082636658745665, 140.51503405129807, 189.75752516458437)),
    (0.95, 1000, (1.057492207332304, 92.82939924746108, 185.70207041765389)),
    (-0.5, 1000, (1.0006135055888052, 5647.421644429538, 2346.7437560486246)),
]


@pytest.mark.parametrize(("phi", "draws", "expected"), OF_ARVIZ)
def test_they_are_those_of_arviz(phi, draws, expected):
    chains = autoregressive(phi, draws)
    found = rhat(chains), effective_size(chains), effective_size_of_tails(chains)
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_independent_draws_are_worth_themselves_and_a_chain_apart_is_seen():
    draws = np.random.default_rng(1).normal(size=(4, 1000))
    assert effective_size(draws) == pytest.approx(4000, rel=0.1)
    assert rhat(draws) < 1.005
    assert rhat(draws + np.array([[0.0], [0.0], [0.0], [2.0]])) > 1.1
    assert rhat(draws * np.array([[1.0], [1.0], [1.0], [3.0]])) > 1.1, "a chain of another spread"
    assert effective_size(np.repeat(draws[:, :100], 10, axis=1)) == pytest.approx(400, rel=0.2)


@pytest.mark.parametrize("draws", [np.zeros((4, 100)), np.zeros((4, 3)), np.arange(6.0).reshape(2, 3)])
def test_too_few_or_equal_draws_say_nothing(draws):
    assert np.isnan([rhat(draws), effective_size(draws), effective_size_of_tails(draws)]).all()
