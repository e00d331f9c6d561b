"""The best selection of candidates within a budget: greedy construction, then Fedorov's exchange.

One candidate of the plan at a time is exchanged for the one of all that improves the criterion most, until no exchange
does (V. V. Fedorov, Theory of Optimal Experiments, Academic Press 1972).  With the candidates' informations in memory
all exchanges of one place are judged at once.  Candidates differ in what they take of the budget: pairs are exchanged
as well, so that one record can give samples to another.

While a plan is still too small to determine everything, plans are compared with a faint information added
(`_FAINT`).  It serves the search alone: what a finished plan promises is computed without it, and what no candidate
sees has been refused before.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from .criteria import AbstractCriterion

_FAINT = 1e-6
"""Information on every unknown [1], on a relative scale: an error of a factor of e^1000."""

_AT_ONCE = 20_000_000
"""Elements of information matrices that are judged together."""

_SMALLER = 0.75
"""Part of a record's samples up to which another one counts as smaller."""


class Candidates(NamedTuple):
    """The candidates of a plan; each may be chosen several times."""

    information: Float[np.ndarray, "candidates draws q q"]
    resources: Float[np.ndarray, "candidates resources"]
    """How much of each resource each candidate takes: samples, records, seconds, cost."""


class Search(NamedTuple):
    """Criterion, budget and prior information of a search."""

    criterion: AbstractCriterion
    prior: Float[np.ndarray, "draws q q"]
    """Information known before."""
    budget: Float[np.ndarray, " resources"]

    @property
    def base(self) -> Float[np.ndarray, "draws q q"]:
        """Information that the search adds candidates to."""
        return self.prior + _FAINT * np.eye(self.prior.shape[-1])

    def scores(
        self, known: Float[np.ndarray, "draws q q"], information: Float[np.ndarray, "candidates draws q q"]
    ) -> Float[np.ndarray, " candidates"]:
        """The criterion with each of the candidates added to what is `known`; infinite where it has no number."""
        size = max(1, _AT_ONCE // max(1, known.size))
        parts = [information[i : i + size] for i in range(0, len(information), size)]
        found = np.concatenate([self.criterion(known + part) for part in parts]) if parts else np.zeros(0)
        return np.where(np.isfinite(found), found, np.inf)


def best_selection(candidates: Candidates, search: Search, rounds: int = 12, starts: int = 6) -> list[int]:
    """The places of the candidates of the best plan found, in ascending order; some perhaps several times.

    **Arguments:** exchange begins with the greedy plan, and with plans whose first candidate is another one, in all
    with so many `starts`; it ends after so many `rounds` at the latest.
    """
    others = np.random.default_rng(0).permutation(np.flatnonzero(_affordable(candidates, search, [])))[: starts - 1]
    found = []
    for begun in ([], *([int(first)] for first in others)):
        plan = _greedy(candidates, search, begun)
        least = float(search.criterion(_known(candidates, search, plan)))
        for _ in range(rounds):
            before = least
            plan, least = _exchange_singles(candidates, search, plan, least)
            plan, least = _exchange_pairs(candidates, search, plan, least)
            if least >= before - 1e-9 * max(1.0, abs(before)):
                break
        found.append((plan, least))
    return sorted(min(found, key=lambda pair: pair[1])[0])


def _known(candidates: Candidates, search: Search, plan: Sequence[int]) -> Float[np.ndarray, "draws q q"]:
    return search.base + candidates.information[list(plan)].sum(axis=0)


def _affordable(candidates: Candidates, search: Search, plan: Sequence[int]) -> Bool[np.ndarray, " candidates"]:
    """Which candidates the budget leaves room for beside those of a `plan`."""
    left = search.budget - candidates.resources[list(plan)].sum(axis=0)
    return np.all(candidates.resources <= left * (1 + 1e-9) + 1e-12, axis=1)


def _best_of(
    candidates: Candidates, search: Search, plan: Sequence[int], places: Int[np.ndarray, " places"]
) -> tuple[int, float] | None:
    """The candidate at one of the `places` that is best added to a `plan`, and the criterion with it; None of none."""
    if not places.size:
        return None
    scores = search.scores(_known(candidates, search, plan), candidates.information[places])
    best = int(np.argmin(scores))
    return int(places[best]), float(scores[best])


def _best_addition(candidates: Candidates, search: Search, plan: Sequence[int]) -> tuple[int, float] | None:
    """The best candidate of those that the budget has room for beside a `plan`, as `_best_of`."""
    return _best_of(candidates, search, plan, np.flatnonzero(_affordable(candidates, search, plan)))


def _greedy(candidates: Candidates, search: Search, plan: list[int]) -> list[int]:
    """The `plan` with more candidates; each takes an even share of what is left of the budget, where one does."""
    plan, records = list(plan), int(search.budget[1])
    while len(plan) < records:
        left = search.budget - candidates.resources[plan].sum(axis=0)
        even = left / (records - len(plan))
        open_ = _affordable(candidates, search, plan)
        modest = open_ & np.all(candidates.resources <= np.where(np.isfinite(even), even, np.inf) * (1 + 1e-9), axis=1)
        best = _best_of(candidates, search, plan, np.flatnonzero(modest if modest.any() else open_))
        if best is None:
            break
        plan.append(best[0])
    return plan


def _exchange_singles(candidates: Candidates, search: Search, plan: list[int], least: float) -> tuple[list[int], float]:
    """The plan after each of its places was given to the best candidate, and one more added where there is room."""
    for place in range(len(plan)):
        others = plan[:place] + plan[place + 1 :]
        better = _best_addition(candidates, search, others)
        if better is not None and better[1] < least - 1e-12:
            plan, least = [*plan[:place], better[0], *plan[place + 1 :]], better[1]
    more = _best_addition(candidates, search, plan)
    while more is not None and more[1] < least - 1e-12:
        plan, least = [*plan, more[0]], more[1]
        more = _best_addition(candidates, search, plan)
    return plan, least


def _exchange_pairs(candidates: Candidates, search: Search, plan: list[int], least: float) -> tuple[list[int], float]:
    """The plan after two of its candidates at a time made room for two others.

    The first of these is the best with at most `_SMALLER` of the samples of the one that it replaces, or else the best
    of all; the second is the best beside it.
    """
    sizes = candidates.resources[:, 0]

    def replacement(first: int, second: int) -> tuple[list[int], float] | None:
        """A better plan without the candidates at these places; None where none was found."""
        others = [candidate for place, candidate in enumerate(plan) if place not in (first, second)]
        smaller = np.flatnonzero(sizes <= _SMALLER * sizes[plan[first]])
        for one in (_best_of(candidates, search, others, smaller), _best_addition(candidates, search, others)):
            other = None if one is None else _best_addition(candidates, search, [*others, one[0]])
            if one is not None and other is not None and other[1] < least - 1e-12:
                return [*others, one[0], other[0]], other[1]
        return None

    # A replacement moves the places of those that stay: each pair of places is tried once nevertheless.
    for first, second in itertools.permutations(range(len(plan)), 2):
        plan, least = replacement(first, second) or (plan, least)
    return plan, least


def promising(candidates: Candidates, search: Search, count: int) -> list[int]:
    """The places of the `count` candidates that a good plan is most likely to be made of.

    They are ranked by what each is worth beside a first plan, within its class of samples, so that all sizes remain.
    """
    plan = best_selection(candidates, search, rounds=2, starts=1)
    known = _known(candidates, search, plan)
    scores = search.scores(known, candidates.information)
    sizes = candidates.resources[:, 0]
    classes = np.unique(sizes)
    each = max(1, count // classes.size)
    kept = set(plan)
    for size in classes:
        members = np.flatnonzero(sizes == size)
        kept |= set(members[np.argsort(scores[members])[:each]].tolist())
    return sorted(kept)
