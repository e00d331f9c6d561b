"""Draws from the posterior of a fit, by a polynomial that is learned and corrected by the model.

The density is exp(-chi-square / (2 factor)) on the scale of the fit, flat priors between the bounds: the zeros of the
sensors are marginalised (they are linear, and the residual leaves their projection out); the noise is taken as known,
that given or found, its variance enlarged by `factor` as those of the standard errors are.

Valleys of chi-square are narrow and bent: a sampler takes hundreds of evaluations from draw to draw, with the model a
day.  So a polynomial stands for the residuals (`residual_polynomial`), learned where its own draws lie, round after
round, until the model agrees with it there.  Its draws (`randomize_then_optimize`) are independent, some of them wider
than it says lest they miss what it does not know.  Each is a proposal, which the model accepts with probability
min(1, w' / w), w the model's density over the proposals': draws are the model's whatever the polynomial is, which only
decides how many are accepted (L. Tierney, Annals of Statistics 22(4), 1994, independence chains; J. A. Christen and
C. Fox, J. Computational and Graphical Statistics 14(4), 2005).
"""

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int, Num

from ...core import Document, InputError
from ..draws import CHAINS, DRAWS, Drawing, each_done, reading
from ..least_squares import Progress
from .profile_likelihood import Evaluate, linearise_all
from .quadratic_end import factors
from .randomize_then_optimize import Mixture, Proposals, Widths, propose
from .residual_polynomial import (
    ResidualPolynomial,
    count_terms,
    degree_for,
    learned_polynomial,
)
from .second_order import Linearisation

BLOCK = 50
"""Draws between two moments at which they are kept."""

_ROUNDS = 6
"""Of learning, at most."""

_SURPLUS = 2.5
"""Numbers that the points of a round tell, for each coefficient."""

_FEWEST = 24
"""Points of a round."""

_AGREEMENT = 0.85
"""What model and polynomial have in common, from which the polynomial is good; with `_FEWEST` points 1 is seldom."""

_TO_LEARN = Widths(solved=(1.2, 3.0), linear=1.0, share=0.0, elsewhere=0.5)
"""Draws at which the model is asked while the polynomial is learned."""

TO_JUDGE = Widths(solved=(1.2,), linear=3.0, share=0.1, elsewhere=0.2)
"""Proposals."""

_TO_SPREAD, _SPREAD = Widths(solved=(1.2,), linear=1.0, share=0.0, elsewhere=0.5), 400
"""Draws, and how many, that tell where the ends of the posterior are."""

_FOLDED = 0.01
"""Share of draws from the optimum that have no solution, from which the residuals fold over where it counts."""

_ENDS = (0.03, 0.97)
"""Quantiles of the direction in which it is the longest, from where it is drawn, too."""

_LEARNING = CHAINS
"""Where the draws of the rounds of learning have the number of a chain in their seed."""

Residuals = Callable[[Float[np.ndarray, " p"]], Float[Array | np.ndarray, " n"]]
"""Whitened residuals at a point; not finite where it cannot be simulated."""


class Chains(NamedTuple):
    """Draws of several chains."""

    free: Float[np.ndarray, "chains draws p"]
    """On the scale of the fit."""
    failed: int
    """Draws that are no new ones, or trajectories that were broken off."""
    statistics: dict[str, Num[np.ndarray, "chains draws"]]
    """Of each draw, by ArviZ's names: "lp", the logarithm of the model's density but for a constant, and what else the
    sampler knows."""


class Model(NamedTuple):
    """What is drawn from."""

    evaluate: Evaluate
    """Residuals and Jacobian."""
    residuals: Residuals
    optimum: Linearisation
    axes: Float[np.ndarray, "p q"]
    """Along which parameters move."""
    bounds: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]
    factor: float
    """By which variances exceed those of the noise given."""

    def mixture(self, learned: "Learned", widths: Widths) -> Mixture:
        """What draws of what was `learned` are from, with variances enlarged by the `widths`."""
        return Mixture(learned.polynomial, self.axes, self.factor, widths, learned.origins)

    def proposals(self, learned: "Learned", widths: Widths, count: int, seed: tuple[int, ...]) -> Proposals:
        """Draws of that mixture."""
        return propose(self.mixture(learned, widths), self.bounds, count, seed)

    def along_axes(self, free: Float[np.ndarray, "*n p"]) -> Float[np.ndarray, "*n q"]:
        """Where numbers on the scale of the fit lie along the axes, from the optimum."""
        return (free - self.optimum.at) @ np.linalg.pinv(self.axes).T


