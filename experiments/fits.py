"""Fits of the records of a study with one compiled function, for experiments that compare many laws.

`pdssjax.identify` compiles several functions and looks for starts; comparing ten laws within minutes needs less.  Here
the problem of a study is posed once, with every listed parameter in it.  Which of them are free, and which samples are
fitted, is chosen afterwards, so that variants and held-out parts cost no compilation.

    curves = Curves(study, accuracy, starts)
    found = curves.fit(starts, free=["friction.f_c"], used=masks)

All samples count alike; their noise is estimated from what is left, so that with n samples, sum of squares S
and k free numbers (parameters, offsets, noise) AIC = n ln(S/n) + 2 k and BIC = n ln(S/n) + k ln(n).
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float

from pdssjax import Accuracy, Study, pose_problem
from pdssjax.inference import Fit, fit_phase, least_squares_covariance

_AT_BOUND = 1e-6
"""So near to a bound, on the fit's scale, a parameter is at it."""
_TELLS = 0.7
"""Part of what the bounds alone leave open below which the data have told something."""


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
    """The problem of a study, all of whose records may be fitted."""

    def __init__(self, study: Study, accuracy: Accuracy, starts: Mapping[str, float]):
        """`starts` [SI] size the parameters; compiles at the first use."""
        sized = {path: dataclasses.replace(p, value=None, start=starts[path]) for path, p in study.parameters.items()}
        records = tuple(dataclasses.replace(record, role="fit") for record in study.records)
        problem, _ = pose_problem(dataclasses.replace(study, parameters=sized, records=records), accuracy)
        self.study = study
        self.noise = float(np.max(problem.noise))
        """What residuals are divided by [SI], the same of all records."""
        self.problem = problem._replace(noise=np.full(len(records), self.noise))

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
        transform = self.problem.residual.transform
        fit = self._run(transform.encode(starts), transform.among(free), used, limit)
        values = {path: float(value) for path, value in self.problem.decode(fit.free).items()}
        offsets = sum(r.offset is None and bool(m.any()) for r, m in zip(self.study.records, used, strict=True))
        count, samples = len(free) + offsets, sum(int(mask.sum()) for mask in used)
        errors = self._errors(fit, transform.among(free), samples - count)
        return Found(
            values=values,
            errors={path: float(errors[transform.paths.index(path)]) for path in free},
            squares=self.noise**2 * fit.chi2,
            samples=samples,
            free=count,
            predicted=self._predicted(fit, used),
            iterations=int(fit.state.iterations),
            converged=fit.success,
        )

    def _run(
        self,
        point: Float[np.ndarray, " p"],
        fitted: Bool[np.ndarray, " p"],
        used: Sequence[Bool[np.ndarray, " n"]],
        limit: int,
    ) -> Fit:
        """Where a run of at most `limit` iterations ends."""
        every = np.ones(len(used), bool)
        return fit_phase(self.problem.fitted_to(used), point, every, fitted, "", lambda message: None, limit)

    def _errors(self, fit: Fit, fitted: Bool[np.ndarray, " p"], freedom: int) -> Float[np.ndarray, " p"]:
        """Standard errors [SI], by the scatter of the residuals with so many degrees of `freedom`."""
        transform = self.problem.residual.transform
        low, high = self.problem.bounds
        inside = fitted & (fit.free > low + _AT_BOUND) & (fit.free < high - _AT_BOUND)
        residuals, jacobian = np.asarray(fit.state.residual), np.asarray(fit.state.jacobian)
        if not (math.isfinite(fit.chi2) and np.isfinite(jacobian[:, inside]).all()):
            return np.full(fitted.size, np.nan)
        deviation = math.sqrt(residuals @ residuals / freedom)
        # The bounds are known as well: as spread as numbers anywhere between them.
        bounds = (high - low) / math.sqrt(12.0)
        known = np.vstack([jacobian, np.diag(deviation / bounds)])
        errors = deviation * np.sqrt(np.diag(least_squares_covariance(known, ~inside).matrix))
        return np.where(errors < _TELLS * bounds, errors * np.abs(transform.slope(fit.free)), np.nan)

    def _predicted(self, fit: Fit, used: Sequence[Bool[np.ndarray, " n"]]) -> list[Float[np.ndarray, " n"]]:
        """Every record where the `fit` ended, also the samples that it was not fitted to."""
        whole = self._run(fit.free, np.zeros(fit.free.size, bool), [np.ones_like(mask) for mask in used], 0)
        residuals = self.noise * np.asarray(whole.state.residual) + (0.0 if math.isfinite(whole.chi2) else np.nan)
        predicted = []
        for record, rows, mask in zip(self.study.records, self.problem.rows, used, strict=True):
            left = residuals[rows]
            among = mask if mask.any() else np.ones_like(mask)
            predicted.append(record.measured - left + (np.mean(left[among]) if record.offset is None else 0.0))
        return predicted
