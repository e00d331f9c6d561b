"""Draws from the posterior of a fit, by a polynomial that is learned and corrected by the model.

The density is exp(-chi-square / (2 factor)) on the scale of the fit, flat priors between the bounds: the zeros of the
sensors are marginalised (they are linear, and the residual leaves their projection out); the noise is taken as known,
that given or found, its variance enlarged by `factor` as those of the standard errors are.

Valleys of chi-square are narrow and bent: the No-U-Turn sampler takes hundreds of evaluations from draw to draw, with
the model a day.  So a polynomial stands for the residuals (`residual_polynomial`), learned where its own draws lie,
round after round, until the model agrees with it there.  Its draws, a little wider than it says lest they miss what
it does not know, are then proposals, each of which the model accepts with probability min(1, w' / w), w the model's
density over the proposals': draws are the model's whatever the polynomial is, which only decides how many are accepted
(L. Tierney, Annals of Statistics 22(4), 1994, independence chains; J. A. Christen and C. Fox, J. Computational and
Graphical Statistics 14(4), 2005).
"""

import functools
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...core import Document, InputError
from ..draws import CHAINS, DRAWS, Drawing, each_done
from ..least_squares import Progress
from .no_u_turn import Density, Trace, draw
from .preconditioner import Preconditioner
from .profile_likelihood import Evaluate, linearise
from .residual_polynomial import (
    ResidualPolynomial,
    count_terms,
    degree_for,
    learned_polynomial,
)
from .second_order import Point

BLOCK = 50
"""Draws between two moments at which they are kept."""

THINNING = 3
"""Draws of the polynomial for each that the model is asked about: they cost less."""

_ROUNDS = 6
"""Of learning, at most."""

_LEARNING = 300
"""Draws of the polynomial in a round."""

_SURPLUS = 2.5
"""Numbers that the points of a round tell, for each coefficient."""

_FEWEST = 24
"""Points of a round."""

_AGREEMENT = 0.85
"""What model and polynomial have in common, from which the polynomial is good; with `_FEWEST` points 1 is seldom."""

_LEARNING_WIDTH, _WIDTH = 2.0, 1.3
"""By how much variances of draws exceed the polynomial's, while it is learned and of proposals."""

Residuals = Callable[[Float[np.ndarray, " p"]], Float[Array | np.ndarray, " n"]]
"""Whitened residuals at a point; not finite where it cannot be simulated."""


class Chains(NamedTuple):
    """Draws after the warm-up."""

    free: Float[np.ndarray, "chains draws p"]
    """On the scale of the fit."""
    diverging: Bool[np.ndarray, "chains draws"]
    """The trajectory of the polynomial's draw diverged."""
    energy: Float[np.ndarray, "chains draws"]
    steps: Int[np.ndarray, "chains draws"]
    """Evaluations of the polynomial on each draw's trajectory."""
    acceptance: Float[np.ndarray, "chains draws"]
    """With which the polynomial's sampler went on."""
    accepted: Bool[np.ndarray, "chains draws"]
    """The model took the polynomial's draw; else the draw is the one before."""


class Model(NamedTuple):
    """What is drawn from."""

    evaluate: Evaluate
    """Residuals and Jacobian."""
    residuals: Residuals
    optimum: Point
    preconditioner: Preconditioner
    factor: float


