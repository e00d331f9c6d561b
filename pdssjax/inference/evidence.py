"""The evidence of a fit: residuals, degrees of freedom and statistics, each computed once, when first needed.

Races between starts, the verdict on the fit, the errors of its parameters and its statistics all read it.

**Samples that stand out.**  Least squares is pulled by glitches: twelve of 100 standard deviations among 1000 samples
move the prediction of all others by as much as noise.  So the others are not judged by what the fit leaves of them,
but by what the optimum of them alone would, to first order.

**More than noise.**  Where a record's noise is given, its residuals are judged by chi-square.  Where it is not, the
noise is estimated from the residuals, and chi-square equals the number of samples for any fit.  Then a misfit shows by
what repeats from cycle to cycle, and by neighbours that are alike, unless they are as large along all of each record:
that is coloured noise.
In a wrong optimum that is nearly as good as the right one the records ask for different parameters long before their
residuals are visibly too large: each has a wrong optimum of its own there.

**Criteria** of Akaike (AIC) and Schwarz (BIC):

    AIC = -2 log L + 2 p,   BIC = -2 log L + p log n,   -2 log L = chi2 + 2 sum log(s Z)

with p fitted numbers, the free offsets among them, n samples and what was measured apart, and the noise s of each
sample.  Z makes the loss a likelihood: sqrt(2 pi) for squares.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from ..metrics import outliers, unevenness
from ..study import Statistics, Study, cycles_a_second, repeated_residuals
from .beyond_noise import SIGNIFICANT, highest_by_chance, is_unresolved, largest_by_chance
from .covariance import NO_INFORMATION, Covariance, least_squares_covariance, scaled_least_squares
from .diagnosis import contradicting, records_agreement
from .least_squares import Fit, by_record, evaluated, quiet
from .problem import Problem
from .stack_parameters import platform_alone_records, stack_parameters, stack_residuals
from .validation import MissedRecord, missed_records

_POOR = 1.15
"""Reduced chi-square above which a fit is poor, where the noise is only guessed from the samples."""

_ROUNDS = 5
"""Rounds of looking for samples that stand out: what pulls the fit off hides smaller ones."""


class WithoutOutliers(NamedTuple):
    """A fit without the samples that stand out, to first order, of n residuals and p parameters."""

    outlying: Bool[np.ndarray, " n"]
    """Whether each sample stands out."""
    residual: Float[np.ndarray, " n"]
    """Whitened, as the loss counts them; NaN where a sample stands out."""
    step: Float[np.ndarray, " p"]
    """From the fitted point to the end of that fit, on its scale; 0 under a robust loss, which outliers hardly pull."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The evidence of a fit of a problem with n residuals and p free parameters."""

    problem: Problem
    fit: Fit
    study: Study | None = None
    """The study whose validation records are predicted; None: no validation records are judged."""
    after_stack: bool = False
    """The fit is the second of two steps: of what is fitted after the stack, to what does not show the platform
    alone."""

    # ------------------------------------------------------------------------------------------ degrees of freedom

    @cached_property
    def degrees_of_freedom(self) -> int:
        """Samples less what is fitted, the free offsets counted; at least 1."""
        offsets = sum(record.offset is None for record in self.problem.records)
        return max(np.size(self.fit.state.residual) - self.fit.free.size - offsets, 1)

    @property
    def reduced_chi2(self) -> float:
        """Chi-square per degree of freedom."""
        return self.fit.chi2 / self.degrees_of_freedom

    @cached_property
    def effective_parameters(self) -> Float[np.ndarray, " records"]:
        """Effective number of parameters that each record determines, by leverage; a free offset counts as one.

        A few precise samples may determine nearly all parameters; the fit then follows them nearly exactly.
        """
        problem, free = self.problem, self.fit.free
        used, fitted = np.ones(len(problem.records), bool), np.ones(free.size, bool)
        jacobian = np.asarray(self.fit.state.jacobian)
        if self.after_stack:
            used, fitted = ~platform_alone_records(problem.records), ~stack_parameters(problem)
            jacobian = jacobian * ~stack_residuals(problem)[:, None]
        sizes = self._sizes * used
        offsets = np.array([record.offset is None for record in problem.records]) & used
        norms, count = np.linalg.norm(jacobian, axis=0), int(np.sum(fitted))
        kept = fitted & ~problem.residual.transform.at_bound(free) & (norms > 0)
        if not kept.any() or not np.isfinite(norms).all():
            return count * sizes / max(sizes.sum(), 1.0) + offsets
        basis, singular, _ = np.linalg.svd(jacobian[:, kept] / norms[kept], full_matrices=False)
        leverage = np.sum(basis[:, singular > NO_INFORMATION * singular[0]] ** 2, axis=1)
        # Parameters at bounds and those without information count, too, as in `degrees_of_freedom`.
        shares = leverage * count / np.sum(leverage)
        return np.array([np.sum(shares[rows]) for rows in problem.rows]) + offsets

    @cached_property
    def variance_factor(self) -> float:
        """Factor by which residuals enlarge the variances given; at least 1.

        By the records whose noise is given: noise that is estimated is that of the residuals already.
        """
        squares = np.array([np.sum(part**2) for part in by_record(self.problem, self.fit)])
        freedom = np.sum((self._sizes - self.effective_parameters)[self._enlarging])
        factor = float(np.sum(squares[self._enlarging]) / max(freedom, 1.0))
        return max(1.0, factor) if np.isfinite(factor) else 1.0

    @cached_property
    def noise_freedom(self) -> Float[np.ndarray, " records"]:
        """Degrees of freedom of the noise estimate of each record.

        For estimated noise these are the record's own.  Given noise is known (infinite) unless residuals exceed it:
        then all records with given noise share one estimate and its degrees of freedom.
        """
        left = self._sizes - self.effective_parameters
        together = max(float(np.sum(left[self._enlarging])), 1.0) if self.variance_factor > 1.0 else np.inf
        return np.where(self.noise_is_given, together, np.maximum(left, 1.0))

    @cached_property
    def noise_is_given(self) -> Bool[np.ndarray, " records"]:
        """Whether the study gives the noise of each record."""
        return np.array([record.noise is not None for record in self.problem.records], bool)

    @property
    def _enlarging(self) -> Bool[np.ndarray, " records"]:
        """Records by which variances are enlarged: those with noise given that the fit was fitted to."""
        alone = platform_alone_records(self.problem.records)
        return self.noise_is_given & ~alone if self.after_stack else self.noise_is_given

    @property
    def _sizes(self) -> Float[np.ndarray, " records"]:
        return np.array([record.time.size for record in self.problem.records], float)

    @cached_property
    def given_covariance(self) -> Covariance:
        """The covariance of least squares on the fit's scale by the noise given, parameters at bounds held."""
        held = self.problem.residual.transform.at_bound(self.fit.free)
        return least_squares_covariance(np.asarray(self.fit.state.jacobian), held)

    @cached_property
    def covariance(self) -> Float[np.ndarray, "p p"]:
        """`given_covariance`, enlarged where residuals exceed the noise given; NaN where nothing is known."""
        return self.given_covariance.matrix * self.variance_factor

    # ------------------------------------------------------------------------------------------ samples that stand out

    @cached_property
    def without_outliers(self) -> WithoutOutliers:
        """The fit without the samples that stand out; the fit itself where none does."""
        return fit_without_outliers(self.problem, self.fit)

    @cached_property
    def undisturbed_point(self) -> Float[np.ndarray, " p"]:
        """Optimum of the fit without the samples that stand out, on its scale; the fitted point where none does.

        The linear model gives the step.  It is discarded where it does not lower the sum of squares of the other
        samples, since the model is then not linear over that distance.
        """
        problem, fit, without = self.problem, self.fit, self.without_outliers
        if not without.step.any():
            return fit.free
        there = np.clip(fit.free + without.step, *problem.bounds)

        def squares_left(residual: Float[np.ndarray, " n"]) -> float:
            """The sum of squares of the other samples, about their mean where a record's zero is free."""
            total = 0.0
            for record, rows in zip(problem.records, problem.rows, strict=True):
                left = residual[rows][~without.outlying[rows]]
                zero = np.mean(left) if record.offset is None and left.size else 0.0
                total += float(np.sum((left - zero) ** 2))
            return total

        moved = np.asarray(evaluated(problem, there, quiet).state.residual)
        return there if squares_left(moved) < squares_left(np.asarray(fit.state.residual)) else fit.free

    # ------------------------------------------------------------------------------------------ more than noise

    @cached_property
    def is_poor(self) -> bool:
        """Whether the fit leaves more than noise, or its records contradict each other."""
        agreement = records_agreement(self.problem, self.fit, self.covariance)
        return self.leaves_more_than_noise or bool(contradicting(agreement))

    @cached_property
    def leaves_more_than_noise(self) -> bool:
        """Whether residuals are more than noise: in size, in what repeats every cycle, or in how neighbours correlate.

        The size shows little where no noise is given, and a slip at a wrong moment hides in it.  Neighbours that are
        alike, and residuals larger than their scatter, are a misfit where they lie at some places of a record, and
        coloured noise where they are as large along all of it.  Records that cannot show what is left of them
        (`is_unresolved`) have no say in what repeats and is alike.  Samples that stand out do not make a fit poor, nor
        what they pull it off by: another optimum would leave them, too.
        """
        problem = self.problem
        if not np.isfinite(self.fit.chi2):
            return True
        parts = [self.without_outliers.residual[rows] for rows in problem.rows]
        given, estimated, judged = [], [], []
        for record, part, noise in zip(problem.records, parts, problem.noise, strict=True):
            (estimated if record.noise is None else given).append(part)
            finite = part[np.isfinite(part)]
            rms = float(noise * np.sqrt(np.mean(finite**2))) if finite.size else 0.0
            if not is_unresolved(rms, record.measured, record.noise):
                judged.append((record, part))
        if self._exceeds_given_noise(given):
            return True
        samples = sum(int(np.sum(np.isfinite(part))) for _, part in judged)
        products = sum(np.nansum(part[1:] * part[:-1]) for _, part in judged)
        squares = sum(np.nansum(part**2) for _, part in judged)
        correlation = products / max(squares, 1e-300)
        repeated = [repeated_residuals(record, part) for record, part in judged]
        sigmas = [found.sigmas for found in repeated if found is not None]
        if sum(sigmas) > SIGNIFICANT * np.sqrt(len(sigmas)):
            return True
        too_large = bool(estimated) and not self._scatter(estimated)[0] < _POOR
        if not (correlation * np.sqrt(samples) > SIGNIFICANT or too_large):
            return False
        uneven = [unevenness(part, record.time) for record, part in judged]
        return max(uneven, default=np.inf) > SIGNIFICANT or sum(uneven) > SIGNIFICANT * np.sqrt(len(uneven))

    def _exceeds_given_noise(self, parts: Sequence[Float[np.ndarray, " samples"]]) -> bool:
        """Whether residuals of records whose noise is given exceed it: those of all together, or of any record.

        Taken together, many explained samples would hide one record that is not.  NaN does not count.
        """
        if not parts:
            return False
        efficiency = self.problem.residual.loss.scatter_efficiency
        variance, freedom = self._scatter(parts)
        each = [self._scatter([part]) for part in parts]
        return not variance < highest_by_chance(efficiency * freedom) or any(
            not variance < largest_by_chance(efficiency * freedom) for variance, freedom in each
        )

    def _scatter(self, parts: Sequence[Float[np.ndarray, " samples"]]) -> tuple[float, float]:
        """The variance of residuals, as the loss has it, and their degrees of freedom; without NaN."""
        residual = np.concatenate([np.zeros(0), *parts])
        residual = residual[np.isfinite(residual)]
        freedom = self.degrees_of_freedom / np.size(self.fit.state.residual) * residual.size
        scatter = self.problem.residual.loss.scatter(residual, max(freedom, 1.0)) if residual.size else 0.0
        return float(scatter**2), freedom

    @cached_property
    def missed(self) -> tuple[MissedRecord, ...]:
        """Records not fitted that are not predicted, even by parameters that move within their errors."""
        return self.missed_within(self.covariance)

    def missed_within(self, covariance: Float[np.ndarray, "p p"]) -> tuple[MissedRecord, ...]:
        """As `missed`, with another `covariance` on the fit's scale; empty for a fit without success."""
        if self.study is None or not self.fit.success or all(record.role == "fit" for record in self.study.records):
            return ()
        return missed_records(self.study, self.problem, self.undisturbed_point, covariance)

    # ------------------------------------------------------------------------------------------ statistics

    @cached_property
    def statistics(self) -> Statistics:
        """Chi-square, its degrees of freedom and the criteria, for the report."""
        problem, fit = self.problem, self.fit
        residuals = int(np.size(fit.state.residual))
        free = fit.free.size + sum(record.offset is None for record in problem.records)
        sizes = np.array([record.time.size for record in problem.records])
        # Minus twice the log-likelihood; the noise enters, since it may be estimated.
        deviance = fit.chi2 + 2.0 * np.sum(sizes * (np.log(problem.noise) + problem.residual.loss.log_volume()))
        # Up to a constant, the errors of what was measured apart.
        deviance += (residuals - sizes.sum()) * np.log(2.0 * np.pi)
        return Statistics(
            chi2=fit.chi2,
            reduced_chi2=self.reduced_chi2,
            aic=float(deviance + 2.0 * free),
            bic=float(deviance + np.log(residuals) * free),
            evaluations=fit.evaluations,
            iterations=fit.iterations,
            samples=int(sizes.sum()),
            free=free,
            noise_estimated=all(record.noise is None for record in problem.records),
            measured_apart=residuals - int(sizes.sum()),
        )


