"""The posterior to draw from: the model around its optimum, and the ends of each parameter's likelihood.

The ends are of the profile likelihood, 2.4 standard errors out where chi-square is a parabola.  A polynomial that only
its own draws have taught knows little of where it leads there, and the draws that would teach it are those that it
does not propose: an evaluation at each end does.
"""

import math
from collections.abc import Callable
from concurrent.futures import Executor
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...core import InputError
from ..least_squares import Progress
from ..parameter_transform import Box
from .at_bounds import AtBounds, at_bounds
from .end_search import End
from .linear_intervals import NORMAL_95
from .profile_likelihood import Evaluate, Which, interval_ends, learn_curvature
from .quadratic_end import factors
from .randomize_then_optimize import Mixture, Proposals, Widths, propose
from .residual_polynomial import ResidualPolynomial, count_points, learned_polynomial, of_second_order
from .second_order import Linearisation

_FAR = 1.5 * NORMAL_95**2
"""Excess of chi-square at the ends: 1.5 times that at those of a 95 % interval."""

BEYOND = 0.5 * math.erfc(math.sqrt(0.5 * _FAR))
"""Share of a posterior beyond such an end, where it is as wide as the likelihood."""

Residuals = Callable[[Float[np.ndarray, " p"]], Float[Array | np.ndarray, " n"]]
"""Whitened residuals at a point; not finite where it cannot be simulated."""


class LikelihoodEnd(NamedTuple):
    """How far a parameter can go while the others make the best of it."""

    parameter: int
    """Index of the parameter."""
    side: float
    """-1.0 below the optimum, 1.0 above."""
    end: End


class Model(NamedTuple):
    """The posterior to draw from."""

    evaluate: Evaluate
    """Residuals and Jacobian."""
    residuals: Residuals
    optimum: Linearisation
    axes: Float[np.ndarray, "p q"]
    """Axes along which parameters move."""
    held: AtBounds
    """Parameters with their optimum at a bound."""
    bounds: Box
    logarithmic: Bool[np.ndarray, " p"]
    """Which numbers are the logarithms of their values."""
    factor: float
    """Factor by which variances exceed those of the noise given."""
    first: ResidualPolynomial
    """Curvature of the residuals, learned from all evaluations so far."""
    ends: tuple[LikelihoodEnd, ...]
    """Ends of the likelihood of each parameter that moves, far out."""

    @property
    def prior_slopes(self) -> Float[np.ndarray, " p"]:
        """Gradient of the logarithm of the prior."""
        return prior_slopes(self.logarithmic)

    def log_prior(self, free: Float[np.ndarray, "*n p"]) -> Float[np.ndarray, "*n"]:
        """The logarithm of the prior, but for a constant."""
        return (free - self.optimum.at) @ self.prior_slopes

    def mixture(self, learned: ResidualPolynomial, widths: Widths) -> Mixture:
        """The mixture around a polynomial that was `learned`, with variances enlarged by the `widths`."""
        numbers = jax.tree.map(np.asarray, (self.factor, widths))
        return Mixture(learned, self.axes, self.held, *numbers)

    def proposals(
        self, learned: ResidualPolynomial, widths: Widths, count: int, random: np.random.Generator
    ) -> Proposals:
        """Draws of that mixture."""
        return propose(self.mixture(learned, widths), self.bounds, count, random)

    def along_axes(self, free: Float[np.ndarray, "*n p"]) -> Float[np.ndarray, "*n q"]:
        """Numbers on the scale of the fit as distances from the optimum along the axes."""
        return (free - self.optimum.at) @ np.linalg.pinv(self.axes).T


def prior_slopes(logarithmic: Bool[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    """Gradient of the log of a prior flat in the values: where x is the logarithm of one, its density is exp(x)."""
    return logarithmic.astype(float)


def principal_axes(optimum: Linearisation, moving: Int[np.ndarray, " q"], factor: float) -> Float[np.ndarray, "p q"]:
    """A with A A' the covariance of the linear model at an `optimum`, of the parameters at the places `moving`."""
    _, singular, rows, norms = factors(optimum.jacobian[:, moving])
    axes = np.zeros((optimum.at.size, moving.size))
    axes[moving] = np.sqrt(factor) * (rows / singular[:, None]).T / norms[:, None]
    return axes


def posterior_model(
    evaluate: Evaluate,
    residuals: Residuals,
    optimum: Linearisation,
    moving: Int[np.ndarray, " q"],
    bounds: Box,
    logarithmic: Bool[np.ndarray, " p"],
    factor: float,
    executor: Executor | None,
    report: Progress,
) -> Model:
    """The model around its `optimum`, with the parameters at the places `moving`; see `Model` for the others.

    Ends are searched for side by side in the threads of the `executor`.

    **Raises:** `InputError` where the model cannot be simulated at its optimum.
    """
    if not np.isfinite(optimum.chi2):
        raise InputError("posterior: found a model that cannot be simulated at its optimum; expected a finished fit.")
    report("posterior: curvature at the optimum")
    threshold = _FAR * factor
    shared = learn_curvature(evaluate, optimum, threshold, bounds, factor, executor=executor)
    which: list[Which] = [(int(index), side) for index in moving for side in (-1.0, 1.0)]
    tell = lambda done: report(f"posterior: where the likelihood ends, {done} of {len(which)} ends")
    found = interval_ends(evaluate, optimum, which, threshold, bounds, shared, executor=executor, report=tell)
    axes = principal_axes(optimum, moving, factor)
    if len(shared.points) + 1 < count_points(moving.size):
        first = of_second_order(optimum, shared.at_optimum, axes)
    else:
        first = learned_polynomial(optimum, shared.points, axes, factor).turned()
    ends = tuple(LikelihoodEnd(index, side, end) for (index, side), end in zip(which, found, strict=True))
    held = at_bounds(optimum, axes, moving, bounds, factor, prior_slopes(logarithmic))
    return Model(evaluate, residuals, optimum, axes, held, bounds, logarithmic, factor, first, ends)
