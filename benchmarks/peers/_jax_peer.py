"""What peers share that JAX compiles: a trajectory, and its Jacobian by forward mode."""

import abc
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..problem import NAMES, PARAMETERS, Problem
from .base import AbstractPeer, Prepared, Run


class AbstractJaxPeer(AbstractPeer):
    """A peer whose run JAX traces."""

    @abc.abstractmethod
    def run(self, p: Any, tolerance: Any, problem: Problem) -> Any:
        """The end-effector at the sample times [um], shape (samples,)."""

    def trajectory(self, problem: Problem) -> Prepared:
        return _compiled(lambda p, tolerance: self.run(p, tolerance, problem))

    def jacobian(self, problem: Problem) -> Prepared:
        def of_logarithms(p, tolerance):
            moved = lambda q: self.run(p * jnp.exp(q), tolerance, problem)
            return jax.jacfwd(moved)(jnp.zeros(len(NAMES)))

        return _compiled(of_logarithms)


def in_order(ready: Callable[..., Any], points: np.ndarray, times: np.ndarray, count: int) -> Run:
    """A run over blocks of points, each with its times: the first `count` rows."""

    def every_block(p, tolerance):
        blocks = [ready(p, tolerance, *block) for block in zip(points, times, strict=True)]
        return np.concatenate(blocks)[:count]

    return every_block


def _compiled(function: Callable[..., Any]) -> Prepared:
    begun = time.perf_counter()
    ready = jax.jit(function).lower(PARAMETERS, 1e-5).compile()
    seconds = time.perf_counter() - begun
    return Prepared(lambda p, tolerance: np.asarray(ready(p, tolerance)), seconds)