class Learned(NamedTuple):
    """What stands for the model."""

    polynomial: ResidualPolynomial
    origins: Float[np.ndarray, "k q"]
    """Along the axes: the optimum, and a point near either end of the posterior, from which it is drawn beyond
    folds."""


def principal_axes(optimum: Linearisation, moving: Int[np.ndarray, " q"], factor: float) -> Float[np.ndarray, "p q"]:
    """A with A A' the covariance of the linear model at an `optimum`, of the parameters at the places `moving`."""
    _, singular, rows, norms = factors(optimum.jacobian[:, moving])
    axes = np.zeros((optimum.at.size, moving.size))
    axes[moving] = np.sqrt(factor) * (rows / singular[:, None]).T / norms[:, None]
    return axes


def sample_posterior(
    model: Model,
    first: ResidualPolynomial,
    drawing: Drawing,
    executor: Executor | None,
    report: Progress,
    chains: int = CHAINS,
) -> Chains:
    """Draws of several chains; what the store has kept is not asked of the model again.

    Points and blocks of draws are computed side by side in the threads of the `executor`.

    **Arguments:** the polynomial `first` in use.

    **Raises:** `InputError` where the model cannot be simulated at its optimum, or hardly any draw of the polynomial
    lies between the bounds.
    """
    if not np.isfinite(model.optimum.chi2):
        raise InputError("posterior: found a model that cannot be simulated at its optimum; expected a finished fit.")
    wanted = drawing.count or DRAWS
    blocks = -(-wanted // BLOCK)
    with reading(drawing.store, "draws of the chains"):
        kept = {_task_of(entry, model.optimum.at.size): entry for entry in drawing.store.kept()}
    due = [(chain, block) for block in range(blocks) for chain in range(chains) if (chain, block) not in kept]
    if due:
        learned = learn(model, first, drawing.seed, executor, report)
        work = functools.partial(_judged, model, learned, drawing.seed)
        for done, (task, entry) in enumerate(each_done(work, due, executor), 1):
            drawing.store.keep(entry)
            kept[task] = entry
            report(f"posterior: the model has judged {done * BLOCK} of {len(due) * BLOCK} draws")
    each = [[kept[chain, block] for block in range(blocks)] for chain in range(chains)]
    return _joined([_corrected(each[chain], wanted, drawing.seed, chain) for chain in range(chains)])


class _Corrected(NamedTuple):
    """Draws of a chain, or of several."""

    free: Float[np.ndarray, "*chains draws p"]
    log_density: Float[np.ndarray, "*chains draws"]
    """Of the model, but for a constant."""
    accepted: Bool[np.ndarray, "*chains draws"]
    """The model took the polynomial's draw; else the draw is the one before."""


def learn(
    model: Model, polynomial: ResidualPolynomial, seed: int, executor: Executor | None, report: Progress
) -> Learned:
    """A polynomial that agrees with the model over the posterior, as far as one does, and where to draw it from."""
    moving = model.axes.shape[1]
    learned = Learned(polynomial, np.zeros((1 + len(_ENDS), moving)))
    count = max(_FEWEST, int(_SURPLUS * count_terms(moving, degree_for(moving)) / (1 + moving)))
    points: list[Linearisation] = []
    for number in range(_ROUNDS):
        report(f"posterior: learning the residuals, round {number + 1}")
        proposed = model.proposals(learned, _TO_LEARN, count, (seed, _LEARNING + number))
        there = linearise_all(model.evaluate, list(proposed.free), executor)
        exact = np.array([-0.5 * point.chi2 / model.factor for point in there])
        agreement = in_common(exact - proposed.log_proposed, proposed.log_learned - proposed.log_proposed)
        points += there
        polynomial = learned_polynomial(model.optimum, points, model.axes, model.factor).turned()
        learned = learned._replace(polynomial=polynomial)
        # The first round has drawn from the optimum alone, and does not know what lies beyond folds.
        if number and agreement > _AGREEMENT:
            break
        learned = learned._replace(origins=_origins(model, learned, (seed, _LEARNING + number)))
    return learned


def _origins(model: Model, learned: Learned, seed: tuple[int, ...]) -> Float[np.ndarray, "k q"]:
    """The optimum, and draws of the polynomial near either end of the direction in which it is the longest.

    The optimum alone where nothing folds.
    """
    from_optimum = model.proposals(learned, _TO_SPREAD._replace(elsewhere=0.0), _SPREAD, (*seed, 0))
    if from_optimum.unsolved < _FOLDED:
        return np.zeros_like(learned.origins)
    drawn = model.proposals(learned, _TO_SPREAD, _SPREAD, (*seed, 1))
    w = model.along_axes(drawn.free)
    weights = np.exp(drawn.log_learned - drawn.log_proposed - np.max(drawn.log_learned - drawn.log_proposed))
    weights /= np.sum(weights)
    apart = w - weights @ w
    along = apart @ np.linalg.eigh((apart * weights[:, None]).T @ apart)[1][:, -1]
    order = np.argsort(along)
    ends = np.searchsorted(np.cumsum(weights[order]), _ENDS).clip(max=_SPREAD - 1)
    return np.concatenate([np.zeros((1, w.shape[1])), w[order[ends]]])


def in_common(first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"]) -> float:
    """What two densities have in common, 1 where they are equal: from logarithms of their weights at the same draws."""
    weights = []
    for logs in (first, second):
        finite = np.isfinite(logs)
        if not finite.any():
            return 0.0
        weight = np.exp(np.where(finite, logs, -np.inf) - np.max(logs[finite]))
        weights.append(weight / np.sum(weight))
    return float(np.sum(np.minimum(*weights)))


def corrected(log_weights: Float[np.ndarray, " n"], random: np.random.Generator) -> Int[np.ndarray, " n"]:
    """Which of n proposals an independence chain is at, after each of them.

    It begins at one of the first, each as probable as its weight, lest it has to find the posterior.
    """
    at, places = _begin(log_weights[:BLOCK], random), np.zeros(log_weights.size, int)
    chances = np.log(random.random(log_weights.size))
    for number in range(log_weights.size):
        if chances[number] + log_weights[at] <= log_weights[number]:
            at = number
        places[number] = at
    return places


def _begin(log_weights: Float[np.ndarray, " n"], random: np.random.Generator) -> int:
    highest = np.max(log_weights)
    if not np.isfinite(highest):
        return 0
    weights = np.exp(log_weights - highest)
    return int(random.choice(log_weights.size, p=weights / np.sum(weights)))


def _judged(model: Model, learned: Learned, seed: int, task: tuple[int, int]) -> Document:
    """A block of proposals and what the model says of it; all of it, so that the block need not be drawn again."""
    proposed = model.proposals(learned, TO_JUDGE, BLOCK, (seed, *task))
    chi2 = [float(np.sum(np.asarray(model.residuals(free)) ** 2)) for free in proposed.free]
    # JSON has no infinity.
    density = [-0.5 * value / model.factor if np.isfinite(value) else None for value in chi2]
    told = {"free": proposed.free.tolist(), "proposed": proposed.log_proposed.tolist()}
    return {"chain": task[0], "block": task[1], **told, "log_density": density}


def _task_of(entry: Document, size: int) -> tuple[int, int]:
    """Which block of which chain an `entry` is."""
    task = entry["chain"], entry["block"]
    if not all(isinstance(number, int) for number in task):
        raise TypeError(f"chain, block = {task!r}")
    for name, shape in (("free", (BLOCK, size)), ("proposed", (BLOCK,)), ("log_density", (BLOCK,))):
        if np.shape(np.array(entry[name], float)) != shape:
            raise ValueError(f"{name} of block {task[1]} of chain {task[0]} without {BLOCK} draws of {size} parameters")
    return task


def _corrected(blocks: Sequence[Document], wanted: int, seed: int, chain: int) -> _Corrected:
    """One chain of the model's draws, without its axis."""
    whole = lambda name: np.concatenate([np.array(block[name], float) for block in blocks])[:wanted]
    density = whole("log_density")
    density = np.where(np.isfinite(density), density, -np.inf)
    places = corrected(density - whole("proposed"), np.random.default_rng([seed, chain]))
    return _Corrected(
        free=whole("free")[places],
        log_density=density[places],
        accepted=places == np.arange(wanted),
    )


def _joined(chains: Sequence[_Corrected]) -> Chains:
    free, density, accepted = (np.stack(parts) for parts in zip(*chains, strict=True))
    return Chains(free, int(np.sum(~accepted)), {"lp": density, "accepted": accepted})
