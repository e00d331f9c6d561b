"""Draws from the posterior of a fit, by a polynomial that is learned and independence_chain by the model.

The density is exp(-chi-square / (2 factor)), with flat priors on the values between the bounds: the zeros of the
sensors are marginalised (they are linear, and the residual leaves their projection out); the noise is taken as known,
that given or found, its variance enlarged by `factor` as those of the standard errors are.

Valleys of chi-square are narrow and bent: a sampler takes hundreds of evaluations from draw to draw, with the model a
day.  So a polynomial stands for the residuals (`residual_polynomial`).  If only its own draws had taught it, it would
know little of where it leads far out, and not propose the draws that would teach it.  So it begins with the ends of the
profile likelihood, 2.4 standard errors out where chi-square is a parabola, and is then learned round after round where
the randomized residuals of the model lie: the polynomial is solved for some of them, and from there on the model, by
Newton's method with its own Jacobian,

    w <- w + (Q' J A)^-1 (u - Q' r(x0 + A w))

A valley may be thousands of standard deviations of the linear model long: where a polynomial misses it by 10^5 in
chi-square, two such steps come to it, and all linearisations on the way teach the polynomial of the next round.

Draws of the last polynomial (`randomize_then_optimize`) are independent, some of them wider than it says lest they miss
what it does not know.  Each is a proposal, which the model accepts with probability min(1, w' / w), w the model's
density over the proposals': draws are the model's whatever the polynomial is, which only decides how many are accepted
(L. Tierney, Annals of Statistics 22(4), 1994, independence chains; J. A. Christen and C. Fox, J. Computational and
Graphical Statistics 14(4), 2005).
"""

import contextlib
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Num

from ...core import Document, InputError
from ..draws import CHAINS, DRAWS, Drawing, each_done, refuse_wrong_entries, stream
from ..least_squares import Progress
from ..parameter_transform import Box
from .at_bounds import AtBounds, at_bounds
from .linear_intervals import NORMAL_95
from .profile_likelihood import SIDES, End, EndKey, Evaluate, ProfileLikelihood, linearise_all
from .randomize_then_optimize import Mixture, NothingToDraw, Proposals, Widths, propose, tangents
from .residual_polynomial import (
    ResidualPolynomial,
    count_points,
    count_terms,
    degree_for,
    learned_polynomial,
    of_second_order,
)
from .second_order import Linearisation, scaled_svd

_END_EXCESS = 1.5 * NORMAL_95**2
"""Excess of chi-square at the ends: 1.5 times that at those of a 95 % interval."""

BEYOND = 0.5 * math.erfc(math.sqrt(0.5 * _END_EXCESS))
"""Share of a posterior beyond such an end, where it is as wide as the likelihood."""

Residuals = Callable[[Float[np.ndarray, " p"]], Float[Array | np.ndarray, " n"]]
"""Whitened residuals at a point; not finite where it cannot be simulated."""


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
    ends: Mapping[EndKey, End]
    """Ends of the likelihood of each parameter that moves, far out, by its index and the side."""

    @property
    def prior_slopes(self) -> Float[np.ndarray, " p"]:
        """Gradient of the log of a prior flat in the values: where x is the logarithm of one, its density is exp(x)."""
        return self.logarithmic.astype(float)

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


def principal_axes(optimum: Linearisation, moving: Int[np.ndarray, " q"], factor: float) -> Float[np.ndarray, "p q"]:
    """A with A A' the covariance of the linear model at an `optimum`, of the parameters at the places `moving`."""
    _, singular, rows, norms = scaled_svd(optimum.jacobian[:, moving])
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
    likelihood = ProfileLikelihood(evaluate, optimum, _END_EXCESS * factor, bounds, factor, executor)
    which: list[EndKey] = [(int(index), side) for index in moving for side in SIDES]
    tell = lambda done: report(f"posterior: where the likelihood ends, {done} of {len(which)} ends")
    ends, shared, axes = likelihood.ends(which, tell), likelihood.shared, principal_axes(optimum, moving, factor)
    if len(shared.points) + 1 < count_points(moving.size):
        first = of_second_order(optimum, shared.at_optimum, axes)
    else:
        first = learned_polynomial(optimum, shared.points, axes, factor).turned()
    held = at_bounds(optimum, axes, moving, bounds, factor, logarithmic.astype(float))
    return Model(evaluate, residuals, optimum, axes, held, bounds, logarithmic, factor, first, ends)


_ROUNDS_WITH_ENDS, _ROUNDS_WITHOUT_ENDS = 5, 6
"""Rounds of learning with the ends, after which they are left out, and without them, at most."""

_HIGHEST_ORDER = 4
"""Order of a polynomial where one of third order does not agree."""

_OVERDETERMINATION = 2.5
"""Data that the draws of a round give, for each coefficient of a polynomial of third order."""

_FEWEST = 24
"""Draws of a round."""

_AGREEMENT = 0.85
"""Overlap of model and polynomial from which the polynomial is good; with `_FEWEST` points 1 is seldom."""

