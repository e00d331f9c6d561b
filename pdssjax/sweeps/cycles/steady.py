"""The cycle that is left when the transient has died out.

Points side by side are integrated until their motion repeats; the few that take longer are found one by one, by
Newton's method on the cycle map (`pdssjax.integration.steady_motion`), or, near one with a reversal that grazes, by
integrating many cycles.
"""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ...core import Count, Scalar
from ...integration import (
    GRAZES,
    PERIODS,
    Accuracy,
    Cycles,
    integrate_cycles,
    integrate_steps,
    moved_orbit,
    restarted,
    steady_state,
)
from ...simulation import StickSlip, grazing
from ..point_status import GRAZING
from .base import FINE, METRICS, SIDE_BY_SIDE, AbstractCycle, Course, Metric, Opening, cycles_at, effector_at, timing

TOLERANCE = 2e-11
"""How far [m] a cycle may be from its limit."""

_CYCLES = 24
"""Integrated side by side; what has not become steady then waits for Newton's method."""


_OWN = {
    "cycles_to_repeat": Metric("1", "cycles until the motion repeats; 0: it does not"),
    "decay": Metric("1", "what is left of a deviation after a cycle"),
}


class Steady(AbstractCycle):
    """The steady cycle; where the motion repeats after 2 or 3 cycles only, the mean of them."""

    @property
    def metrics(self) -> dict[str, Metric]:
        return METRICS | _OWN

    @property
    def described(self) -> int | str:
        return "steady"

    @property
    def accuracy(self) -> Accuracy:
        """Finer than for a numbered cycle: errors of the steps must not look like a transient."""
        return Accuracy(tolerance=1e-12, method=SIDE_BY_SIDE, max_steps=16384)

    def measure(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        when = timing(system.drive)
        cycles = integrate_cycles(system, when.period, when.phases, accuracy, TOLERANCE, _CYCLES)
        return _measured(system, cycles, cycles.period, _ratio(cycles)), cycles.failure

    def unfinished(self, found: Float[np.ndarray, "points metrics"]) -> Bool[np.ndarray, " points"]:
        """Those that did not repeat; others that are not finite failed."""
        return np.isfinite(found[:, 0]) & (found[:, list(self.metrics).index("cycles_to_repeat")] == 0)

    def patient(self, system: StickSlip, accuracy: Accuracy) -> tuple[Float[Array, " metrics"], Count]:
        when, opening = timing(system.drive), _orbit(system, accuracy)
        # From the orbit on it repeats at once; where none was found these cycles are the last that were seen.
        cycles = integrate_cycles(restarted(system, opening.x), when.period, when.phases, accuracy, 0.0, PERIODS + 1)
        decay = jnp.where(jnp.isfinite(opening.multiplier), opening.multiplier, _ratio(cycles))
        measured = _measured(system, cycles, opening.repeats, decay)
        failure = jnp.where(cycles.failure > 0, cycles.failure, opening.failure)
        return measured, jnp.where((failure == 0) & (opening.grazing < GRAZES), GRAZING, failure)

    def opening(self, system: StickSlip) -> Opening:
        return lax.stop_gradient(_orbit(lax.stop_gradient(system), FINE))

    def course(self, system: StickSlip, opening: Opening) -> Course:
        return _course(system, opening, FINE)

    def moved_opening(
        self,
        system: StickSlip,
        opening: Opening,
        monodromy: Float[Array, "components components"],
        driven: Float[Array, "components by"],
    ) -> Float[Array, "components by"]:
        """(I - M)^-1 dP/dp, without what nothing depends on; NaN where Newton's method found no orbit."""
        moved = moved_orbit(system, monodromy, driven)
        return jnp.where(jnp.isfinite(opening.multiplier), moved, jnp.nan)


def _course(system: StickSlip, opening: Opening, accuracy: Accuracy) -> Course:
    when, again = timing(system.drive), restarted(system, opening.x)
    span = jnp.where(opening.repeats > 0, opening.repeats, PERIODS)
    run = integrate_steps(again, span * when.period + when.phases[-1], accuracy)
    failure = jnp.where(opening.failure > 0, opening.failure, run.failure)
    return Course(system, again, run, jnp.zeros(()), span, PERIODS, failure)


def _orbit(system: StickSlip, accuracy: Accuracy) -> Opening:
    """Of the steady motion; of the last cycle that was integrated where it does not repeat."""
    period = timing(system.drive).period
    found = steady_state(system, period, accuracy, 0.1 * TOLERANCE, partial(grazing, system))
    return Opening(found.x, found.period, found.multipliers[0], found.grazing, found.failure)


def _measured(system: StickSlip, cycles: Cycles, period: Count, decay: Scalar) -> Float[Array, " metrics"]:
    """The metrics, in the mean over the cycles until the motion repeats, or over the last where it does not."""
    when = timing(system.drive)
    effector = jax.vmap(lambda x: effector_at(system, x))(cycles.x)
    last, found = effector.shape[0], cycles_at(when, effector)
    span = jnp.where(period > 0, period, last - 1)
    counts = jnp.arange(last - 1) >= last - 1 - span
    mean = lambda values: jnp.sum(jnp.where(counts, values, 0.0)) / span
    # What a steady cycle shifts is the same at every phase; flanks that still ring would tell it less well.
    net = (effector[-1, 0] - effector[last - 1 - span, 0]) / span
    stroke = mean(found.stroke)
    by_name = dict(net_step=net, speed=net * when.frequency, efficiency=net / stroke, stroke=stroke)
    by_name |= dict(back_slip=stroke - net, cycles_to_repeat=period * 1.0, decay=decay)
    return jnp.stack([by_name[name] for name in (METRICS | _OWN)])


def _ratio(cycles: Cycles) -> Scalar:
    """What is left of a deviation after a cycle; nothing where two cycles are equal."""
    return jnp.where(jnp.isfinite(cycles.ratio), cycles.ratio, 0.0)
