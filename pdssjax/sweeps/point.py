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
from .blocks import GRAZING, INCOMPLETE, shared_out, whole_shares
from .cycles import METRICS, OF_FLANKS, AbstractCycle, Metric, closing, step_metrics
from .further_metrics import FURTHER, SMOOTH, counted, nearest_to_grazing, output_force, peak_friction

_FEW = 8
"""Points that are computed patiently in one call; one per device where there are more devices."""


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
    """Which cycle is measured."""
    accuracy: Accuracy
    further: tuple[str, ...] = eqx.field(static=True, default=())
    """Which of the `FURTHER` metrics are found besides."""
    by: tuple[str, ...] = eqx.field(static=True, default=())
    """The paths by which derivatives are taken."""

    @property
    def columns(self) -> dict[str, Metric]:
        """All that is found, by name: the metrics of the cycle, further ones, derivatives."""
        found = self.cycle.metrics | {name: FURTHER[name] for name in self.further}
        declared = self.models.declared() | {f"drive.{field}": q for field, q in self.drive.declared().items()}
        units = {path: quantity.unit for path, quantity in declared.items()}
        slopes = {
            f"{name}_by_{path.replace('.', '_')}": Metric(
                per_unit(found[name].unit, units.get(path, "")), f"{found[name].says} by {path}", path
            )
            for name in self.smooth
            for path in self.by
        }
        return found | slopes

    @property
    def smooth(self) -> tuple[str, ...]:
        """The metrics of which derivatives are taken."""
        every = (*METRICS, *(name for name in self.further if name in SMOOTH)) if self.by else ()
        return tuple(name for name in every if name not in self.lacking)

    @property
    def lacking(self) -> tuple[str, ...]:
        """The metrics that cycles of this drive have not: NaN."""
        return () if self.drive.flanks() is not None else OF_FLANKS

    def __call__(self, values: Float[Array, " paths"], patient: bool = False) -> tuple[Float[Array, " metrics"], Count]:
        """The metrics of one point, and its failure, an index into `POINT_FAILURES`."""
        measure = self.cycle.patient if patient else self.cycle.measure
        metrics, failure = measure(self.system(values), self.accuracy)
        failed = (failure > 0) & (failure != GRAZING)
        known = jnp.isfinite(metrics) | np.array([name in self.lacking for name in self.cycle.metrics])
        return jnp.where(failed, jnp.nan, metrics), jnp.where(known.all(), failure, 2)

    def system(
        self, values: Float[Array, " paths"], moved: Mapping[str, ScalarLike] | None = None, blocked: bool = False
    ) -> StickSlip:
        """The actuator under its drive at a point; with numbers `moved`, or with a stop in its way."""
        numbers = {**self.numbers, **dict(zip(self.paths, values, strict=True)), **(moved or {})}
        fields = {path.removeprefix("drive."): path for path in numbers if path.startswith("drive.")}
        changed = {f: jnp.asarray(numbers[path], float) for f, path in fields.items() if hasattr(self.drive, f)}
        return StickSlip(self.models.actuator(numbers, blocked), self.drive.with_numbers(changed))

    def details(self, values: Float[Array, " paths"]) -> tuple[Float[Array, " details"], Count]:
        """The further metrics and the derivatives of one point, and the failure of the integration."""
        found, slopes, failure = self._course_details(values, tuple(n for n in self.further if n != "output_force"))
        if "output_force" in self.further:
            pushed, by, failed = self._course_details(values, ("output_force",), blocked=True)
            found, slopes, failure = found | pushed, slopes | by, jnp.where(failure > 0, failure, failed)
        further = [found[name] for name in self.further]
        return jnp.concatenate([jnp.array(further), *(slopes[name] for name in self.smooth)]), failure

    def _course_details(
        self, values: Float[Array, " paths"], asked: tuple[str, ...], blocked: bool = False
    ) -> tuple[dict[str, Scalar], dict[str, Float[Array, " by"]], Count]:
        """Metrics of a point's course by name, the derivatives of those that are smooth, and the failure."""
        opening = self.cycle.opening(self.system(values, blocked=blocked))

        def measured(at: Float[Array, " by"], x: Float[Array, " components"]):
            """What is differentiated, smooth metrics and the state that ends the course; and all metrics, whether a
            reversal grazes, which leaves neither derivatives nor multipliers, and the failure."""
            system = self.system(values, dict(zip(self.by, at, strict=True)), blocked)
            course = self.cycle.course(system, opening._replace(x=x))
            found = {"output_force": output_force(course)} if blocked else step_metrics(course)
            found |= {"peak_friction": peak_friction(course)} if "peak_friction" in asked else {}
            near = jnp.fmin(opening.grazing, nearest_to_grazing(course))
            grazes = near < GRAZES
            others = {} if blocked else counted(course, jnp.where(grazes, jnp.nan, opening.multiplier), near)
            return (found, closing(course)), (found | others, grazes, course.failure)

        failure_of = lambda grazes, failure: jnp.where((failure == 0) & grazes, GRAZING, failure)
        if not self.by:
            _, (found, grazes, failure) = measured(jnp.zeros(0), opening.x)
            # Of a numbered cycle only the multiplier and derivatives suffer.
            suffers = grazes & ((opening.repeats > 0) | ("multiplier" in asked))
            return found, {}, failure_of(suffers, failure)
        numbers = self.numbers | dict(zip(self.paths, values, strict=True))
        at = jnp.stack([jnp.asarray(numbers[path], float) for path in self.by])
        # Each a pair: by the numbers, and by the state of the opening.
        derived, (found, grazes, failure) = jax.jacfwd(measured, (0, 1), has_aux=True)(at, opening.x)
        smooth, (driven, monodromy) = derived
        moved = self.cycle.moved_opening(self.system(values, blocked=blocked), opening, monodromy, driven)
        moved = jnp.where(grazes, jnp.nan, moved)
        slopes = {name: by_number + by_state @ moved for name, (by_number, by_state) in smooth.items()}
        return found, slopes, failure_of(grazes, failure)


