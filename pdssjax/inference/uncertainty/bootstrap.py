"""Bootstrap: the fit repeated on data drawn anew around it, for intervals that need no linear model.

Each replicate is the fitted prediction plus residuals drawn anew, and a whole fit of this from the optimum (B. Efron
and R. J. Tibshirani, An Introduction to the Bootstrap, Chapman and Hall 1993).  The residuals are white noise of the
estimated size (the parametric bootstrap); or, where a drive repeats and its samples fall on the same phases, whole
cycles of residuals drawn with replacement, which keeps their correlation and dependence on phase.  The mean over the
cycles, which is misfit, is not redrawn.
"""

import functools
from concurrent.futures import Executor
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float, Int

from ...core import Document
from ...study import Record
from ..draws import REPLICATES, Drawing, Resampled, each_done, refuse_wrong_entries
from ..least_squares import Fit, FitMethod, Progress, quiet
from ..problem import Problem
from .linear_intervals import record_factors

FEWEST_CYCLES = 3
"""Fewest whole cycles of a record that cycles are drawn from."""

_OFF_GRID = 0.02
"""Largest drift of the cycles against the grid of samples over a record, in samples."""


class Replicate(NamedTuple):
    """One fit to data drawn anew."""

    number: int
    free: Float[np.ndarray, " p"]
    """Where it ended, on the scale of the fit."""
    success: bool
    message: str


def bootstrap(
    problem: Problem,
    fit: Fit,
    run: FitMethod,
    factor: float,
    drawing: Drawing,
    executor: Executor | None,
    report: Progress,
) -> list[Replicate]:
    """All replicates, in the order of their numbers; those that the store has kept are not fitted again.

    **Arguments:** the `factor` by which variances exceed those of the noise given.  Every replicate is fitted by
    `run` from the optimum, where the `executor` says; None: in this thread.
    """
    count = drawing.count or REPLICATES
    with refuse_wrong_entries(drawing.store, "replicates"):
        found = {entry["number"]: _from_document(entry, np.size(fit.free)) for entry in drawing.store.kept()}
    missing = [number for number in range(count) if number not in found]
    factors = record_factors(problem, factor)
    centre = _Centre(np.asarray(fit.free, float), np.asarray(fit.state.residual), factors)
    work = functools.partial(fitted_replicate, problem, centre, run, drawing.resampled, drawing.seed)
    for _, replicate in each_done(work, missing, executor):
        drawing.store.keep(replicate._asdict() | {"free": replicate.free.tolist()})
        found[replicate.number] = replicate
        report(f"bootstrap: {len(found)} of {count} replicates")
    return [found[number] for number in range(count)]


class _Centre(NamedTuple):
    free: Float[np.ndarray, " p"]
    residual: Float[np.ndarray, " n"]
    """Whitened."""
    factors: Float[np.ndarray, " records"]
    """Ratios by which the variances of records exceed that of their noise."""


def fitted_replicate(
    problem: Problem, centre: _Centre, run: FitMethod, resampled: Resampled, seed: int, number: int
) -> Replicate:
    """The fit to the data of replicate `number`."""
    random = np.random.default_rng([seed, number])
    measured = redrawn(problem, centre, resampled, random)
    prior = problem.residual.comparison.prior.redrawn(centre.residual[problem.rows_apart], random)
    drawn = eqx.tree_at(lambda r: (r.comparison.measured, r.comparison.prior), problem.residual, (measured, prior))
    fit = run(problem._replace(residual=drawn), problem.decode(centre.free), quiet)
    return Replicate(number, np.asarray(fit.free, float), bool(fit.success and np.isfinite(fit.chi2)), fit.message)


def redrawn(
    problem: Problem, centre: _Centre, resampled: Resampled, random: np.random.Generator
) -> tuple[Float[np.ndarray, " samples"], ...]:
    """New data of every record, in its unit."""
    parts = [centre.residual[rows] for rows in problem.rows]
    measured = []
    for record, part, noise, factor, before in zip(
        problem.records, parts, problem.noise, centre.factors, problem.residual.comparison.measured, strict=True
    ):
        phases = phases_of(record) if resampled == "cycles" else None
        if phases is None:
            drawn = np.sqrt(factor) * random.standard_normal(part.size)
        else:
            drawn = cycles_redrawn(part, *phases, random)
        measured.append(before + noise * (drawn - part))
    return tuple(measured)


def phases_of(record: Record) -> tuple[Int[np.ndarray, " samples"], int] | None:
    """Phases of a record that holds several whole cycles with samples at the same phases; else None.

    **Returns:** the place of each sample on the grid of all samples, of which some may be left out, and the number of
    places of a cycle.
    """
    frequency = None if record.drive is None else record.drive.cycle_frequency()
    if not frequency:
        return None
    count = 1.0 / (float(frequency) * float(np.median(np.diff(record.time))))
    cycle = round(count)
    if not cycle or abs(count - cycle) * np.ptp(record.time) * float(frequency) >= _OFF_GRID:
        return None
    exact = (record.time - record.time[0]) * float(frequency) * cycle
    places = np.rint(exact).astype(int)
    whole = np.count_nonzero(np.bincount(places // cycle) == cycle)
    # A single sample may leave the grid, since its clock may be uneven.
    return (places, cycle) if np.max(np.abs(exact - places)) < 0.25 and whole >= FEWEST_CYCLES else None


def cycles_redrawn(
    residual: Float[np.ndarray, " n"], places: Int[np.ndarray, " n"], cycle: int, random: np.random.Generator
) -> Float[np.ndarray, " n"]:
    """Residuals with the deviations from the mean of the whole cycles replaced by those of cycles drawn at random.

    **Arguments:** the `places` of the samples on a grid; the number of places of a `cycle`.
    """
    grid = np.full(cycle * (places[-1] // cycle + 1), np.nan)
    grid[places] = residual
    every = grid.reshape(-1, cycle)
    cycles = every[np.isfinite(every).all(axis=1)]
    whole, mean = len(cycles), np.mean(cycles, axis=0)
    # The mean has taken one degree of freedom at each phase.
    deviations = (cycles - mean) * np.sqrt(whole / (whole - 1.0))
    drawn = deviations[random.integers(whole, size=len(every))]
    return (mean + drawn).ravel()[places]


def _from_document(entry: Document, size: int) -> Replicate:
    for key, kind in (("number", int), ("success", bool), ("message", str)):
        if not isinstance(entry[key], kind):
            raise TypeError(f"{key} = {entry[key]!r}")
    free = np.array(entry["free"], float)
    if free.shape != (size,):
        raise ValueError(f"{free.size} numbers for {size} parameters in replicate {entry['number']}")
    if entry["success"] and not np.all(np.isfinite(free)):
        raise ValueError(f"numbers that are not finite in replicate {entry['number']}")
    return Replicate(entry["number"], free, entry["success"], entry["message"])
