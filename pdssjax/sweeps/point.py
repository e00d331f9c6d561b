"""What is computed at a point of a sweep: the drive and the actuator that its numbers make, and what they do.

Every point is its own simulation from rest.  Points are computed side by side, a block at a time.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..core import Count
from ..drive.base import AbstractDrive
from ..integration import FAILURES, Accuracy
from ..simulation import StickSlip
from ..study import Models
from .cycles.base import AbstractCycle

SKIPPED, NOT_COMPUTED = len(FAILURES), len(FAILURES) + 1

POINT_FAILURES = (
    *FAILURES,
    "skipped: the numbers of its drive contradict each other",
    "its block of points could not be computed",
)
"""What the failure of a point means; 0 is none."""

_FEW = 8
"""Points that are looked at patiently in one call."""


class PointFunction(eqx.Module):
    """What is found at a point, as a function of its numbers."""

    models: Models
    drive: AbstractDrive
    """The drive that is varied."""
    paths: tuple[str, ...] = eqx.field(static=True)
    """What a point has numbers for."""
    numbers: dict[str, float]
    """What all points share, by path [SI]."""
    cycle: AbstractCycle
    """Which cycle is measured."""
    accuracy: Accuracy

    def __call__(self, values: Float[Array, " paths"], patient: bool = False) -> tuple[Float[Array, " metrics"], Count]:
        """The metrics of one point, and its failure, an index into `POINT_FAILURES`."""
        look = self.cycle.patient if patient else self.cycle.measure
        metrics, failure = look(self.system(values), self.accuracy)
        return jnp.where(failure > 0, jnp.nan, metrics), jnp.where(jnp.isfinite(metrics).all(), failure, 2)

    def system(self, values: Float[Array, " paths"]) -> StickSlip:
        """The actuator under its drive at a point."""
        numbers = {**self.numbers, **dict(zip(self.paths, values, strict=True))}
        fields = {path.removeprefix("drive."): path for path in numbers if path.startswith("drive.")}
        changed = {f: jnp.asarray(numbers[path], float) for f, path in fields.items() if hasattr(self.drive, f)}
        return StickSlip(self.models.actuator(numbers), self.drive.with_numbers(changed))


def compute_block(
    function: PointFunction, points: Float[np.ndarray, "lanes paths"]
) -> Float[np.ndarray, "lanes columns"]:
    """Metrics and failure of each point of a block, one row a point."""
    found = _rows(_side_by_side(function, jnp.asarray(points)))
    left = np.flatnonzero(function.cycle.unfinished(found[:, :-1]))
    for begin in range(0, len(left), _FEW):
        few = left[begin : begin + _FEW]
        asked = points[np.resize(few, _FEW)]
        found[few] = _rows(_one_by_one(function, jnp.asarray(asked)))[: len(few)]
    return found


@eqx.filter_jit
def _side_by_side(
    function: PointFunction, points: Float[Array, "lanes paths"]
) -> tuple[Float[Array, "lanes metrics"], Int[Array, " lanes"]]:
    return jax.vmap(function)(points)


@eqx.filter_jit
def _one_by_one(
    function: PointFunction, points: Float[Array, "few paths"]
) -> tuple[Float[Array, "few metrics"], Int[Array, " few"]]:
    return jax.lax.map(lambda values: function(values, patient=True), points)


def _rows(found: tuple[Float[Array, "lanes metrics"], Int[Array, " lanes"]]) -> Float[np.ndarray, "lanes columns"]:
    metrics, failure = found
    return np.concatenate([np.asarray(metrics), np.asarray(failure, float)[:, None]], axis=1)
