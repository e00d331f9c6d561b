"""The least-squares problem of a study, apart from loop and method: residuals, Jacobian, bounds, scale.

Any solver can take it; `pose_problem` makes it of a study.
"""

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import equinox as eqx
import numpy as np
from jax.core import Tracer
from jax.tree_util import register_dataclass
from jaxtyping import Array, Bool, Float

from ..core import ScalarLike, on_device, require_float64
from ..integration import Accuracy
from ..piezo.base import DeterminableRange, Shown
from ..study import MARK, Parameter, Predictor, Record, Study, Values
from .effort import USUAL, Effort
from .initial_values.record_features import interval_of, noise_of, swing_of
from .initial_values.search import initial_guess
from .losses.base import AbstractLoss
from .parameter_transform import Box, transform_of
from .prior import Prior
from .residual import Evaluator, Residual
from .solver.iterations import FunctionEvaluations, Linearised, Point
from .solver.minimisers import Minimiser

Watch: TypeAlias = Callable[["Problem", Bool[np.ndarray, " records"], Any], None]
"""A callback after every iteration, with the problem, the records used, and the `least_squares.Fit` so far."""


@register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Problem:
    """What a fit needs, made once for all its steps; a pytree, which passes through `jit` and as `args` of a solver.

    Parameters are p numbers on the scale of the fit (`parameter_transform`), and there are n residuals: of all samples
    and of what was measured apart; `encode` and `decode` lead from and to numbers in SI by path.
    """

    residual: Residual
    records: tuple[Record, ...] = dataclasses.field(metadata={"static": True})
    """The records fitted."""
    noise: Float[Array | np.ndarray, " records"]
    """Standard deviation of each, in its unit."""
    watch: Watch | None = dataclasses.field(default=None, metadata={"static": True})
    minimiser: Minimiser | None = dataclasses.field(default=None, metadata={"static": True})
    """Another solver of optimistix that looks for the minimum in place of the package's own."""
    predictor: Predictor | None = None
    """The prediction of all records of the study, fitted or not; None for a problem of your own."""
    places: tuple[int, ...] = dataclasses.field(default=(), metadata={"static": True})
    """Where the records fitted stand among those."""
    effort: Effort = dataclasses.field(default=USUAL, metadata={"static": True})
    """After how many iterations and slow steps a run ends."""

    def _replace(self, **changes: Any) -> "Problem":
        return dataclasses.replace(self, **changes)

    @property
    def rows(self) -> list[slice]:
        """Where each record's samples stand among the residuals."""
        ends = np.cumsum([0, *(record.time.size for record in self.records)])
        return [slice(int(a), int(b)) for a, b in itertools.pairwise(ends)]

    @property
    def rows_apart(self) -> slice:
        """Where what was measured apart stands among the residuals, by `residual.prior`: behind the samples."""
        samples = sum(record.time.size for record in self.records)
        return slice(samples, samples + len(self.residual.comparison.prior.paths))

    @property
    def bounds(self) -> Box:
        """Lower and upper, on the fit's scale."""
        return self.residual.transform.low, self.residual.transform.high

    def fitted_to(self, used: Sequence[Bool[np.ndarray, " samples"]]) -> "Problem":
        """The problem with only the `used` samples of each record; the others have a residual of 0.

        For cross-validation: what is compiled is shared, so that parts may be held out in turn.  Noise and counts of
        samples stay those of whole records.
        """
        return self._replace(
            residual=eqx.tree_at(lambda residual: residual.comparison.used, self.residual, tuple(used))
        )

    def encode(self, values: Values) -> Float[np.ndarray, " p"]:
        """Values by path [SI] on the fit's scale."""
        return self.residual.transform.encode(values)

    def decode(self, free: Point) -> dict[str, ScalarLike]:
        """Values by path [SI] from the fit's scale."""
        return self.residual.transform.decode(free)

    def whitened(self, free: Point) -> Float[Array, " n"]:
        """Residuals of all records divided by their noise; compiled, differentiable.

        NaN where the simulation cannot finish.
        """
        return self.evaluations(self._weights()).values(free)[0]

    def jacobian(self, free: Point) -> Float[Array, "n p"]:
        """The Jacobian of `whitened`; compiled."""
        return self.linearised(free)[1]

    def linearised(self, free: Point) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
        """`whitened` and `jacobian` at once, for the price of the second; compiled."""
        (whitened, _), (jacobian, _) = self.evaluations(self._weights()).linearised(free)
        return whitened, jacobian

    def evaluations(self, weights: Float[Array | np.ndarray, " records"]) -> "FunctionEvaluations | _StudyEvaluations":
        """Compiled residuals and Jacobian, with `weights` (1/noise) of the records, 0 to leave one out."""
        if (evaluator := self._evaluator) is None:
            return FunctionEvaluations(self.residual, weights)
        return _StudyEvaluations(self.residual, weights, evaluator)

    def motions(self, values: Values) -> list[Float[np.ndarray, " samples"]]:
        """Predict all records of the study by the parameters `values` [SI], with the compiled function of a fit.

        **Raises** `ValueError` for a problem of your own, which knows no study.
        """
        if self._evaluator is None:
            raise ValueError("Expected the problem of a study.")
        return [np.asarray(motion) for motion in self._evaluator([values], self._weights()).motions]

    @property
    def _evaluator(self) -> Evaluator | None:
        if self.predictor is None:
            return None
        residual = self.residual
        free = residual.transform.paths
        paths = tuple(sorted([*residual.fixed, *free]))
        return Evaluator(self.predictor, residual.comparison, residual.accuracy, self.places, paths, free)

    @property
    def linearisation(self) -> Callable[[Point], tuple[Float[Array, " n"], Float[Array, "n p"]]]:
        """`linearised` as a pytree, for what is compiled with it."""
        return eqx.Partial(linearised_residual, self.residual, self._weights())

    def _weights(self) -> Float[Array | np.ndarray, " records"]:
        return 1.0 / self.noise


