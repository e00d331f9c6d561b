"""The computation at one point of a sweep: drive and actuator from its numbers, and their metrics.

Every point is its own simulation from rest.  Points are computed side by side, a block at a time.
"""

from collections.abc import Callable, Iterator, Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ..core import Count, Scalar, ScalarLike
from ..drive.base import AbstractDrive
from ..integration import GRAZES, Accuracy
from ..simulation import StickSlip
from ..study import Models
from .blocks import GRAZING, INCOMPLETE, map_over_devices, round_up_to_devices
from .cycles import FLANK_METRICS, METRICS, AbstractCycle, Metric, final_state, step_metrics
from .further_metrics import FURTHER, SMOOTH, counted, nearest_to_grazing, output_force, peak_friction

_FEW = 8
"""Points of a call that computes them one after the other; rounded up to the number of devices."""


class PointFunction(eqx.Module):
    """The results at a point, as a function of its numbers."""

    models: Models
    drive: AbstractDrive
    """The drive that is varied."""
    paths: tuple[str, ...] = eqx.field(static=True)
    """Paths of the numbers that differ from point to point."""
    numbers: dict[str, float]
    """Numbers that all points share, by path [SI]."""
    cycle: AbstractCycle
    """The cycle that is measured."""
    accuracy: Accuracy
    further: tuple[str, ...] = eqx.field(static=True, default=())
    """Names of the `FURTHER` metrics to compute."""
    by: tuple[str, ...] = eqx.field(static=True, default=())
    """The paths by which derivatives are taken."""

    @property
    def columns(self) -> dict[str, Metric]:
        """All results but the failure, by name: the metrics of the cycle, further metrics, derivatives."""
        metrics = self.cycle.metrics | {name: FURTHER[name] for name in self.further}
        declared = self.models.declared() | {f"drive.{field}": q for field, q in self.drive.declared().items()}
        units = {path: quantity.unit for path, quantity in declared.items()}
        derivatives = {
            f"{name}_by_{path.replace('.', '_')}": Metric(
                per_unit(metrics[name].unit, units.get(path, "")), f"{metrics[name].description} by {path}", path
            )
            for name in self.smooth
            for path in self.by
        }
        return metrics | derivatives

    @property
    def smooth(self) -> tuple[str, ...]:
        """Names of the metrics of which derivatives are taken."""
        names = (*METRICS, *(name for name in self.further if name in SMOOTH)) if self.by else ()
        return tuple(name for name in names if name not in self.undefined)

    @property
    def undefined(self) -> tuple[str, ...]:
        """Names of the metrics that are NaN, since this drive has no slow and fast flank."""
        return () if self.drive.flanks() is not None else FLANK_METRICS

    def __call__(self, values: Float[Array, " paths"], patient: bool = False) -> tuple[Float[Array, " metrics"], Count]:
        """The metrics of one point, and its failure, an index into `POINT_FAILURES`."""
        measure = self.cycle.measure_patiently if patient else self.cycle.measure
        metrics, failure = measure(self.system(values), self.accuracy)
        failed = (failure > 0) & (failure != GRAZING)
        known = jnp.isfinite(metrics) | np.array([name in self.undefined for name in self.cycle.metrics])
        return jnp.where(failed, jnp.nan, metrics), jnp.where(known.all(), failure, 2)

    def system(
        self, values: Float[Array, " paths"], moved: Mapping[str, ScalarLike] | None = None, blocked: bool = False
    ) -> StickSlip:
        """The actuator under its drive at a point, with the numbers `moved`; where `blocked`, against a stop."""
        numbers = {**self.numbers, **dict(zip(self.paths, values, strict=True)), **(moved or {})}
        fields = {path.removeprefix("drive."): path for path in numbers if path.startswith("drive.")}
        changed = {f: jnp.asarray(numbers[path], float) for f, path in fields.items() if hasattr(self.drive, f)}
        return StickSlip(self.models.actuator(numbers, blocked), self.drive.with_numbers(changed))

    def details(self, values: Float[Array, " paths"]) -> tuple[Float[Array, " details"], Count]:
        """The further metrics and the derivatives of one point, and the failure of the integration."""
        metrics, slopes, failure = self._course_details(values)
        if "output_force" in self.further:
            blocked_metrics, blocked_slopes, failed = self._course_details(values, blocked=True)
            metrics, slopes = metrics | blocked_metrics, slopes | blocked_slopes
            failure = jnp.where(failure > 0, failure, failed)
        further = [metrics[name] for name in self.further]
        return jnp.concatenate([jnp.array(further), *(slopes[name] for name in self.smooth)]), failure

    def _course_details(
        self, values: Float[Array, " paths"], blocked: bool = False
    ) -> tuple[dict[str, Scalar], dict[str, Float[Array, " by"]], Count]:
        """The metrics of a point's course by name, the derivatives of smooth ones, and the failure.

        Of a `blocked` course the only metric is the output force.
        """
        opening = self.cycle.opening(self.system(values, blocked=blocked))

        def measured(at: Float[Array, " by"], x: Float[Array, " components"]):
            """The smooth metrics and the final state, to be differentiated; and as auxiliary data all metrics, whether
            a reversal grazes, which rules out derivatives and multipliers, and the failure."""
            system = self.system(values, dict(zip(self.by, at, strict=True)), blocked)
            course = self.cycle.course(system, opening._replace(x=x))
            found = {"output_force": output_force(course)} if blocked else step_metrics(course)
            if "peak_friction" in self.further and not blocked:
                found["peak_friction"] = peak_friction(course)
            near = jnp.fmin(opening.grazing, nearest_to_grazing(course))
            grazes = near < GRAZES
            others = {} if blocked else counted(course, jnp.where(grazes, jnp.nan, opening.multiplier), near)
            return (found, final_state(course)), (found | others, grazes, course.failure)

        failure_of = lambda grazes, failure: jnp.where((failure == 0) & grazes, GRAZING, failure)
        if not self.by:
            _, (found, grazes, failure) = measured(jnp.zeros(0), opening.x)
            # In a numbered cycle grazing spoils the multiplier and derivatives alone.
            spoiled = grazes & ((opening.repeats > 0) | ("multiplier" in self.further and not blocked))
            return found, {}, failure_of(spoiled, failure)
        numbers = self.numbers | dict(zip(self.paths, values, strict=True))
        at = jnp.stack([jnp.asarray(numbers[path], float) for path in self.by])
        # Each derivative is a pair: by the numbers, and by the state of the opening.
        derived, (found, grazes, failure) = jax.jacfwd(measured, (0, 1), has_aux=True)(at, opening.x)
        smooth, (driven, monodromy) = derived
        moved = self.cycle.opening_derivatives(self.system(values, blocked=blocked), opening, monodromy, driven)
        moved = jnp.where(grazes, jnp.nan, moved)
        slopes = {name: by_number + by_state @ moved for name, (by_number, by_state) in smooth.items()}
        return found, slopes, failure_of(grazes, failure)


