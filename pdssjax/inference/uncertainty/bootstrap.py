"""Bootstrap: the fit repeated on data drawn anew around it, for intervals that need no linear model.

Each replicate is what was fitted plus residuals drawn anew, and a whole fit of it from the optimum (B. Efron and
R. J. Tibshirani, An Introduction to the Bootstrap, Chapman and Hall 1993).  What is drawn: white noise of the size
found (the parametric bootstrap); or, where a drive repeats and its samples fall on the same phases, whole cycles of
residuals, with replacement, so that neighbours stay correlated as they are and the noise may depend on the phase.
The mean over the cycles, which is misfit, stays where it is.
"""

import functools
from concurrent.futures import Executor
from typing import NamedTuple

import equinox as eqx
import numpy as np
from jaxtyping import Float

from ...core import Document, need_double_precision, prepare_jax
from ...study import Record
from ..draws import REPLICATES, Drawing, Resampled, each_done, reading
from ..least_squares import Fit, FitMethod, Progress, quiet
from ..problem import Problem

FEWEST_CYCLES = 3
"""Whole cycles in a record from which they can be drawn."""

_OFF_GRID = 0.02
"""Samples by which the cycles may leave the grid of samples over a record."""


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

    **Arguments:** the `factor` by which the variance exceeds that of the noise given.  Every replicate is fitted by
    `run` from the optimum, where the `executor` says; None: in this thread.
    """
    count = drawing.count or REPLICATES
    with reading(drawing.store, "replicates"):
        found = {entry["number"]: _from_document(entry, np.size(fit.free)) for entry in drawing.store.kept()}
    missing = [number for number in range(count) if number not in found]
    centre = _Centre(np.asarray(fit.free, float), np.asarray(fit.state.residual), factor)
    work = functools.partial(fitted_replicate, problem, centre, run, drawing.resampled, drawing.seed)
    for _, replicate in each_done(work, missing, executor):
        drawing.store.keep(_document(replicate))
        found[replicate.number] = replicate
        report(f"bootstrap: {len(found)} of {count} replicates")
    return [found[number] for number in range(count)]


class _Centre(NamedTuple):
    """Around which data are drawn."""

    free: Float[np.ndarray, " p"]
    residual: Float[np.ndarray, " n"]
    """Whitened."""
    factor: float


def fitted_replicate(
    problem: Problem, centre: _Centre, run: FitMethod, resampled: Resampled, seed: int, number: int
) -> Replicate:
    """The fit to the data of replicate `number`; also in another process, which prepares JAX for it."""
    _prepare_process()
    random = np.random.default_rng([seed, number])
    data = redrawn(problem, centre, resampled, random), apart_redrawn(problem, centre, random)
    drawn = eqx.tree_at(lambda residual: (residual.measured, residual.apart), problem.residual, data)
    fit = run(problem._replace(residual=drawn), problem.decode(centre.free), quiet)
    return Replicate(number, np.asarray(fit.free, float), bool(fit.success and np.isfinite(fit.chi2)), fit.message)


def _prepare_process() -> None:
    """A process of an executor begins with JAX in single precision."""
    try:
        need_double_precision()
    except ValueError:
        prepare_jax()


def redrawn(
    problem: Problem, centre: _Centre, resampled: Resampled, random: np.random.Generator
) -> tuple[Float[np.ndarray, " samples"], ...]:
    """New data of every record, in its unit."""
    parts = [centre.residual[rows] for rows in problem.rows]
    measured = []
    for record, part, noise, before in zip(
        problem.records, parts, problem.noise, problem.residual.measured, strict=True
    ):
        cycle = samples_per_cycle(record) if resampled == "cycles" else None
        if cycle is None:
            drawn = np.sqrt(centre.factor) * random.standard_normal(part.size)
        else:
            drawn = cycles_redrawn(part, cycle, random)
        measured.append(before + noise * (drawn - part))
    return tuple(measured)


def apart_redrawn(problem: Problem, centre: _Centre, random: np.random.Generator) -> dict[str, Float[np.ndarray, "2"]]:
    """New numbers of what was measured apart, with the same standard errors."""
    left = centre.residual[problem.rows_apart]
    return {
        path: np.array([number + error * (off - random.standard_normal()), error])
        for (path, (number, error)), off in zip(problem.residual.apart.items(), left, strict=True)
    }


def samples_per_cycle(record: Record) -> int | None:
    """Of a record that holds several whole cycles with samples at the same phases; else None."""
    frequency = None if record.drive is None else record.drive.cycle_frequency()
    if not frequency:
        return None
    count = 1.0 / (float(frequency) * float(np.median(np.diff(record.time))))
    on_grid = abs(count - round(count)) * np.ptp(record.time) * float(frequency) < _OFF_GRID
    return round(count) if on_grid and record.time.size >= FEWEST_CYCLES * round(count) else None


def cycles_redrawn(
    residual: Float[np.ndarray, " n"], cycle: int, random: np.random.Generator
) -> Float[np.ndarray, " n"]:
    """Residuals whose deviations from the mean over the cycles, of `cycle` samples each, are those of drawn cycles."""
    whole = residual.size // cycle
    cycles = residual[: whole * cycle].reshape(whole, cycle)
    mean = np.mean(cycles, axis=0)
    # The mean has taken one degree of freedom at each phase.
    deviations = (cycles - mean) * np.sqrt(whole / (whole - 1.0))
    drawn = deviations[random.integers(whole, size=-(-residual.size // cycle))]
    return (mean + drawn).ravel()[: residual.size]


def _document(replicate: Replicate) -> Document:
    return {
        "number": replicate.number,
        "free": replicate.free.tolist(),
        "success": replicate.success,
        "message": replicate.message,
    }


def _from_document(entry: Document, size: int) -> Replicate:
    for key, kind in (("number", int), ("success", bool), ("message", str)):
        if not isinstance(entry[key], kind):
            raise TypeError(f"{key} = {entry[key]!r}")
    free = np.array(entry["free"], float)
    if free.shape != (size,):
        raise ValueError(f"{free.size} numbers for {size} parameters in replicate {entry['number']}")
    return Replicate(entry["number"], free, entry["success"], entry["message"])
