"""Ends of likelihood intervals: how far one parameter can go while the others make the best of it.

The 95 % interval of a parameter holds the values at which chi-square, minimised over all other parameters, stays
below its minimum plus a threshold.  Each end is found without a curve (D. J. Venzon and S. H. Moolgavkar, Applied
Statistics 37(1), 1988): with residual r, Jacobian J and C = (J'J)^-1 at the current point, the linear model's own
end is the next point.  Where steps vanish the gradient has no component but the parameter's own, and chi-square is
the threshold's, whatever the model left out: only the rate depends on it, and is mended by mixing in the steps
before (D. G. Anderson, Journal of the ACM 12(4), 1965).
"""

import enum
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int

Evaluate = Callable[[Float[np.ndarray, " p"]], tuple[Float[Array | np.ndarray, " n"], Float[Array | np.ndarray, "n p"]]]
"""Whitened residual and its Jacobian at a point; not finite where the model cannot be evaluated."""

Solve = Callable[[Bool[np.ndarray, " p"], Float[np.ndarray, " p"]], Float[np.ndarray, " p"]]
"""From what is held, and the step that it keeps, to the step of all."""

MOST_EVALUATIONS = 100
"""For one end."""

_LEVEL = 5e-5
"""Share of the threshold by which chi-square may miss it at an end, and by which the others may still lower it."""

_TRUSTED = 1.0
"""First radius of trust, in standard errors."""

_MIXED = 6
"""Steps before that are mixed in near an end."""

_NEAR = 0.1
"""Length of a step, in standard errors, and share of the threshold by which chi-square misses it, near an end."""

_SMALLEST = 1e-3
"""Radius below which chi-square does not follow its model: it has a discontinuity there."""

_NULL = 1e-7
"""Relative singular value of a direction in which the residual does not change."""


class Verdict(enum.StrEnum):
    """How a search for an end ended."""

    BOUNDED = "bounded"
    """Chi-square reaches the threshold at the end given."""
    AT_BOUND = "held by a bound"
    """It stays below the threshold up to the parameter's bound, which is the end given."""
    FLAT = "flat"
    """It stays below the threshold farther than can be followed."""
    LOWER = "several minima"
    """A point with a smaller chi-square than the optimum's was found on the way."""
    LOST = "not followed"
    """It has a discontinuity on the way, cannot be evaluated, or takes too many evaluations."""


class End(NamedTuple):
    """One end of the interval of a parameter."""

    value: float
    """On the fit's scale; infinite where flat, NaN where not followed."""
    verdict: Verdict
    point: Float[np.ndarray, " p"]
    """All parameters there."""
    chi2: float
    evaluations: int


def interval_end(
    evaluate: Evaluate,
    optimum: Float[np.ndarray, " p"],
    index: int,
    side: float,
    threshold: float,
    bounds: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
    reach: float = 7.0,
) -> End:
    """The end of one parameter's interval on one `side` (-1.0 or 1.0).

    **Arguments:** the `optimum` of the sum of squares between `bounds`; the `threshold` by which chi-square may
    exceed its minimum; how far the parameter is followed before it counts as flat, `reach` on the fit's scale
    (7: a factor of a thousand).
    """
    return _Search(evaluate, np.asarray(optimum, float), index, side, threshold, bounds, reach).run()


class _Model(NamedTuple):
    """The linear model at a point."""

    step: Float[np.ndarray, " p"]
    """To its own end of the interval."""
    chi2: float
    """What it predicts there."""


