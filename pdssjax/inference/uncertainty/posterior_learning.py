"""The polynomial that draws of a posterior are proposed from, learned where the randomized residuals of the model lie.

The polynomial of a round is solved for some randomized residuals, and from there on the model, by Newton's method with
its own Jacobian:

    w <- w + (Q' J A)^-1 (u - Q' r(x0 + A w))

A valley may be thousands of standard deviations of the linear model long: where a polynomial misses it by 10^5 in
chi-square, two such steps come to it, and all linearisations on the way teach the polynomial of the next round.
"""

import contextlib
from collections.abc import Sequence
from concurrent.futures import Executor

import numpy as np
from jaxtyping import Float

from ..draws import stream
from ..least_squares import Progress
from .posterior_model import Model
from .profile_likelihood import learn_curvature, linearise_all
from .randomize_then_optimize import NothingToDraw, Proposals, Widths, tangents
from .residual_polynomial import ResidualPolynomial, count_terms, degree_for, learned_polynomial, of_second_order
from .second_order import Linearisation

_TRIED, _ROUNDS = 5, 6
"""Rounds of learning with the ends, after which they are left out, and without them, at most."""

_MOST = 4
"""Order of a polynomial, where one of third does not agree."""

_SURPLUS = 2.5
"""Numbers that the draws of a round tell, for each coefficient of a polynomial of third order."""

_FEWEST = 24
"""Draws of a round."""

_AGREEMENT = 0.85
"""Overlap of model and polynomial from which the polynomial is good; with `_FEWEST` points 1 is seldom."""

_WIDTHS = Widths(solved=(1.2, 3.0), linear=1.0, share=0.0)
"""Widths of the mixture that draws are taken from."""

_NEWTON = 3
"""Steps of Newton's method with the model."""

_SOLVED = 0.3
"""Tolerance of the equation, in standard deviations of a residual."""


def learn(model: Model, seed: int, executor: Executor | None, report: Progress) -> ResidualPolynomial:
    """A polynomial that agrees with the model over the posterior, as far as one does.

    It begins with all that the ends of the likelihood have taught, and keeps to them.  Where no polynomial follows a
    valley that far, it begins with the curvature at the optimum alone; where kinks pass for curvature, so that
    polynomials fold over everywhere, it is the linear model.
    """
    ends = [found.end.point for found in model.ends]
    # A polynomial that folds over near the optimum has hardly any draws.
    with contextlib.suppress(NothingToDraw):
        learned, agreement = _rounds(model, model.first, ends, range(_TRIED), seed, executor, report)
        if agreement > _AGREEMENT:
            return learned
    near = learn_curvature(model.evaluate, model.optimum, 1.0, model.bounds, executor=executor).at_optimum
    first = of_second_order(model.optimum, near, model.axes)
    with contextlib.suppress(NothingToDraw):
        return _rounds(model, first, [], range(_TRIED, _TRIED + _ROUNDS), seed, executor, report)[0]
    return of_second_order(model.optimum, near._replace(second=np.zeros_like(near.second)), model.axes)


def _rounds(
    model: Model,
    polynomial: ResidualPolynomial,
    points: list[Linearisation],
    numbers: range,
    seed: int,
    executor: Executor | None,
    report: Progress,
) -> tuple[ResidualPolynomial, float]:
    """A polynomial learned from the `points` and from draws of a `polynomial`, round after round, until it agrees.

    **Returns:** with it the overlap of the model's density with that of the polynomial of the round before.
    """
    moving, agreement = model.axes.shape[1], 0.0
    count = max(_FEWEST, int(_SURPLUS * count_terms(moving, degree_for(moving)) / (1 + moving)))
    for number in numbers:
        report(f"posterior: learning the residuals, round {number + 1}")
        proposed = model.proposals(polynomial, _WIDTHS, count, stream(seed, "learn", number))
        there = linearise_all(model.evaluate, list(proposed.free), executor)
        exact = np.array([-0.5 * point.chi2 / model.factor for point in there])
        weight = model.log_prior(proposed.free) - proposed.log_proposed
        agreement = in_common(exact + weight, proposed.log_learned + weight)
        points = [*points, *there]
        good = agreement > _AGREEMENT
        if not good:
            points += solved_further(model, proposed, there, executor)
        most = polynomial.degree if good else _MOST
        polynomial = learned_polynomial(model.optimum, points, model.axes, model.factor, most).turned()
        if good:
            break
    return polynomial, agreement


def solved_further(
    model: Model, proposed: Proposals, there: Sequence[Linearisation], executor: Executor | None
) -> list[Linearisation]:
    """Linearisations on the way from the polynomial's solutions to those of the model.

    **Arguments:** the draws `proposed` by a polynomial, and the model's linearisations `there`.
    """
    basis = np.asarray(tangents(model.optimum.jacobian @ model.axes @ np.asarray(model.held.free_directions())))
    free = slice(model.held.rates.size, None)
    found: list[Linearisation] = []
    due = list(zip(proposed.randomized, there, strict=True))
    for _ in range(_NEWTON):
        left = [target[free] - basis.T @ point.residual for target, point in due]
        unsolved = [
            (target, np.clip(point.at + model.axes @ _newton_step(model, basis, point, rest), *model.bounds))
            for (target, point), rest in zip(due, left, strict=True)
            if np.isfinite(point.chi2) and np.linalg.norm(rest) > _SOLVED * np.sqrt(model.factor)
        ]
        places = [place for _, place in unsolved]
        due = list(
            zip([target for target, _ in unsolved], linearise_all(model.evaluate, places, executor), strict=True)
        )
        found += [point for _, point in due]
    return found


def _newton_step(
    model: Model, basis: Float[np.ndarray, "n q-k"], point: Linearisation, left: Float[np.ndarray, " q-k"]
) -> Float[np.ndarray, " q"]:
    """The step along the axes that solves the equation by the linear model at a `point`.

    What the polynomial has for parameters at bounds is what they have.
    """
    rows = np.concatenate([model.held.rows, basis.T @ point.jacobian @ model.axes])
    return np.linalg.lstsq(rows, np.append(np.zeros(len(model.held.rows)), left))[0]


def in_common(first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"]) -> float:
    """Overlap of two densities, 1 where they are equal: from logarithms of their weights at the same draws."""
    weights = []
    for logs in (first, second):
        finite = np.isfinite(logs)
        if not finite.any():
            return 0.0
        weight = np.exp(np.where(finite, logs, -np.inf) - np.max(logs[finite]))
        weights.append(weight / np.sum(weight))
    return float(np.sum(np.minimum(*weights)))