def linearised_residual(
    residual: Residual, weights: Float[Array | np.ndarray, " records"], free: Point
) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
    """Whitened residuals and their Jacobian, for what is compiled with them."""
    (whitened, _), (jacobian, _) = FunctionEvaluations(residual, weights).linearised(free)
    return whitened, jacobian


class _StudyEvaluations(NamedTuple):
    """The evaluations of a study's residual by one compiled function that predicts all its records.

    Traced evaluations, which compile together with their caller, predict the fitted records alone.
    """

    residual: Residual
    weights: Float[Array | np.ndarray, " records"]
    evaluator: Evaluator

    def values(self, point: Point) -> tuple[Float[Array, " n"], Float[Array, " records"]]:
        if self._is_traced(point):
            return self.residual(point, self.weights)
        found = self.evaluator([self.residual.values(point)], self.weights, self._used())
        return found.residual, found.offsets

    def linearised(self, point: Point) -> Linearised:
        if self._is_traced(point):
            return FunctionEvaluations(self.residual, self.weights).linearised(point)
        directions = self.residual.transform.directions(np.asarray(point))
        found = self.evaluator([self.residual.values(point)], self.weights, self._used(), directions)
        return (found.residual, found.offsets), (found.jacobian, found.offsets_jacobian)

    def _used(self) -> Bool[np.ndarray, " all_records"]:
        used = np.zeros(len(self.evaluator.predictor.samples), bool)
        used[list(self.evaluator.places)] = np.asarray(self.weights) > 0
        return used

    def _is_traced(self, point: Point) -> bool:
        return isinstance(point, Tracer) or isinstance(self.weights, Tracer)


SHORTEST = 1e-9
"""Least duration of a free flank [s], which the records cannot tell from a jump."""


