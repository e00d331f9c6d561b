"""What is computed at a point of a sweep: the drive and the actuator that its numbers make, and what they do.

Every point is its own simulation from rest; the last of its cycles is measured (`cycle_metrics`).  Points are
computed side by side, a block at a time.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from ..core import Count
from ..drive.base import AbstractDrive
from ..integration import FAILURES, Accuracy, Taylor, integrate_to_times
from ..metrics import FLANK, cycle_metrics
from ..simulation import StickSlip
from ..study import Models

ACCURACY = Accuracy(tolerance=3e-11, method=Taylor(8))
"""Side by side a low order is faster; this agrees with single runs to 1e-4 um."""

_LINE = 6
"""Samples by which the line of a flank is found."""

_INSIDE = 1e-6
"""How far inside the fitted part they stay, in parts of a flank: rounding must not put one outside."""


class Metric(NamedTuple):
    """What is measured at each point."""

    unit: str
    """In SI."""
    says: str
    """In words."""


METRICS = {
    "net_step": Metric("m", "net step of a cycle"),
    "speed": Metric("m/s", "average speed"),
    "efficiency": Metric("1", "step efficiency (3.1)"),
    "stroke": Metric("m", "stroke of the stick phase"),
    "back_slip": Metric("m", "back-slip"),
}
"""By name; the columns of what is found at a point, before its failure."""

SKIPPED, NOT_COMPUTED = len(FAILURES), len(FAILURES) + 1

POINT_FAILURES = (
    *FAILURES,
    "skipped: the numbers of its drive contradict each other",
    "its block of points could not be computed",
)
"""What the failure of a point means; 0 is none."""


class PointFunction(eqx.Module):
    """What is found at a point, as a function of its numbers."""

    models: Models
    drive: AbstractDrive
    """The drive that is varied."""
    paths: tuple[str, ...] = eqx.field(static=True)
    """What a point has numbers for."""
    numbers: dict[str, float]
    """What all points share, by path [SI]."""
    cycles: int = eqx.field(static=True)
    accuracy: Accuracy

    def __call__(self, values: Float[Array, " paths"]) -> tuple[Float[Array, " metrics"], Count]:
        """The `METRICS` of one point, and its failure, an index into `POINT_FAILURES`."""
        system = self.system(values)
        frequency, flanks = jnp.asarray(system.drive.cycle_frequency(), float), system.drive.flanks()
        period = 1.0 / frequency
        fall = jnp.zeros(()) if flanks is None else jnp.asarray(flanks.fast, float)
        phases = fall + (period - fall) * jnp.linspace(FLANK[0] + _INSIDE, FLANK[1] - _INSIDE, _LINE)
        times = jnp.concatenate([(self.cycles - 1) * period + phases, self.cycles * period + phases])
        state, _, _, failure = integrate_to_times(system, times, self.accuracy)
        y, _ = jax.vmap(system.actuator.driven_platform.platform)(state.driven)
        measured = cycle_metrics(times, y - state.d, frequency, (self.cycles - 1) * period, 1, fall)
        metrics = jnp.stack([getattr(measured, name)[0] for name in METRICS])
        return jnp.where(failure > 0, jnp.nan, metrics), jnp.where(jnp.isfinite(metrics).all(), failure, 2)

    def system(self, values: Float[Array, " paths"]) -> StickSlip:
        """The actuator under its drive at a point."""
        numbers = {**self.numbers, **dict(zip(self.paths, values, strict=True))}
        fields = {path.removeprefix("drive."): path for path in numbers if path.startswith("drive.")}
        changed = {f: jnp.asarray(numbers[path], float) for f, path in fields.items() if hasattr(self.drive, f)}
        return StickSlip(self.models.actuator(numbers), self.drive.with_numbers(changed))


@eqx.filter_jit
def compute_block(
    function: PointFunction, points: Float[Array, "lanes paths"]
) -> tuple[Float[Array, "lanes metrics"], Int[Array, " lanes"]]:
    """Metrics and failure of each point of a block, compiled."""
    return jax.vmap(function)(points)