_LEARNING_WIDTHS = Widths(solved=(1.2, 3.0), linear=1.0, share=0.0)
"""Widths of the mixture that draws are taken from."""

_NEWTON_STEPS = 3
"""Steps of Newton's method with the model."""

_NEWTON_TOLERANCE = 0.3
"""Tolerance of the equation, in standard deviations of a residual."""


def learn(model: Model, seed: int, executor: Executor | None, report: Progress) -> ResidualPolynomial:
    """A polynomial that agrees with the model over the posterior, as far as one does.

    It begins with all that the ends of the likelihood have taught, and keeps to them.  Where no polynomial follows a
    valley that far, it begins with the curvature at the optimum alone; where kinks pass for curvature, so that
    polynomials fold over everywhere, it is the linear model.
    """
    moving = model.axes.shape[1]
    count = max(_FEWEST, int(_OVERDETERMINATION * count_terms(moving, degree_for(moving)) / (1 + moving)))

    def rounds(
        polynomial: ResidualPolynomial, points: list[Linearisation], numbers: range
    ) -> tuple[ResidualPolynomial, bool]:
        """A polynomial learned round after round, from `points` and draws of the one before; whether they agree."""
        agrees = False
        for number in numbers:
            report(f"posterior: learning the residuals, round {number + 1}")
            proposed = model.proposals(polynomial, _LEARNING_WIDTHS, count, stream(seed, "learn", number))
            there = linearise_all(model.evaluate, list(proposed.free), executor)
            exact = np.array([-0.5 * point.chi2 / model.factor for point in there])
            weight = model.log_prior(proposed.free) - proposed.log_proposed
            agrees = overlap(exact + weight, proposed.log_learned + weight) > _AGREEMENT
            points = [*points, *there]
            if not agrees:
                points += newton_linearisations(model, proposed, there, executor)
            most = polynomial.degree if agrees else _HIGHEST_ORDER
            polynomial = learned_polynomial(model.optimum, points, model.axes, model.factor, most).turned()
            if agrees:
                break
        return polynomial, agrees

    # A polynomial that folds over near the optimum has hardly any draws.
    with contextlib.suppress(NothingToDraw):
        learned, agrees = rounds(model.first, [end.point for end in model.ends.values()], range(_ROUNDS_WITH_ENDS))
        if agrees:
            return learned
    likelihood = ProfileLikelihood(model.evaluate, model.optimum, 1.0, model.bounds, executor=executor)
    near = likelihood.shared.at_optimum
    with contextlib.suppress(NothingToDraw):
        first = of_second_order(model.optimum, near, model.axes)
        return rounds(first, [], range(_ROUNDS_WITH_ENDS, _ROUNDS_WITH_ENDS + _ROUNDS_WITHOUT_ENDS))[0]
    return of_second_order(model.optimum, near._replace(second=np.zeros_like(near.second)), model.axes)


def newton_linearisations(
    model: Model, proposed: Proposals, there: Sequence[Linearisation], executor: Executor | None
) -> list[Linearisation]:
    """Linearisations on the way from the polynomial's solutions to those of the model.

    What the polynomial has for parameters at bounds is what they have.

    **Arguments:** the draws `proposed` by a polynomial, and the model's linearisations `there`.
    """
    basis = np.asarray(tangents(model.optimum.jacobian @ model.axes @ np.asarray(model.held.free_directions())))
    held = model.held.rates.size
    found: list[Linearisation] = []
    due = list(zip(proposed.randomized, there, strict=True))
    for _ in range(_NEWTON_STEPS):
        targets, places = [], []
        for target, point in due:
            rest = target[held:] - basis.T @ point.residual
            if np.isfinite(point.chi2) and np.linalg.norm(rest) > _NEWTON_TOLERANCE * np.sqrt(model.factor):
                rows = np.concatenate([model.held.rows, basis.T @ point.jacobian @ model.axes])
                step = np.linalg.lstsq(rows, np.append(np.zeros(held), rest))[0]
                targets.append(target)
                places.append(np.clip(point.at + model.axes @ step, *model.bounds))
        due = list(zip(targets, linearise_all(model.evaluate, places, executor), strict=True))
        found += [point for _, point in due]
    return found


