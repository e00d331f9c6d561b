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

from pdssjax.integration import Accuracy
from pdssjax.parameters import scale
from pdssjax.study import Study
from pdssjax.uncertainty import covariance

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
        loose = {path: dataclasses.replace(p, value=None) for path, p in study.parameters.items()}
        self.study = study
        self.scale = scale(loose, starts)
        predictor = study.predictor

        def both(point):
            out = predictor(self.scale.decode(point), accuracy)
            return out, out

        self._both = jax.jit(jax.jacfwd(both, has_aux=True))

    def predict(self, point: Float[np.ndarray, " p"]) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Every record's motion without offset, and its Jacobian, shape (samples, parameters)."""
        slopes, out = self._both(jnp.asarray(point))
        return [np.asarray(o) for o in out], [np.asarray(slope) for slope in slopes]

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
        loose = np.array([path in free for path in self.scale.paths])
        point = self.scale.encode(starts)
        low, high = (np.where(loose, end, point) for end in (self.scale.low, self.scale.high))
        point = np.clip(point, low, high)
        rest, jacobian = self._residual(point, used)
        damping, taken, converged = 1e-2, 0, False
        while taken < limit and not converged and _usable(rest, jacobian[:, loose]):
            taken += 1
            held = ~loose | ((point <= low) & (jacobian.T @ rest > 0)) | ((point >= high) & (jacobian.T @ rest < 0))
            reduced = np.where(held, 0.0, jacobian)
            norms = np.linalg.norm(reduced, axis=0)
            norms = np.maximum(norms, 1e-9 * norms.max())
            system = np.vstack([reduced, np.diag(math.sqrt(damping) * norms)])
            step = np.linalg.lstsq(system, -np.concatenate([rest, np.zeros(point.size)]), rcond=None)[0]
            step *= min(1.0, 2.0 / np.abs(step).max()) if step.any() else 1.0
            trial = np.clip(point + step, low, high)
            expected = rest @ rest - np.sum((rest + reduced @ (trial - point)) ** 2)
            rest_there, jacobian_there = self._residual(trial, used)
            gained = rest @ rest - rest_there @ rest_there
            if _usable(rest_there, jacobian_there[:, loose]) and gained > 0:
                point, rest, jacobian = trial, rest_there, jacobian_there
                damping = max(damping / 5.0, 1e-12)
            else:
                damping *= 6.0
            converged = 0.0 <= expected < 1e-4 * (rest @ rest) / rest.size or damping > 1e8
        inside = loose & (point > low + _AT_BOUND) & (point < high - _AT_BOUND)
        return self._found(point, rest, jacobian, inside, free, used, taken, converged)

    def _residual(self, point, used):
        """Predicted less measured where used, offsets taken out, and the Jacobian."""
        parts, slopes = [], []
        for record, motion, jacobian, mask in zip(self.study.records, *self.predict(point), used, strict=True):
            if mask.any():
                rest, slope = (motion - record.measured)[mask], jacobian[mask]
                centred = record.offset is None
                parts.append(rest - rest.mean() if centred else rest + record.offset)
                slopes.append(slope - slope.mean(axis=0) if centred else slope)
        return np.concatenate(parts), np.concatenate(slopes)

    def _found(self, point, rest, jacobian, inside, free, used, taken, converged) -> Found:
        offsets = sum(r.offset is None and bool(m.any()) for r, m in zip(self.study.records, used, strict=True))
        count = len(free) + offsets
        errors = np.full(point.size, np.nan)
        if _usable(rest, jacobian[:, inside]):
            deviation = math.sqrt(rest @ rest / (rest.size - count))
            # The bounds are known as well: as spread as numbers anywhere between them.
            bounds = (self.scale.high - self.scale.low) / math.sqrt(12.0)
            known = np.diag(deviation / bounds)
            errors = deviation * np.sqrt(np.diag(covariance(np.vstack([jacobian, known]), ~inside).matrix))
            errors = np.where(errors < _TELLS * bounds, errors * np.abs(self.scale.slope(point)), np.nan)
        predicted = []
        for record, motion, mask in zip(self.study.records, self.predict(point)[0], used, strict=True):
            among = mask if mask.any() else np.ones_like(mask)
            zero = np.mean((record.measured - motion)[among]) if record.offset is None else record.offset
            predicted.append(motion + zero)
        return Found(
            values={path: float(value) for path, value in self.scale.decode(point).items()},
            errors={path: float(errors[self.scale.paths.index(path)]) for path in free},
            squares=float(rest @ rest) if np.isfinite(rest).all() else math.inf,
            samples=rest.size,
            free=count,
            predicted=predicted,
            iterations=taken,
            converged=bool(converged),
        )


def _usable(rest: np.ndarray, jacobian: np.ndarray) -> bool:
    """Whether the records could be predicted there, with a derivative."""
    return bool(
        np.isfinite(rest).all() and np.isfinite(jacobian).all() and np.abs(jacobian).max(initial=0.0) < _ENDLESS
    )