def fit_without_outliers(problem: Problem, fit: Fit) -> WithoutOutliers:
    """The `fit` without the samples that stand out, by the linear model."""
    residual = np.asarray(fit.state.residual)
    outlying, step = _outlying(problem, residual), np.zeros(fit.free.size)
    if not outlying.any() or problem.residual.loss.is_robust:
        return WithoutOutliers(outlying, np.where(outlying, np.nan, residual), step)
    # What the fit is free to change: parameters that are not at bounds, and the free zeros.
    jacobian = np.asarray(fit.state.jacobian) * ~problem.residual.transform.at_bound(fit.free)
    columns = np.column_stack([jacobian, zero_columns(problem, len(jacobian))])
    best_step = lambda used: -scaled_least_squares(columns[used], residual[used], NO_INFORMATION)
    # The difference of two steps: that with all samples is 0 only where the fit ended in an optimum.
    step_of_all, rest = best_step(np.ones(outlying.size, bool)), residual
    for _ in range(_ROUNDS):
        change = best_step(~outlying) - step_of_all
        rest, step = residual + columns @ change, change[: step.size]
        more = _outlying(problem, rest) | outlying
        if np.array_equal(more, outlying):
            break
        outlying = more
    return WithoutOutliers(outlying, np.where(outlying, np.nan, rest), step)


def _outlying(problem: Problem, roots: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Which residuals, as the loss counts them, belong to samples that stand out (`metrics.outliers`)."""
    residual, out = np.asarray(problem.residual.loss.original(jnp.asarray(roots))), np.zeros(roots.size, bool)
    for record, rows, noise in zip(problem.records, problem.rows, problem.noise, strict=True):
        predicted = record.measured - noise * residual[rows]
        out[rows][outliers(record.measured, predicted, record.time, cycles_a_second(record))] = True
    return out


def zero_columns(problem: Problem, count: int) -> Float[np.ndarray, "n z"]:
    """The derivatives of `count` whitened residuals by the free zeros, in the noise of their records."""
    free = [rows for record, rows in zip(problem.records, problem.rows, strict=True) if record.offset is None]
    ones = np.zeros((count, len(free)))
    for i, rows in enumerate(free):
        ones[rows, i] = 1.0
    return ones