def overlap(first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"]) -> float:
    """Overlap of two densities, 1 where they are equal: from logarithms of their weights at the same draws."""
    weights = []
    for logs in (first, second):
        finite = np.isfinite(logs)
        if not finite.any():
            return 0.0
        weight = np.exp(np.where(finite, logs, -np.inf) - np.max(logs[finite]))
        weights.append(weight / np.sum(weight))
    return float(np.sum(np.minimum(*weights)))


BLOCK = 50
"""Draws between two moments at which they are kept."""

PROPOSALS = "randomized residuals, exponentials at bounds, streams by purpose"
"""Kind of the proposals: weights of another kind do not go with theirs."""

PROPOSAL_WIDTHS = Widths(solved=(1.2,), linear=3.0, share=0.1)
"""Widths of the mixture of proposals, which the model accepts or refuses."""


class Chains(NamedTuple):
    """Draws of several chains."""

    free: Float[np.ndarray, "chains draws p"]
    """Parameters on the scale of the fit."""
    failed: int
    """Draws that are no new ones, or trajectories that were broken off."""
    statistics: dict[str, Num[np.ndarray, "chains draws"]]
    """Statistics of each draw, by ArviZ's names: "lp", the log density of the model up to a constant, and what else the
    sampler knows."""


def sample_posterior(
    model: Model, drawing: Drawing, executor: Executor | None, report: Progress, chains: int = CHAINS
) -> Chains:
    """Draws of several chains; draws that the store has kept are not evaluated again.

    Points and blocks of draws are computed side by side in the threads of the `executor`.

    **Raises:** `InputError` where what was kept is not what a run writes; `NothingToDraw` where hardly any draw lies
    between the bounds.
    """
    wanted = drawing.count or DRAWS
    blocks = -(-wanted // BLOCK)
    shapes = {"free": (BLOCK, model.optimum.at.size), "proposed": (BLOCK,), "log_posterior": (BLOCK,)}
    with refuse_wrong_entries(drawing.store, "draws of the chains"):
        kept = {task_of(entry, shapes): entry for entry in drawing.store.kept()}
    due = [(chain, block) for block in range(blocks) for chain in range(chains) if (chain, block) not in kept]
    if due:
        learned = learn(model, drawing.seed, executor, report)
        work = functools.partial(_judge_block, model, learned, drawing.seed)
        for done, (task, entry) in enumerate(each_done(work, due, executor), 1):
            drawing.store.keep(entry)
            kept[task] = entry
            report(f"posterior: the model has judged {done * BLOCK} of {len(due) * BLOCK} draws")
    whole = lambda chain, name: np.concatenate([np.array(kept[chain, b][name], float) for b in range(blocks)])[:wanted]
    free, density, accepted = [], [], []
    for chain in range(chains):
        log_density = whole(chain, "log_posterior")
        log_density = np.where(np.isfinite(log_density), log_density, -np.inf)
        places = independence_chain(log_density - whole(chain, "proposed"), stream(drawing.seed, "correct", chain))
        free.append(whole(chain, "free")[places])
        density.append(log_density[places])
        accepted.append(places == np.arange(wanted))
    refused = int(np.sum(~np.stack(accepted)))
    return Chains(np.stack(free), refused, {"lp": np.stack(density), "accepted": np.stack(accepted)})


def independence_chain(log_weights: Float[np.ndarray, " n"], random: np.random.Generator) -> Int[np.ndarray, " n"]:
    """The index of the proposal that an independence chain is at, after each of n proposals.

    The chain begins at one of the first, each as probable as its weight, so that it begins in the posterior.
    """
    first, at, places = log_weights[:BLOCK], 0, np.zeros(log_weights.size, int)
    if np.isfinite(np.max(first)):
        weights = np.exp(first - np.max(first))
        at = int(random.choice(first.size, p=weights / np.sum(weights)))
    chances = np.log(random.random(log_weights.size))
    for number in range(log_weights.size):
        if chances[number] + log_weights[at] <= log_weights[number]:
            at = number
        places[number] = at
    return places


def _judge_block(model: Model, learned: ResidualPolynomial, seed: int, task: tuple[int, int]) -> Document:
    """A block of proposals with the model's density at each, complete, so that the block need not be drawn again."""
    proposed = model.proposals(learned, PROPOSAL_WIDTHS, BLOCK, stream(seed, "propose", *task))
    chi2 = [float(np.sum(np.asarray(model.residuals(free)) ** 2)) for free in proposed.free]
    log_density = model.log_prior(proposed.free) - 0.5 * np.array(chi2) / model.factor
    # JSON has no infinity.
    density = [float(value) if np.isfinite(value) else None for value in log_density]
    draws = {"free": proposed.free.tolist(), "proposed": proposed.log_proposed.tolist()}
    return {"chain": task[0], "block": task[1], **draws, "log_posterior": density}


def task_of(entry: Document, shapes: Mapping[str, tuple[int, ...]]) -> tuple[int, int]:
    """Chain and block of an `entry` of a store, whose numbers have these `shapes` by name.

    **Raises:** `TypeError` or `ValueError` where it is none, or has numbers that are not finite.
    """
    task = entry["chain"], entry["block"]
    if not all(isinstance(number, int) for number in task):
        raise TypeError(f"chain, block = {task!r}")
    for name, shape in shapes.items():
        numbers = np.array(entry[name], float)
        if numbers.shape != shape:
            raise ValueError(f"{name} of block {task[1]} of chain {task[0]} without the shape {shape}")
        # Where the model cannot be simulated there is no density, and it is NaN.
        if not np.isfinite(numbers).all() and (name != "log_posterior" or np.isinf(numbers).any()):
            raise ValueError(f"{name} of block {task[1]} of chain {task[0]} with numbers that are not finite")
    return task
