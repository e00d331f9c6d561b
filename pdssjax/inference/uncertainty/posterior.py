"""Draws from the posterior of a fit, by a polynomial that is learned and corrected by the model.

The density is exp(-chi-square / (2 factor)), with flat priors on the values between the bounds: the zeros of the
sensors are marginalised (they are linear, and the residual leaves their projection out); the noise is taken as known,
that given or found, its variance enlarged by `factor` as those of the standard errors are.

Valleys of chi-square are narrow and bent: a sampler takes hundreds of evaluations from draw to draw, with the model a
day.  So a polynomial stands for the residuals (`residual_polynomial`), learned around its own draws until the model
agrees with it there (`posterior_learning`).  Its draws (`randomize_then_optimize`) are independent, some of them wider
than it says lest they miss what it does not know.  Each is a proposal, which the model accepts with probability
min(1, w' / w), w the model's density over the proposals': draws are the model's whatever the polynomial is, which only
decides how many are accepted (L. Tierney, Annals of Statistics 22(4), 1994, independence chains; J. A. Christen and
C. Fox, J. Computational and Graphical Statistics 14(4), 2005).
"""

import functools
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, Num

from ...core import Document
from ..draws import CHAINS, DRAWS, Drawing, each_done, reading, stream
from ..least_squares import Progress
from .posterior_learning import learn
from .posterior_model import Model
from .randomize_then_optimize import Widths
from .residual_polynomial import ResidualPolynomial

BLOCK = 50
"""Draws between two moments at which they are kept."""

PROPOSALS = "randomized residuals, exponentials at bounds, streams by purpose"
"""Kind of the proposals: weights of another kind do not go with theirs."""

TO_JUDGE = Widths(solved=(1.2,), linear=3.0, share=0.1)
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
    model: Model,
    drawing: Drawing,
    executor: Executor | None,
    report: Progress,
    chains: int = CHAINS,
) -> Chains:
    """Draws of several chains; what the store has kept is not asked of the model again.

    Points and blocks of draws are computed side by side in the threads of the `executor`.

    **Raises:** `InputError` where what was kept is not what a run writes; `NothingToDraw` where hardly any draw lies
    between the bounds.
    """
    wanted = drawing.count or DRAWS
    blocks = -(-wanted // BLOCK)
    with reading(drawing.store, "draws of the chains"):
        kept = {_task_of(entry, model.optimum.at.size): entry for entry in drawing.store.kept()}
    due = [(chain, block) for block in range(blocks) for chain in range(chains) if (chain, block) not in kept]
    if due:
        learned = learn(model, drawing.seed, executor, report)
        work = functools.partial(_judged, model, learned, drawing.seed)
        for done, (task, entry) in enumerate(each_done(work, due, executor), 1):
            drawing.store.keep(entry)
            kept[task] = entry
            report(f"posterior: the model has judged {done * BLOCK} of {len(due) * BLOCK} draws")
    whole = lambda chain, name: np.concatenate([np.array(kept[chain, b][name], float) for b in range(blocks)])[:wanted]
    free, density, accepted = [], [], []
    for chain in range(chains):
        log_density = whole(chain, "log_posterior")
        log_density = np.where(np.isfinite(log_density), log_density, -np.inf)
        places = corrected(log_density - whole(chain, "proposed"), stream(drawing.seed, "correct", chain))
        free.append(whole(chain, "free")[places])
        density.append(log_density[places])
        accepted.append(places == np.arange(wanted))
    refused = int(np.sum(~np.stack(accepted)))
    return Chains(np.stack(free), refused, {"lp": np.stack(density), "accepted": np.stack(accepted)})


def corrected(log_weights: Float[np.ndarray, " n"], random: np.random.Generator) -> Int[np.ndarray, " n"]:
    """The index of the proposal that an independence chain is at, after each of n proposals.

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


def _judged(model: Model, learned: ResidualPolynomial, seed: int, task: tuple[int, int]) -> Document:
    """A block of proposals with the model's density at each, complete, so that the block need not be drawn again."""
    proposed = model.proposals(learned, TO_JUDGE, BLOCK, stream(seed, "propose", *task))
    chi2 = [float(np.sum(np.asarray(model.residuals(free)) ** 2)) for free in proposed.free]
    log_density = model.log_prior(proposed.free) - 0.5 * np.array(chi2) / model.factor
    # JSON has no infinity.
    density = [float(value) if np.isfinite(value) else None for value in log_density]
    draws = {"free": proposed.free.tolist(), "proposed": proposed.log_proposed.tolist()}
    return {"chain": task[0], "block": task[1], **draws, "log_posterior": density}


def _task_of(entry: Document, size: int) -> tuple[int, int]:
    """Chain and block of an `entry`."""
    task = entry["chain"], entry["block"]
    if not all(isinstance(number, int) for number in task):
        raise TypeError(f"chain, block = {task!r}")
    for name, shape in (("free", (BLOCK, size)), ("proposed", (BLOCK,)), ("log_posterior", (BLOCK,))):
        numbers = np.array(entry[name], float)
        if numbers.shape != shape:
            raise ValueError(f"{name} of block {task[1]} of chain {task[0]} without {BLOCK} draws of {size} parameters")
        # Where the model cannot be simulated there is no density, and it is NaN.
        if not np.isfinite(numbers).all() and (name != "log_posterior" or np.isinf(numbers).any()):
            raise ValueError(f"{name} of block {task[1]} of chain {task[0]} with numbers that are not finite")
    return task
