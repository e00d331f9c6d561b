"""Times a value with its gradient, for the scripts beside this one; imports nothing of pdssjax."""

import json
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

REPEATS = 3


def tell(end: Callable[[jax.Array], jax.Array], mode: str, count: int) -> None:
    """Prints `end` at `count` zeros, its derivatives in the `mode` "forward" or "reverse", and the seconds as JSON."""
    both = {"reverse": jax.value_and_grad(end), "forward": lambda x: (end(x), jax.jacfwd(end)(x))}[mode]
    run, zeros, seconds = jax.jit(both), jnp.zeros(count), []
    value, gradient = jnp.nan, zeros
    for _ in range(1 + REPEATS):
        begun = time.perf_counter()
        value, gradient = jax.block_until_ready(run(zeros))
        seconds.append(time.perf_counter() - begun)
    told = {"value": float(value), "gradient": np.asarray(gradient).tolist()}
    print(json.dumps(told | {"first": seconds[0], "run": float(np.median(seconds[1:]))}))
