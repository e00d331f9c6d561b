"""Predictions of samples that a fitted model did not see: blocks of time, whole records, records to validate with.

At an optimum with whitened residuals r and Jacobian J the parameters without the samples of a part are, to first order,

    free + d,    (J'J - J_part' J_part) d = J_part' r_part

which costs a solve in place of a fit; the zero of a record that is free is one more column.  The part is then
simulated at these parameters, not linearised.  The step is believed where the samples that were left explain no less
after it than before; else the model is fitted again without the part.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..inference import Problem, evaluated, fit_phase, pose_problem, pseudo_inverse, quiet, zero_columns
from ..study import Record, Study, cycles_a_second
from .comparison import FittedCandidate

BLOCKS = 6
"""Parts of a record that are held out in turn, at most."""

FEWEST_CYCLES = 3
"""Cycles from which on they are the blocks."""

SLICES = 5
"""Slices of each part of a record that does not repeat: the part is spread over the record, so that what is left tells
the parameters, and each slice is long beside what the samples next to it tell of its noise."""

MAX_CHI2_RISE = 0.5
"""Chi-square by which the samples that were left may fare worse after a step that is believed: a fit without the part
would lower theirs, by what a parameter gains by chance or more."""

MIN_INFORMATION_SHARE = 1e-4
"""Share of the information on a direction that has to be left without a part; with less of it the direction stays
where all samples have it."""


class Part(NamedTuple):
    """Samples of one record that are held out together."""

    record: int
    """Place of the record in the study."""
    rows: Bool[np.ndarray, " samples"]
    """Which samples of the record are held out."""
    kind: str
    """"time": a block of a record; "record": all of one; "validation": all of one that no fit sees."""


def parts_of(study: Study) -> tuple[Part, ...]:
    """The parts held out in turn, the same for every model: they depend on drives and sample times alone."""
    parts = []
    for place, record in enumerate(study.records):
        whole = np.ones(record.time.size, bool)
        if record.role != "fit":
            parts.append(Part(place, whole, "validation"))
            continue
        parts += [Part(place, rows, "time") for rows in _blocks(record)]
        others = [r for k, r in enumerate(study.records) if k != place and r.role == "fit"]
        if any(r.measures == record.measures for r in others):
            parts.append(Part(place, whole, "record"))
    return tuple(parts)


def _blocks(record: Record) -> list[Bool[np.ndarray, " samples"]]:
    """Blocks of time of a record: its cycles, some together, or slices that are spread over it."""
    frequency, time = cycles_a_second(record), record.time
    most = min(BLOCKS, time.size // 20)
    if most < 2:
        return []
    if frequency is not None and np.ptp(time) * frequency >= FEWEST_CYCLES - 0.5:
        cycle = np.floor(time * frequency + 1e-9).astype(int)
        # A rest of a cycle at either end goes with its neighbour.
        first, last = (int(np.round(end * frequency)) for end in (time[0], time[-1]))
        cycle = np.clip(cycle, first, last - 1)
        cycle -= cycle.min()
        count = int(cycle.max()) + 1
        groups = cycle * min(most, count) // count
    else:
        groups = np.arange(time.size) * (most * SLICES) // time.size % most
    return [groups == group for group in np.unique(groups)]


def held_out(
    study: Study, fitted: FittedCandidate, parts: Sequence[Part]
) -> tuple[tuple[Float[np.ndarray, " samples"], ...], int]:
    """Predict each of the `parts` by the model of a `study`, `fitted` to it, without having seen the part.

    The zero of a record that is free is found from its samples that are not held out; of a whole record, which has
    none, it is the one that leaves the least.

    **Returns:** measured less predicted of the samples of each part, in the record's unit, NaN where the simulation
    failed, or the samples that were left do not tell the parameters; and for how many parts the model was fitted again.
    """
    problem, _ = pose_problem(study.with_starts(fitted.optimum))
    problem = problem._replace(noise=np.array([fitted.noise[record.name] for record in problem.records]))
    free = np.clip(problem.encode(fitted.optimum), *problem.bounds)
    state = evaluated(problem, free, quiet).state
    jacobian = np.asarray(state.jacobian)
    # A range that follows from where a fit starts is another one here: the fit knows what it ended at.
    ended = np.array([path in fitted.at_bound for path in problem.residual.transform.paths])
    moved = ~(ended | problem.residual.transform.at_bound(free)) & (np.linalg.norm(jacobian, axis=0) > 0.0)
    basis, spread = pseudo_inverse(np.hstack([jacobian[:, moved], zero_columns(problem, len(jacobian))]))
    used = [place for place, record in enumerate(study.records) if record.role == "fit"]
    places = dict(zip(used, range(len(used)), strict=True))
    optimum = _Optimum(study, problem, free, np.asarray(state.residual), basis, spread, moved, places)
    out, refitted = [], 0
    for part in parts:
        free, again = (optimum.free, False) if part.kind == "validation" else optimum.without(part)
        refitted += again
        out.append(optimum.residual(part, free))
    return tuple(out), refitted


def _zero(record: Record, rest: Float[np.ndarray, " samples"]) -> float:
    return float(np.mean(rest)) if record.offset is None else record.offset


class _Optimum(NamedTuple):
    """The optimum of a model of p parameters and n samples."""

    study: Study
    problem: Problem
    free: Float[np.ndarray, " p"]
    residual_at: Float[np.ndarray, " n"]
    basis: Float[np.ndarray, "n k"]
    """Orthonormal; spans what parameters that are not at a bound, and free zeros, do to the residuals."""
    spread: Float[np.ndarray, "q k"]
    """The step of these parameters and zeros that changes the residuals by a column of `basis`."""
    moved: Bool[np.ndarray, " p"]
    """Which parameters are not at a bound and have any effect."""
    places: dict[int, int]
    """Where a record of the study stands among those fitted."""

    def motions(self, free: Float[np.ndarray, " p"]) -> list[Float[np.ndarray, " samples"]]:
        """The prediction of every record of the study, without its zero."""
        values = {path: float(number) for path, number in self.problem.decode(free).items()}
        return [np.asarray(motion) for motion in self.study.predict(values)]

    def without(self, part: Part) -> tuple[Float[np.ndarray, " p"], bool]:
        """The parameters that the samples outside a `part` give, and whether it took another fit; NaN for none."""
        left = np.ones(self.residual_at.size, bool)
        left[self.problem.rows[self.places[part.record]]] = ~part.rows
        basis, residual = self.basis * left[:, None], self.residual_at * left
        # Of what all samples tell of each direction, the share that is left without the part.
        share, axes = np.linalg.eigh(basis.T @ basis)
        known = share > MIN_INFORMATION_SHARE
        step = self.spread @ (axes[:, known] @ ((axes[:, known].T @ -(basis.T @ residual)) / share[known]))
        free = self.free.copy()
        free[self.moved] += step[: int(np.sum(self.moved))]
        free = np.clip(free, *self.problem.bounds)
        if self._chi2(free, part) <= self._chi2(self.free, part) + MAX_CHI2_RISE:
            return free, False
        used = [np.ones(record.time.size, bool) for record in self.problem.records]
        used[self.places[part.record]] = ~part.rows
        every = np.ones(len(used), bool)
        fit = fit_phase(self.problem.fitted_to(used), self.free, every, self.moved, "all", quiet, 20)
        return np.asarray(fit.free), True

    def _chi2(self, free: Float[np.ndarray, " p"], part: Part) -> float:
        """Chi-square of the samples outside a `part`; infinite where the simulation fails."""
        motions, total = self.motions(free), 0.0
        for place, number in self.places.items():
            record = self.study.records[place]
            rest = record.measured - motions[place]
            if place == part.record:
                rest = rest[~part.rows]
            if rest.size:
                rest = rest - _zero(record, rest)
                total += float(np.sum(rest**2)) / float(self.problem.noise[number]) ** 2
        return total if np.isfinite(total) else np.inf

    def residual(self, part: Part, free: Float[np.ndarray, " p"]) -> Float[np.ndarray, " held"]:
        """Measured less predicted of a `part` with the parameters `free`."""
        record = self.study.records[part.record]
        rest = record.measured - self.motions(free)[part.record]
        outside = ~part.rows if (~part.rows).any() else part.rows
        return (rest - _zero(record, rest[outside]))[part.rows]
