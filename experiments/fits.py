"""Least squares on the records of a study with one compiled function, for experiments that fit many laws.

`pdssjax.identify` compiles several functions and looks for starts; comparing ten laws within minutes
needs less.  Here all predictions and their derivatives with respect to every listed parameter are one
function.  Which parameters are free, and which samples are fitted, is chosen afterwards, so that
variants and held-out parts cost no compilation.

    curves = Curves(study, accuracy, starts)
    found = curves.fit(starts, free=["friction.f_c"], used=masks)

All samples count alike; their noise is estimated from what is left, so that with n samples, sum of squares S
and k free numbers (parameters, offsets, noise) AIC = n ln(S/n) + 2 k and BIC = n ln(S/n) + k ln(n).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from pdssjax import Accuracy, Study
from pdssjax.inference import SUCCESSES, BoundedLevenbergMarquardt, iterates, least_squares_covariance, transform_of

_AT_BOUND = 1e-6
"""So near to a bound, on the fit's scale, a parameter is at it."""
_TELLS = 0.7
"""Part of what the bounds alone leave open below which the data have told something."""
_ENDLESS = 1e30
"""Derivatives this large mean that the prediction blew up."""


@dataclasses.dataclass(frozen=True)
class Found:
    """Where a fit ended."""

    values: dict[str, float]
    """Every listed parameter [SI]."""
    errors: dict[str, float]
    """Standard errors of the free ones [SI]; NaN where the data say nothing or at a bound."""
    squares: float
    """Sum of squared residuals [SI]."""
    samples: int
    """Samples fitted."""
    free: int
    """Free numbers: parameters and offsets."""
    predicted: list[Float[np.ndarray, " n"]]
    """Every record's prediction [SI], offset included."""
    iterations: int
    converged: bool

    @property
    def aic(self) -> float:
        """Akaike's information criterion, up to a constant that all laws share."""
        return self.samples * math.log(self.squares / self.samples) + 2.0 * (self.free + 1)

    @property
    def bic(self) -> float:
        """Bayesian information criterion, up to the same constant."""
        return self.samples * math.log(self.squares / self.samples) + math.log(self.samples) * (self.free + 1)


class Curves:
    """The predictions of a study's records, and their derivatives."""

    def __init__(self, study: Study, accuracy: Accuracy, starts: Mapping[str, float]):
        """`starts` [SI] size the parameters; compiles at the first use."""
        fitted = {path: dataclasses.replace(p, value=None) for path, p in study.parameters.items()}
        self.study = study
        self.transform = transform_of(fitted, starts)
        predictor = study.predictor
        sizes = [record.time.size for record in study.records]
        measured = [record.measured for record in study.records]
        offsets = [record.offset for record in study.records]
        shapes = [jax.ShapeDtypeStruct((size,), float) for size in sizes]
        blank = jax.ShapeDtypeStruct((sum(sizes),), float)

        def residual(point, used):
            """Predicted less measured where used, offsets taken out; and the predictions."""
            predicted = predictor(self.transform.decode(point), accuracy)
            residuals = map(_rest, predicted, measured, used, offsets)
            return jnp.concatenate(list(residuals)), list(predicted)

        # A decrease of the sum of squares by this share is 1 in units of the variance of the residuals.
        visible = 1.0 / sum(sizes)
        solver = BoundedLevenbergMarquardt(rtol=1e-4 * visible, slow=0.05 * visible, invisible=0.01 * visible)

        self._solver, self._residual = solver, residual
        self._begin = lambda point: solver.init(residual, point, None, {}, blank, shapes, frozenset())

    def predict(self, point: Float[np.ndarray, " p"]) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Every record's motion without offset, and its Jacobian, shape (samples, parameters); NaN where it fails."""
        used = [np.ones(record.time.size, bool) for record in self.study.records]
        _, state = self._run(point, np.zeros(point.size, bool), used, 0)
        lost = np.nan if bool(state.unevaluated) else 0.0
        return [np.asarray(o) + lost for o in state.aux], [np.asarray(slope) + lost for slope in state.aux_jacobian]

    def fit(
        self,
        starts: Mapping[str, float],
        free: Sequence[str],
        used: Sequence[Bool[np.ndarray, " n"]],
        limit: int = 40,
    ) -> Found:
        """Levenberg-Marquardt from `starts` over the `free` parameters and the samples `used` of every record.

        A record of which no sample is used gets its offset all the same, for the comparison.
        """
        point = self.transform.encode(starts)
        fitted = self.transform.among(free)
        point, state = self._run(point, fitted, used, limit)
        low, high = self.transform.low, self.transform.high
        inside = fitted & (point > low + _AT_BOUND) & (point < high - _AT_BOUND)
        return self._found(point, state, inside, free, used)

    def _run(self, point, fitted, used, limit):
        """Where a run of at most `limit` iterations ends."""
        options = self.transform.bounds_where(fitted, point)
        point = jnp.clip(point, options["lower"], options["upper"])
        run = iterates(self._solver, self._residual, point, used, options, self._begin(point), limit)
        *_, (point, state) = run
        return np.asarray(point), state

    def _found(self, point, state, inside, free, used) -> Found:
        offsets = sum(r.offset is None and bool(m.any()) for r, m in zip(self.study.records, used, strict=True))
        count, samples = len(free) + offsets, sum(int(mask.sum()) for mask in used)
        residuals, jacobian = np.asarray(state.residual), np.asarray(state.jacobian)
        lost = bool(state.unevaluated)
        errors = np.full(point.size, np.nan)
        if not lost and _usable(residuals, jacobian[:, inside]):
            deviation = math.sqrt(residuals @ residuals / (samples - count))
            # The bounds are known as well: as spread as numbers anywhere between them.
            bounds = (self.transform.high - self.transform.low) / math.sqrt(12.0)
            known = np.diag(deviation / bounds)
            errors = deviation * np.sqrt(
                np.diag(least_squares_covariance(np.vstack([jacobian, known]), ~inside).matrix)
            )
            errors = np.where(errors < _TELLS * bounds, errors * np.abs(self.transform.slope(point)), np.nan)
        predicted = []
        for record, motion, mask in zip(self.study.records, state.aux, used, strict=True):
            motion = np.asarray(motion) + (np.nan if lost else 0.0)
            among = mask if mask.any() else np.ones_like(mask)
            zero = np.mean((record.measured - motion)[among]) if record.offset is None else record.offset
            predicted.append(motion + zero)
        return Found(
            values={path: float(value) for path, value in self.transform.decode(point).items()},
            errors={path: float(errors[self.transform.paths.index(path)]) for path in free},
            squares=math.inf if lost else float(residuals @ residuals),
            samples=samples,
            free=count,
            predicted=predicted,
            iterations=int(state.iterations),
            converged=int(state.ending) in SUCCESSES,
        )


def _rest(predicted, measured, mask, offset):
    """Predicted less measured where the `mask` says so, else 0; a free offset, the mean, is taken out."""
    residuals = jnp.where(mask, predicted - measured, 0.0)
    zero = jnp.sum(residuals) / jnp.maximum(jnp.sum(mask), 1) if offset is None else -offset
    return jnp.where(mask, residuals - zero, 0.0)


def _usable(residuals: np.ndarray, jacobian: np.ndarray) -> bool:
    """Whether the records could be predicted there, with a derivative."""
    return bool(
        np.isfinite(residuals).all() and np.isfinite(jacobian).all() and np.abs(jacobian).max(initial=0.0) < _ENDLESS
    )