def per_unit(unit: str, of: str) -> str:
    """The unit of the derivative of a quantity in `unit` by a number in the unit `of`."""
    bracketed = lambda symbols: f"({symbols})" if any(sign in symbols for sign in " /") else symbols
    above, below = (bracketed(symbols) if symbols not in ("", "1") else "" for symbols in (unit, of))
    return f"{above or 1}/{below}" if below else unit or "1"


def compute_block(
    function: PointFunction, points: Float[np.ndarray, "lanes paths"]
) -> Float[np.ndarray, "lanes columns"]:
    """Metrics and failure of each point of a block, one row a point."""
    results = np.column_stack(_results(_side_by_side, function, points, len(points)))
    for few in _batches(np.flatnonzero(function.cycle.unfinished(results[:, :-1]))):
        results[few] = np.column_stack(_results(_one_by_one, function, points[few]))
    if not (function.further or function.by):
        return results
    # Further metrics and derivatives stand before the failure.
    details = np.full((len(points), len(function.columns) - len(function.cycle.metrics)), np.nan)
    # A block that is not full repeats its last point, which need not be computed again.
    last = len(points) - int(np.argmin(np.append((points[::-1] == points[-1]).all(axis=1), False)))
    sound = np.flatnonzero(np.isin(results[: last + 1, -1], (0, GRAZING)))
    for few in _batches(sound):
        numbers, failure = _results(_details, function, points[few])
        rows = np.where(np.isfinite(numbers) & np.isin(failure, (0, GRAZING))[:, None], numbers, np.nan)
        details[few] = rows
        whole = np.where(np.isfinite(rows).all(axis=1), 0, INCOMPLETE)
        results[few, -1] = np.where((failure == GRAZING) | (results[few, -1] == GRAZING), GRAZING, whole)
    details[last + 1 :], results[last + 1 :] = details[last], results[last]
    return np.column_stack([results[:, :-1], details, results[:, -1]])


def _results(
    compute: Callable[[PointFunction, Array], tuple[Array, Array]],
    function: PointFunction,
    points: Float[np.ndarray, "few paths"],
    room: int = _FEW,
) -> tuple[Float[np.ndarray, "few columns"], Int[np.ndarray, " few"]]:
    """The results and the failures of `compute` at `points`, in a call of at least `room` points."""
    count = round_up_to_devices(room)
    # The call is filled up with points from the beginning.
    numbers, failure = compute(function, jnp.asarray(np.resize(points, (count, points.shape[1]))))
    return np.asarray(numbers)[: len(points)], np.asarray(failure)[: len(points)]


def _batches(chosen: Int[np.ndarray, " chosen"]) -> Iterator[Int[np.ndarray, " few"]]:
    """The indices `chosen`, in batches for one call each."""
    size = round_up_to_devices(_FEW)
    return (chosen[begin : begin + size] for begin in range(0, len(chosen), size))


@eqx.filter_jit
def _side_by_side(
    function: PointFunction, points: Float[Array, "lanes paths"]
) -> tuple[Float[Array, "lanes metrics"], Int[Array, " lanes"]]:
    return map_over_devices(jax.vmap(function), points)


@eqx.filter_jit
def _one_by_one(
    function: PointFunction, points: Float[Array, "few paths"]
) -> tuple[Float[Array, "few metrics"], Int[Array, " few"]]:
    return map_over_devices(lambda share: jax.lax.map(lambda values: function(values, patient=True), share), points)


@eqx.filter_jit
def _details(
    function: PointFunction, points: Float[Array, "few paths"]
) -> tuple[Float[Array, "few details"], Int[Array, " few"]]:
    return map_over_devices(lambda share: jax.lax.map(function.details, share), points)
