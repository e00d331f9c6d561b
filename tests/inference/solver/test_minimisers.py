"""Another solver of optimistix in place of the package's own: held parameters and bounds, which it does not know."""

import jax.numpy as jnp
import numpy as np
import optimistix

from pdssjax.inference.solver.minimisers import minimised


def test_dogleg_keeps_bounds_and_what_is_held():
    aim = np.array([1.0, 5.0, -3.0, 2.0, 7.0])
    residual = lambda y, args: ((y - aim) * args, None)
    bounds = {
        "lower": np.array([-np.inf, 0.0, -1.0, 0.5, 4.0]),
        "upper": np.array([np.inf, 3.0, np.inf, 9.0, 4.0]),
    }
    start = np.array([3.0, 1.0, 2.0, 1.0, 4.0])
    dogleg = optimistix.Dogleg(rtol=1e-10, atol=1e-10)
    point, steps, ended = minimised(dogleg, residual, start, jnp.array([1.0, 2.0, 1.0, 3.0, 1.0]), bounds, 100)
    np.testing.assert_allclose(point, [1.0, 3.0, -1.0, 2.0, 4.0], atol=1e-4)
    assert ended.startswith("Dogleg ended (") and steps > 1