def per_unit(unit: str, of: str) -> str:
    """The unit of a derivative: that of what is derived over that of the number by which."""
    bracketed = lambda symbols: f"({symbols})" if any(sign in symbols for sign in " /") else symbols
    above, below = (bracketed(symbols) if symbols not in ("", "1") else "" for symbols in (unit, of))
    return f"{above or 1}/{below}" if below else unit or "1"


def compute_block(
    function: PointFunction, points: Float[np.ndarray, "lanes paths"]
) -> Float[np.ndarray, "lanes columns"]:
    """Metrics and failure of each point of a block, one row a point."""
    found = np.column_stack(_results(_side_by_side, function, points, len(points)))
    left = np.flatnonzero(function.cycle.unfinished(found[:, :-1]))
    for few in _batches(left):
        found[few] = np.column_stack(_results(_one_by_one, function, points[few]))
    if not (function.further or function.by):
        return found
    # Further metrics and derivatives stand before the failure.
    details = np.full((len(points), len(function.columns) - len(function.cycle.metrics)), np.nan)
    # What fills up a block is its last point again, and need not be computed again.
    last = len(points) - int(np.argmin(np.append((points[::-1] == points[-1]).all(axis=1), False)))
    sound = np.flatnonzero(np.isin(found[: last + 1, -1], (0, GRAZING)))
    for few in _batches(sound):
        numbers, failure = _results(_details, function, points[few])
        known = np.where(np.isfinite(numbers) & np.isin(failure, (0, GRAZING))[:, None], numbers, np.nan)
        details[few] = known
        whole = np.where(np.isfinite(known).all(axis=1), 0, INCOMPLETE)
        found[few, -1] = np.where((failure == GRAZING) | (found[few, -1] == GRAZING), GRAZING, whole)
    details[last + 1 :], found[last + 1 :] = details[last], found[last]
    return np.column_stack([found[:, :-1], details, found[:, -1]])


def _results(
    compute: Callable[[PointFunction, Array], tuple[Array, Array]],
    function: PointFunction,
    points: Float[np.ndarray, "few paths"],
    room: int = _FEW,
) -> tuple[Float[np.ndarray, "few columns"], Int[np.ndarray, " few"]]:
    """Results of `compute` at the points of one call, which has `room` for so many at least, and their failures."""
    count = whole_shares(room)
    # What there is room for besides is some of the points again.
    numbers, failure = compute(function, jnp.asarray(np.resize(points, (count, points.shape[1]))))
    return np.asarray(numbers)[: len(points)], np.asarray(failure)[: len(points)]


def _batches(chosen: Int[np.ndarray, " chosen"]) -> Iterator[Int[np.ndarray, " few"]]:
    """The points that are computed in one call, call after call."""
    most = whole_shares(_FEW)
    return (chosen[begin : begin + most] for begin in range(0, len(chosen), most))


@eqx.filter_jit
def _side_by_side(
    function: PointFunction, points: Float[Array, "lanes paths"]
) -> tuple[Float[Array, "lanes metrics"], Int[Array, " lanes"]]:
    return shared_out(jax.vmap(function), points)


@eqx.filter_jit
def _one_by_one(
    function: PointFunction, points: Float[Array, "few paths"]
) -> tuple[Float[Array, "few metrics"], Int[Array, " few"]]:
    return shared_out(lambda share: jax.lax.map(lambda values: function(values, patient=True), share), points)


@eqx.filter_jit
def _details(
    function: PointFunction, points: Float[Array, "few paths"]
) -> tuple[Float[Array, "few details"], Int[Array, " few"]]:
    return shared_out(lambda share: jax.lax.map(function.details, share), points)