class _Search:
    def __init__(
        self,
        evaluate: Evaluate,
        optimum: Float[np.ndarray, " p"],
        index: int,
        side: float,
        threshold: float,
        bounds: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
        reach: float,
    ):
        self.evaluate, self.index, self.side, self.reach = evaluate, index, side, reach
        self.low, self.high = (np.asarray(end, float) for end in bounds)
        self.bound = float((self.high if side > 0 else self.low)[index])
        # What runs away is held there: its effect has died out long before.
        self.low, self.high = np.maximum(self.low, optimum - reach), np.minimum(self.high, optimum + reach)
        self.optimum, self.threshold = optimum, threshold
        self.evaluations = 0
        self.residual, self.jacobian = self._evaluated(optimum)
        self.least = float(self.residual @ self.residual)
        self.target = self.least + threshold
        self.sizes = self._standard_errors()

    def run(self) -> End:
        """Follow the linear models' ends until they stay where they are."""
        at, radius, past = self.optimum.copy(), _TRUSTED, []
        while self.evaluations < MOST_EVALUATIONS:
            model = self._model(at, radius)
            moved = self._mixed(at, model.step, past)
            length = float(np.max(np.abs((moved - at) / self.sizes)))
            chi2 = float(self.residual @ self.residual)
            if self._is_stationary(at, chi2):
                if abs(chi2 - self.target) < _LEVEL * self.threshold:
                    return self._end(at, Verdict.BOUNDED)
                if chi2 < self.target and at[self.index] == self.bound:
                    return self._end(at, Verdict.AT_BOUND)
                if chi2 < self.target and abs(at[self.index] - self.optimum[self.index]) >= self.reach:
                    return self._end(at, Verdict.FLAT)._replace(value=self.side * np.inf)
            residual, jacobian = self._evaluated(moved)
            found = float(residual @ residual) if np.isfinite(residual).all() else np.inf
            # Off the valley by less than the threshold: the next step comes back to it.
            if not abs(found - model.chi2) < 0.5 * (abs(model.chi2 - chi2) + self.threshold):
                radius = 0.25 * min(radius, max(length, _SMALLEST))
                past.clear()
                if radius < _SMALLEST:
                    return self._end(at, Verdict.LOST)._replace(value=np.nan)
                continue
            agrees = abs(found - model.chi2) < 0.1 * (abs(model.chi2 - chi2) + self.threshold)
            radius *= 3.0 if agrees else 1.0
            at, self.residual, self.jacobian = moved, residual, jacobian
            if found < self.least - 0.01 * self.threshold:
                return self._end(at, Verdict.LOWER)
        return self._end(at, Verdict.LOST)._replace(value=np.nan)

    def _mixed(
        self, at: Float[np.ndarray, " p"], step: Float[np.ndarray, " p"], past: list[tuple[np.ndarray, np.ndarray]]
    ) -> Float[np.ndarray, " p"]:
        """Where to go from `at`: its `step`, mixed with those of the points in `past`, to which both are added.

        The linear combination of the points whose steps, combined alike, are shortest, and its step from there.
        """
        missed = abs(float(self.residual @ self.residual) - self.target)
        if np.max(np.abs(step / self.sizes)) > _NEAR or missed > _NEAR * self.threshold:
            past.clear()
        past.append((at / self.sizes, step / self.sizes))
        del past[: -_MIXED - 1]
        if len(past) < 2:
            return np.clip(at + step, self.low, self.high)
        points, steps = (np.diff(np.stack(column, axis=1).astype(float)) for column in zip(*past, strict=True))
        shares = np.linalg.lstsq(steps, past[-1][1], rcond=1e-6)[0]
        mixed = step - self.sizes * ((points + steps) @ shares)
        return np.clip(at + mixed, self.low, self.high)

    def _model(self, at: Float[np.ndarray, " p"], radius: float) -> _Model:
        """The linear model's end within the bounds and the radius of trust."""
        step = self._within(at, self._outwards)
        step = step * min(1.0, radius / max(float(np.max(np.abs(step / self.sizes))), 1e-300))
        step = np.clip(at + step, self.low, self.high) - at
        return _Model(step, float(np.sum((self.residual + self.jacobian @ step) ** 2)))

    def _within(self, at: Float[np.ndarray, " p"], solve: Solve) -> np.ndarray:
        """What `solve` makes of the linear model, where what would leave the bounds moves to them and no further."""
        low, high = self.low - at, self.high - at
        held, step = low >= high, np.zeros(at.size)
        for _ in range(at.size):
            step = solve(held, step)
            beyond = ~held & ((step < low) | (step > high))
            if not beyond.any():
                break
            # The parameter itself last of all: the others first make the best of it.
            if beyond.sum() > 1:
                beyond[self.index] = False
            step, held = np.where(beyond, np.clip(step, low, high), step), held | beyond
        return np.clip(step, low, high)

    def _outwards(self, held: Bool[np.ndarray, " p"], step: Float[np.ndarray, " p"]) -> np.ndarray:
        """delta0 + side sqrt((target - m) / C_ii) C e_i, where delta0 minimises the linear model and m is its least.

        What is `held` keeps its `step`; with the parameter itself held, that is delta0.
        """
        step = np.where(held, step, 0.0)
        free = np.flatnonzero(~held)
        left, singular, rows, norms = self._factors(free)
        residual = self.residual + self.jacobian @ step
        step[free] = -rows.T @ ((left.T @ residual) / singular) / norms
        if held[self.index]:
            return step
        least = float(np.sum((self.residual + self.jacobian @ step) ** 2))
        profiled = int(np.flatnonzero(free == self.index)[0])
        unit = rows[:, profiled] / singular / norms[profiled]  # e_i in the singular directions; unit' unit is C_ii
        length = np.sqrt(max(self.target - least, 0.0) / max(float(unit @ unit), 1e-300))
        step[free] += self.side * length * (rows.T @ (unit / singular)) / norms
        return step

    def _factors(self, free: Int[np.ndarray, " free"]):
        """Singular values and vectors of the Jacobian's `free` columns, of unit norm."""
        norms = np.linalg.norm(self.jacobian[:, free], axis=0)
        norms = np.where(norms > 0, norms, 1.0)
        left, singular, rows = np.linalg.svd(self.jacobian[:, free] / norms, full_matrices=False)
        return left, np.maximum(singular, _NULL * np.max(singular, initial=1e-300)), rows, norms

    def _is_stationary(self, at: Float[np.ndarray, " p"], chi2: float) -> bool:
        """The other parameters cannot lower chi-square any more, by the linear model and within the bounds."""
        profiled = np.arange(at.size) == self.index
        step = self._within(at, lambda held, step: self._outwards(held | profiled, np.where(profiled, 0.0, step)))
        best = self.residual + self.jacobian @ step
        return chi2 - float(best @ best) < _LEVEL * self.threshold

    def _standard_errors(self) -> np.ndarray:
        """Of all parameters at the optimum, none longer than can be followed."""
        _, singular, rows, norms = self._factors(np.arange(self.optimum.size))
        errors = np.linalg.norm(rows / singular[:, None], axis=0) / norms
        return np.minimum(errors * np.sqrt(self.threshold), self.reach)

    def _evaluated(self, at: Float[np.ndarray, " p"]):
        self.evaluations += 1
        residual, jacobian = self.evaluate(at)
        return np.asarray(residual), np.asarray(jacobian)

    def _end(self, at: Float[np.ndarray, " p"], verdict: Verdict) -> End:
        chi2 = float(self.residual @ self.residual)
        return End(float(at[self.index]), verdict, at.copy(), chi2, self.evaluations)
