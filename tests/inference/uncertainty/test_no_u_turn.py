"""Draws by trajectories that a store has kept."""

import numpy as np
from drawn_posteriors import drawn, linear

from pdssjax import Drawing
from pdssjax.inference.draws import InMemory


def test_draws_that_were_kept_come_back_in_order_and_without_the_warm_up():
    store, free = InMemory(), np.random.default_rng(0).normal(size=(2, 2, 50, 2))
    each = {"steps": [3] * 50, "acceptance": [0.8] * 50, "diverging": [True] + [False] * 49}
    for chain in range(2):
        store.keep({"chain": chain, "block": -1, "end": [9.0, 9.0], "step_size": 0.5})
        for block in (1, 0):
            draws = {"free": free[chain, block].tolist(), "log_posterior": [-1.0] * 49 + [None], "end": [0.0, 0.0]}
            store.keep({"chain": chain, "block": block, **draws, **each})
    chains = drawn(linear, [0.0, 0.0], Drawing(70, store=store, sampler="nuts"), chains=2)
    np.testing.assert_array_equal(chains.free, free.reshape(2, 100, 2)[:, :70])
    assert chains.failed == 2 * 2
    # One that the model cannot be simulated at has no density.
    np.testing.assert_array_equal(np.isneginf(chains.statistics["lp"]).nonzero()[1], [49, 49])