def _bounded_parameters(study: Study) -> dict[str, Parameter]:
    """The parameters, bounded by what the fitted records determine where the study gives no bound.

    Free flanks are no shorter than `SHORTEST` where a jump is not their limit: a flank of no length has the derivative
    of what is linear, not that of hysteresis or of an amplifier that slews.
    """
    ranges, out = determinable_ranges(study), dict(study.parameters)
    jumps = study.models.piezo.closed and "amplifier" not in study.models.parts
    for path, p in study.parameters.items():
        if p.free and not jumps and path.startswith("drive.") and p.quantity.unit == "s" and p.bounds()[0] == 0.0:
            out[path] = dataclasses.replace(p, low=SHORTEST)
        if path in ranges:
            low = ranges[path].low if p.low is None else p.low
            high = ranges[path].high if p.high is None else p.high
            out[path] = dataclasses.replace(p, low=low, high=high) if low < high else p
    return out


def determinable_ranges(study: Study) -> dict[str, DeterminableRange]:
    """Find the range in which the fitted records can determine each free parameter, by path, where there is one.

    An element of creep that is quicker than the samples takes over the gain.  Of one that takes much longer than the
    records these show only the quotient of size and time.  An element of hysteresis that slips within the flicker of
    the voltage takes over the gain, too.  The range is widened to hold a start that the study gives.
    """
    driven = [record for record in study.records if record.role == "fit" and record.drive is not None]
    if not driven:
        return {}
    shown = Shown(
        duration=max(float(record.time[-1] - record.time[0]) for record in driven) or None,
        interval=min(map(interval_of, driven)) or None,
        swing=max(map(swing_of, driven)) or None,
    )
    found = {f"piezo.{name}": within for name, within in study.models.piezo.determinable_ranges(shown).items()}
    out = {}
    for path, parameter in study.parameters.items():
        within, start = found.get(path.partition(MARK)[0]), parameter.start
        if within is not None and parameter.free:
            if start is not None:
                within = within._replace(low=min(within.low, start), high=max(within.high, start))
            out[path] = within
    return out


def pose(
    study: Study,
    starts: Mapping[str, float],
    accuracy: Accuracy,
    loss: AbstractLoss | None = None,
    effort: Effort = USUAL,
) -> Problem:
    """The fit of a study's records with role "fit", parameters scaled after their `starts`."""
    records = tuple(record for record in study.records if record.role == "fit")
    fixed = {path: starts[path] for path, parameter in study.parameters.items() if not parameter.free}
    transform = transform_of(_bounded_parameters(study), starts, study.constraints, str(study.path or study.title))
    prior = Prior.measured_apart(study.parameters)
    residual = Residual.of(study.models, records, transform, fixed, accuracy, loss, prior)
    samples = lambda residual: (residual.comparison.measured, residual.comparison.used)
    residual = eqx.tree_at(samples, residual, on_device(samples(residual)))
    noise = np.array([noise_of(record) for record in records])
    places = tuple(place for place, record in enumerate(study.records) if record.role == "fit")
    return Problem(residual, records, noise, predictor=on_device(study.predictor), places=places, effort=effort)


def pose_problem(study: Study, accuracy: Accuracy | None = None) -> tuple[Problem, Float[np.ndarray, " p"]]:
    """The least-squares problem of a study's records, and where a fit starts, for a solver of your own.

        problem, start = pdssjax.pose_problem(study)
        found = scipy.optimize.least_squares(problem.whitened, start, problem.jacobian, problem.bounds, x_scale="jac")
        values = problem.decode(found.x)

    **Arguments:** a `study` whose records with role "fit" are explained.  What has neither value nor
    start is guessed from the records; noise that is not given is that of each record's floor.

    **Returns:** the problem, and the starts on the scale of the fit, shape (parameters,), within the bounds.

    **Raises:** `InputError` where the clock of a record cannot be that of its drive, and where JAX works in
    single precision.
    """
    require_float64("pose_problem")
    starts = initial_guess(study)
    problem = pose(study, starts, accuracy or study.accuracy)
    return problem, np.clip(problem.encode(starts), *problem.bounds)