def sample_posterior(
    model: Model,
    first: ResidualPolynomial,
    drawing: Drawing,
    executor: Executor | None,
    report: Progress,
    chains: int = CHAINS,
) -> Chains:
    """Draws of several chains; what the store has kept is not asked of the model again.

    Chains, and points, are computed side by side in the threads of the `executor`.

    **Arguments:** the polynomial `first` in use.

    **Raises:** `InputError` where the model cannot be simulated at its optimum.
    """
    if not np.isfinite(model.optimum.chi2):
        raise InputError("posterior: found a model that cannot be simulated at its optimum; expected a finished fit.")
    wanted = drawing.count or DRAWS
    blocks = -(-wanted // BLOCK)
    kept = {(entry["chain"], entry["block"]): entry for entry in drawing.store.kept()}
    due = [(chain, block) for block in range(blocks) for chain in range(chains) if (chain, block) not in kept]
    if due:
        polynomial = learn(model, first, drawing.seed, executor, report)
        density = Density(polynomial, model.preconditioner.sheared(polynomial), np.array(_WIDTH * model.factor))
        report("posterior: draws of the polynomial")
        work = lambda chain: draw(density, blocks * BLOCK, (drawing.seed, chain), THINNING)
        traces = dict(each_done(work, sorted({chain for chain, _ in due}), executor))
        for done, (task, entry) in enumerate(each_done(functools.partial(_asked, model, traces), due, executor), 1):
            drawing.store.keep(entry)
            kept[task] = entry
            report(f"posterior: the model has judged {done * BLOCK} of {len(due) * BLOCK} draws")
    return _joined([_corrected(kept, chain, blocks, wanted, drawing.seed, model) for chain in range(chains)])


def learn(
    model: Model, polynomial: ResidualPolynomial, seed: int, executor: Executor | None, report: Progress
) -> ResidualPolynomial:
    """A polynomial that agrees with the model over the posterior, as far as one does."""
    axes = model.preconditioner.axes
    moving = axes.shape[1]
    count = max(_FEWEST, int(_SURPLUS * count_terms(moving, degree_for(moving)) / (1 + moving)))
    points: list[Point] = []
    for number in range(_ROUNDS):
        report(f"posterior: learning the residuals, round {number + 1}")
        wide = _LEARNING_WIDTH * model.factor
        density = Density(polynomial, model.preconditioner.sheared(polynomial), np.array(wide))
        trace = draw(density, _LEARNING, (seed, CHAINS + number))
        chosen = np.linspace(0, _LEARNING - 1, count).round().astype(int)
        places, potential = trace.free[chosen], trace.potential[chosen]
        found = dict(each_done(functools.partial(_linearised, model, places), range(count), executor))
        there = [found[i] for i in range(count)]
        exact = np.array([0.5 * point.chi2 / wide for point in there])
        agreement = in_common(_LEARNING_WIDTH * exact - potential, (_LEARNING_WIDTH - 1.0) * potential)
        points += there
        polynomial = learned_polynomial(model.optimum, points, axes, model.factor)
        if agreement > _AGREEMENT:
            break
    return polynomial


def _linearised(model: Model, places: Float[np.ndarray, "n p"], number: int) -> Point:
    return linearise(model.evaluate, places[number])


def in_common(first: Float[np.ndarray, " n"], second: Float[np.ndarray, " n"]) -> float:
    """What two densities have in common, 1 where they are equal: potentials against that of the draws, at n draws."""
    weights = []
    for potential in (first, second):
        finite = np.isfinite(potential)
        if not finite.any():
            return 0.0
        weight = np.exp(np.min(potential[finite]) - np.where(finite, potential, np.inf))
        weights.append(weight / np.sum(weight))
    return float(np.sum(np.minimum(*weights)))


def corrected(log_weights: Float[np.ndarray, " n"], random: np.random.Generator) -> Int[np.ndarray, " n"]:
    """Which of n proposals an independence chain is at, after each of them."""
    chances = np.log(random.random(log_weights.size))
    at, places = 0, np.zeros(log_weights.size, int)
    for number in range(log_weights.size):
        if chances[number] + log_weights[at] <= log_weights[number]:
            at = number
        places[number] = at
    return places


def _asked(model: Model, traces: dict[int, Trace], task: tuple[int, int]) -> Document:
    """What the model says of a block of proposals; all of it, so that the block need not be drawn again."""
    chain, block = task
    part = Trace(*(values[block * BLOCK : (block + 1) * BLOCK] for values in traces[chain]))
    chi2 = [float(np.sum(np.asarray(model.residuals(free)) ** 2)) for free in part.free]
    # JSON has no infinity.
    exact = [0.5 * value / model.factor if np.isfinite(value) else None for value in chi2]
    told = {name: np.asarray(values).tolist() for name, values in part._asdict().items()}
    return {"chain": chain, "block": block, **told, "exact": exact}


def _corrected(
    kept: dict[tuple[int, int], Document], chain: int, blocks: int, wanted: int, seed: int, model: Model
) -> Chains:
    """One chain of the model's draws, without its axis."""
    whole = lambda name: np.concatenate([np.array(kept[chain, block][name], float) for block in range(blocks)])
    told = {name: whole(name)[:wanted] for name in (*Trace._fields, "exact")}
    exact = np.where(np.isfinite(told["exact"]), told["exact"], np.inf)
    places = corrected(told["potential"] - exact, np.random.default_rng([seed, chain]))
    return Chains(
        free=told["free"][places],
        diverging=told["diverging"][places] > 0,
        energy=told["energy"][places],
        steps=told["steps"].astype(int),
        acceptance=told["acceptance"],
        accepted=places == np.arange(wanted),
    )


def _joined(chains: Sequence[Chains]) -> Chains:
    return Chains(*(np.stack(parts) for parts in zip(*chains, strict=True)))
