"""diffrax as it comes: one adaptive solve over the whole record, steps clipped at the drops.

The Jacobian is `jacfwd` through the solve.  It misses what the switching times do to the
solution, and is wrong at any tolerance.
"""

import dataclasses
import time

import diffrax
import jax
import jax.numpy as jnp

from ..grid import Grid, in_blocks
from ..problem import PARAMETERS
from ._jax_peer import AbstractJaxPeer, in_order
from .base import Prepared, ladder

_RATE = 6736.0
"""Scale of the velocities [1/s], so that one tolerance suits displacements and velocities."""


def field(time, state, args):
    """The coupled equations in um and um times `_RATE`, |v| and the switches as they stand."""
    p, voltage, period = args
    y, w, _, w_e, z = state
    u = voltage * (time / period - jnp.floor(time / period))
    v = (w - w_e) * _RATE
    s0, s1, f_ss = (jnp.where(v >= 0, p[k], p[k + 1]) for k in (4, 6, 8))
    rate = v - s0 * jnp.abs(v) / (1e6 * f_ss) * z
    force = s0 * z + s1 * rate
    push = p[0] ** 2 * (1e6 * p[2] * u - y) - 2.0 * p[1] * p[0] * w * _RATE
    return jnp.stack([w * _RATE, push / _RATE, w_e * _RATE, force / p[3] / _RATE, rate])


@dataclasses.dataclass(frozen=True)
class PlainDiffrax(AbstractJaxPeer):
    """`diffrax.diffeqsolve` with a solver of diffrax."""

    solver: diffrax.AbstractSolver
    tolerances: tuple[float, ...]
    jacobian_tolerances: tuple[float, ...] = ()
    sweep_tolerances: tuple[float, ...] = ()
    sweep_share: int = 10

    @property
    def name(self) -> str:
        return f"diffrax {type(self.solver).__name__}"

    def sweep(self, grid: Grid) -> Prepared:
        points, times = in_blocks(grid.points), in_blocks(grid.times)

        def point(p, tolerance, values, times):
            return self._solve(p, tolerance, values[0], 1.0 / values[1], grid.cycles + 1, times)

        begun = time.perf_counter()
        run = jax.jit(jax.vmap(point, in_axes=(None, None, 0, 0)))
        ready = run.lower(PARAMETERS, 1e-5, points[0], times[0]).compile()
        seconds = time.perf_counter() - begun

        return Prepared(in_order(ready, points, times, len(grid.points)), seconds)

    def run(self, p, tolerance, problem):
        times = jnp.asarray(problem.times)
        return self._solve(p, tolerance, problem.voltage, 1.0 / problem.frequency, problem.cycles, times)

    def _solve(self, p, tolerance, voltage, period, cycles, times):
        control = diffrax.ClipStepSizeController(
            diffrax.PIDController(rtol=tolerance, atol=tolerance, dtmax=period / 20.0),
            jump_ts=jnp.arange(1, cycles) * period,
        )
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            self.solver,
            t0=0.0,
            t1=times[-1],
            dt0=1e-6,
            y0=jnp.zeros(5),
            args=(p, voltage, period),
            saveat=diffrax.SaveAt(ts=times),
            stepsize_controller=control,
            max_steps=200_000,
            adjoint=diffrax.ForwardMode(),
            throw=False,
        )
        return solution.ys[:, 2]  # pyright: ignore[reportOptionalSubscript]


PEERS = (
    PlainDiffrax(diffrax.Tsit5(), ladder(1e-5, 1e-9), ladder(1e-6, 1e-8), ladder(1e-6, 1e-7)),
    # A second and more a run: few tolerances, about the one that gives 1e-3 um.
    PlainDiffrax(diffrax.Kvaerno5(), ladder(1e-7, 1e-8)),
)
