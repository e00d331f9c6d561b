"""pdssjax itself: Taylor steps of several orders, with and without the shortcut for repeating cycles."""

import dataclasses
import functools
import time
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from pdssjax import Accuracy, Taylor
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.integration import integrate_to_times
from pdssjax.simulation import StickSlip

from ..grid import Grid, in_blocks
from ..problem import PARAMETERS, UM, EveryCycle, actuator, effector
from ._jax_peer import AbstractJaxPeer, in_order
from .base import Prepared, ladder


@dataclasses.dataclass(frozen=True)
class PdssJax(AbstractJaxPeer):
    """`displacements`, as a fit uses it.  The deviation taken for rest is the tolerance."""

    order: int
    every_cycle: bool = False
    tolerances: tuple[float, ...] = ladder(1e-2, 1e-8)
    """[um]"""
    jacobian_tolerances: tuple[float, ...] = ladder(1e-3, 1e-8)
    sweep_tolerances: tuple[float, ...] = ()

    @property
    def name(self) -> str:
        return f"pdssjax, order {self.order}" + (", every cycle stepped" if self.every_cycle else "")

    def sweep(self, grid: Grid) -> Prepared:
        points, times = in_blocks(grid.points), in_blocks(grid.times)
        ready, seconds = _side_by_side(self, points[0].shape, times[0].shape)

        return Prepared(in_order(ready, points, times, len(grid.points)), seconds)

    def point(self, p, tolerance, point, times):
        """The end-effector at the times of one point: what `pdssjax.sweep` runs side by side, but for its metrics."""
        rig, drive = actuator(p), Sawtooth(voltage=point[0], frequency=point[1])
        accuracy = Accuracy(1e-6 * tolerance, 1e-6 * tolerance, Taylor(self.order))
        state, _, _, failure = integrate_to_times(StickSlip(rig, drive), times, accuracy)
        y, _ = jax.vmap(rig.driven_platform.platform)(state.driven)
        return jnp.where(failure > 0, jnp.nan, UM * (y - state.d))

    def run(self, p, tolerance, problem):
        accuracy = Accuracy(1e-6 * tolerance, 1e-6 * tolerance, Taylor(self.order))
        drive = EveryCycle(problem.voltage, problem.frequency) if self.every_cycle else problem.drive()
        return effector(p, problem, accuracy, drive)


@functools.cache
def _side_by_side(peer: PdssJax, *shapes: tuple[int, ...]) -> tuple[Callable[..., Any], float]:
    """A block of points, compiled once for the reference and the contest, and the seconds that took."""
    begun = time.perf_counter()
    run = jax.jit(jax.vmap(peer.point, in_axes=(None, None, 0, 0)))
    ready = run.lower(PARAMETERS, 1e-5, *map(np.ones, shapes)).compile()
    return ready, time.perf_counter() - begun


SWEEPING = tuple(PdssJax(order, sweep_tolerances=ladder(1e-4, 1e-5, 4)) for order in (8, 12))
"""Those that sweep."""
PEERS = tuple(peer for sweeping in SWEEPING for peer in (sweeping, PdssJax(sweeping.order, every_cycle=True)))
