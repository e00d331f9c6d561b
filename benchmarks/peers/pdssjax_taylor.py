"""pdssjax itself: Taylor steps of several orders, with and without the shortcut for repeating cycles."""

import dataclasses
import time

import jax
import jax.numpy as jnp
import numpy as np

from pdssjax.expansion import Taylor
from pdssjax.integration import Accuracy

from ..problem import NAMES, PARAMETERS, EveryCycle, Problem, effector
from .base import AbstractPeer, Prepared, ladder


@dataclasses.dataclass(frozen=True)
class PdssJax(AbstractPeer):
    """`displacements`, as a fit uses it.  The deviation taken for rest is the tolerance."""

    order: int
    every_cycle: bool = False
    tolerances: tuple[float, ...] = ladder(1e-2, 1e-8)
    """[um]"""
    jacobian_tolerances: tuple[float, ...] = ladder(1e-3, 1e-8)

    @property
    def name(self) -> str:
        return f"pdssjax, order {self.order}" + (", every cycle stepped" if self.every_cycle else "")

    def trajectory(self, problem: Problem) -> Prepared:
        return self._compiled(lambda p, tolerance: self._run(p, tolerance, problem))

    def jacobian(self, problem: Problem) -> Prepared:
        def run(p, tolerance):
            logarithmic = lambda q: self._run(p * jnp.exp(q), tolerance, problem)
            return jax.jacfwd(logarithmic)(jnp.zeros(len(NAMES)))

        return self._compiled(run)

    def _run(self, p, tolerance, problem):
        accuracy = Accuracy(1e-6 * tolerance, 1e-6 * tolerance, Taylor(self.order))
        drive = EveryCycle(problem.voltage, problem.frequency) if self.every_cycle else problem.drive()
        return effector(p, problem, accuracy, drive)

    def _compiled(self, function) -> Prepared:
        begun = time.perf_counter()
        ready = jax.jit(function).lower(PARAMETERS, 1e-5).compile()
        seconds = time.perf_counter() - begun
        return Prepared(lambda p, tolerance: np.asarray(ready(p, tolerance)), seconds)


PEERS = tuple(PdssJax(order, every) for order in (8, 12) for every in (False, True))
