"""Intervals by drawing, of a bootstrap or a posterior, in an estimate.

A posterior is drawn on the scale of the fit, but parameters near zero by their values.  The logarithm of a damping
that may be zero reaches minus infinity, with the likelihood at a finite limit: no polynomial follows that, and at an
optimum at zero residuals have no derivative by the logarithm.  By the value, in standard errors, they are smooth.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ...core import percent
from ...metrics import effective_size, effective_size_of_tails, rhat
from ...study import Draws, Estimate, ParameterDraws
from ..draws import Drawing
from ..evidence import Evidence
from ..least_squares import FitMethod, Progress
from ..notes.about_records import about_better_optimum
from ..parameter_transform import Box
from ..problem import Problem
from .bootstrap import Replicate, bootstrap, phases_of
from .linear_intervals import NORMAL_95, half_width_95, row_factors
from .no_u_turn import sample_by_trajectories
from .posterior import BEYOND, posterior_model, principal_axes, sample_posterior
from .profile_likelihood import End, EndKey, Evaluate, Verdict
from .randomize_then_optimize import NothingToDraw
from .second_order import Linearisation, linearisation_at

_NEAR = 3.0
"""Standard errors from zero below which a value is drawn itself, and not its logarithm."""

_LEAST = 1e-6
"""Least size of a value, in standard errors: at zero a logarithm is not finite."""


class PosteriorCoordinates(eqx.Module):
    """Coordinates y of p parameters, in place of the fit's x."""

    by_value: Bool[np.ndarray, " p"]
    """Where x is the logarithm of a value and y the value."""
    unit: Float[np.ndarray, " p"]
    """The standard error of a value drawn linearly [SI]; 1 elsewhere."""

    def to_fit(self, y: Float[Array | np.ndarray, "*n p"]) -> Float[Array, "*n p"]:
        """x at y."""
        return jnp.where(self.by_value, jnp.log(jnp.where(self.by_value, y * self.unit, 1.0)), y)

    def of_fit(self, x: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """y at x, a little above zero where that is zero."""
        return np.where(self.by_value, np.maximum(np.exp(np.where(self.by_value, x, 0.0)) / self.unit, _LEAST), x)

    def slopes(self, y: Float[Array | np.ndarray, " p"]) -> Float[Array, " p"]:
        """dx/dy."""
        return jnp.where(self.by_value, 1.0 / jnp.where(self.by_value, y, 1.0), 1.0)

    def bounds(self, bounds: Box) -> Box:
        """The bounds on y that correspond to `bounds` on x."""
        low, high = bounds
        return self.of_fit(np.asarray(low, float)), self.of_fit(np.asarray(high, float))

    def linearised(self, point: Linearisation) -> Linearisation:
        """The linearisation of a `point` of the fit in these coordinates."""
        at = self.of_fit(point.at)
        return Linearisation(at, point.residual, point.jacobian * np.asarray(self.slopes(at)))


class InCoordinates(eqx.Module):
    """Residuals and their Jacobian as functions of y."""

    evaluate: Evaluate
    """Residuals and their Jacobian as functions of x."""
    coordinates: PosteriorCoordinates

    def __call__(self, y: Float[Array | np.ndarray, " p"]) -> tuple[Float[Array, " n"], Float[Array, "n p"]]:
        residual, jacobian = self.evaluate(self.coordinates.to_fit(y))
        return jnp.asarray(residual), jnp.asarray(jacobian) * self.coordinates.slopes(y)


def posterior_coordinates(
    optimum: Linearisation,
    moving: Int[np.ndarray, " q"],
    bounds: Box,
    factor: float,
    logarithmic: Bool[np.ndarray, " p"],
) -> PosteriorCoordinates:
    """Coordinates around an `optimum` of the fit with some parameters `logarithmic`; see `posterior_model`.

    A value is near zero where the linear model puts zero within three standard errors, unless the value is nearer to
    its upper bound: then the data do not tell it from infinity.
    """
    errors = np.linalg.norm(principal_axes(optimum, moving, factor), axis=1)  # of logarithms: relative
    low, high = bounds
    near = logarithmic & (errors > 1.0 / _NEAR) & ~(high - optimum.at < optimum.at - low)
    unit = np.where(near, np.exp(np.where(near, optimum.at, 0.0)) * errors, 1.0)
    return PosteriorCoordinates(near, unit)


_TAILS = 0.025, 0.975
"""Shares of the draws below the ends of a 95 % interval."""

FEWEST_DRAWS = 100
"""Draws below which the ends of a 95 % interval rest on too few of them."""

LARGEST_RHAT = 1.01
"""Largest R-hat of chains that agree (Vehtari and others 2021)."""

FEWEST_EFFECTIVE = 400
"""Effective draws from which the ends of an interval may be trusted (Vehtari and others 2021)."""

FEW_ACCEPTED = 0.3
"""Share of the draws proposed for a posterior below which its chains move little."""

ENOUGH_BEYOND = 8.0
"""Independent draws expected beyond an end from which it is no chance that there are few."""

FEW_BEYOND = 0.2
"""Share of the draws expected beyond an end below which a tail of the posterior is missing."""

MANY_FAILED = 0.05
"""Share of replicates that may fail before the intervals no longer stand for all of them."""


def with_bootstrap(
    estimate: Estimate,
    evidence: Evidence,
    run: FitMethod,
    drawing: Drawing,
    executor: Executor | None,
    report: Progress,
) -> Estimate:
    """`estimate` with the percentiles of a bootstrap as 95 % intervals, and all replicates as `draws`."""
    problem, fit, transform = evidence.problem, evidence.fit, evidence.problem.residual.transform
    replicates = bootstrap(problem, fit, run, evidence.variance_factor, drawing, executor, report)
    good = [replicate.free for replicate in replicates if replicate.success]
    failed = len(replicates) - len(good)
    notes = [*estimate.notes, *_about_replicates(replicates, failed)]
    if len(good) < 2:
        return dataclasses.replace(estimate, notes=tuple(notes))
    free = np.stack(good)
    draws = Draws(
        kind="bootstrap",
        description=_description(problem, drawing),
        names=estimate.names,
        values=transform.in_si(transform.own(free))[None],
        failed=failed,
        failure="did not converge and are left out",
        seed=drawing.seed,
        parameters=tuple(summary_of_replicates(problem, fit.free, free)),
    )
    return with_draws(estimate, draws, notes, transform.logarithmic)


def summary_of_replicates(
    problem: Problem, centre: Float[np.ndarray, " p"], free: Float[np.ndarray, "draws p"]
) -> list[ParameterDraws]:
    """Mean, deviation and both kinds of intervals of each parameter, from replicates on the scale of the fit."""
    transform = problem.residual.transform
    own, middle = transform.own(free), transform.own(centre)
    values, ends = transform.in_si(own), np.quantile(own, _TAILS, axis=0)
    percentiles, basics = transform.in_si(ends), transform.in_si(2.0 * middle - ends[::-1])
    return [
        ParameterDraws(
            path=path,
            mean=float(np.mean(values[:, i])),
            deviation=float(np.std(values[:, i], ddof=1)),
            percentile=(float(percentiles[0, i]), float(percentiles[1, i])),
            basic=(float(basics[0, i]), float(basics[1, i])),
        )
        for i, path in enumerate(transform.paths)
    ]


def with_posterior(
    estimate: Estimate, evidence: Evidence, drawing: Drawing, executor: Executor | None, report: Progress
) -> Estimate:
    """`estimate` with the middle 95 % of the posterior as intervals, and all draws as `draws`.

    A note says so where hardly anything around the fit lies between the bounds: its intervals are linear then.

    **Raises:** `InputError` where the fit itself cannot be simulated, or what was kept is not what a run writes.
    """
    problem, fit, factor = evidence.problem, evidence.fit, evidence.variance_factor
    moving = np.array([estimate.parameters[path].identifiable for path in estimate.names])
    if not moving.any():
        note = "No posterior: the data say nothing about any parameter."
        return dataclasses.replace(estimate, notes=(*estimate.notes, note))
    transform, optimum, places = problem.residual.transform, linearisation_at(fit), np.flatnonzero(moving)
    coordinates = posterior_coordinates(optimum, places, problem.bounds, factor, transform.logarithmic)
    model = posterior_model(
        InCoordinates(problem.linearisation, coordinates),
        lambda y: problem.whitened(coordinates.to_fit(y)),
        coordinates.linearised(optimum),
        places,
        coordinates.bounds(problem.bounds),
        transform.logarithmic & ~coordinates.by_value,
        factor,
        executor,
        report,
    )
    # A trajectory that ends at an edge is a draw all the same.
    sample, sampler, failure, fewest = {
        "rto": (sample_posterior, "randomize-then-optimize", "proposals refused by the model", FEW_ACCEPTED),
        "nuts": (sample_by_trajectories, "the No-U-Turn sampler", "trajectories that ended at an edge", 0.0),
    }[drawing.sampler]
    try:
        chains = sample(model, drawing, executor, report)
    except NothingToDraw as error:
        return dataclasses.replace(estimate, notes=(*estimate.notes, f"No posterior, intervals are linear: {error}"))
    in_si = lambda y: transform.in_si(transform.own(np.asarray(coordinates.to_fit(y))))
    values = in_si(chains.free)
    held = [path for path, moves in zip(estimate.names, moving, strict=True) if not moves]
    draws = Draws(
        kind="posterior",
        description=f"{_density_in_words(problem, factor, held)}; by {sampler}",
        names=estimate.names,
        values=values,
        failed=chains.failed,
        failure=failure,
        seed=drawing.seed,
        parameters=tuple(summary_of_chains(estimate.names, values, moving)),
        statistics=chains.statistics,
    )
    about = about_chains(draws, fewest) + about_tails(draws.parameters, chains.free, model.ends)
    about += about_endless(estimate.names, model.ends, model.logarithmic)
    about += about_better_optima(estimate.names, model.ends, in_si)
    return with_draws(estimate, draws, [*estimate.notes, *about], transform.logarithmic)


def summary_of_chains(
    paths: tuple[str, ...], values: Float[np.ndarray, "chains draws p"], moving: Bool[np.ndarray, " p"]
) -> list[ParameterDraws]:
    """Mean, deviation, middle 95 % and convergence of each parameter, in SI; only what moves has a convergence."""
    out = []
    for i, path in enumerate(paths):
        drawn = values[:, :, i]
        low, high = np.quantile(drawn, _TAILS)
        deviation = float(np.std(drawn, ddof=1)) if moving[i] else float("nan")
        found = ParameterDraws(path, float(np.mean(drawn)), deviation, (float(low), float(high)))
        if moving[i]:
            sizes = effective_size(drawn), effective_size_of_tails(drawn)
            found = dataclasses.replace(found, rhat=rhat(drawn), effective=sizes[0], effective_tails=sizes[1])
        out.append(found)
    return out


def _density_in_words(problem: Problem, factor: float, held: list[str]) -> str:
    priors = ", ".join(problem.residual.prior.paths)
    text = f"flat priors on the values{f' but normal ones on those measured apart ({priors})' if priors else ''}"
    text += ", zeros of the sensors marginalised, noise known"
    if factor > 1.005:
        text += f" and its variance enlarged by {factor:.3g}"
        if not np.all(row_factors(problem, factor) == factor):
            text += ", also where it was found from residuals, and that of what was measured apart (too wide there)"
    return text + (f"; held at the estimate, without information: {', '.join(held)}" if held else "")


def about_chains(draws: Draws, fewest: float) -> list[str]:
    """Notes on chains that disagree, move too little, or take fewer of the draws proposed than the share `fewest`."""
    notes = []
    worst = max((drawn for drawn in draws.parameters if drawn.rhat is not None), key=lambda d: d.rhat or 0.0)
    if not (worst.rhat or 0.0) < LARGEST_RHAT:
        notes.append(
            f"The chains of the posterior disagree: R-hat of {worst.path} is {worst.rhat:.3f}, expected below "
            f"{LARGEST_RHAT:g}; draw more (--draws, --resume) before you trust its intervals."
        )
    sizes = [min(d.effective, d.effective_tails) for d in draws.parameters if d.effective and d.effective_tails]
    if sizes and min(sizes) < FEWEST_EFFECTIVE:
        notes.append(
            f"The posterior's draws are worth {min(sizes):.0f} independent ones only, expected {FEWEST_EFFECTIVE} or "
            "more for the ends of an interval."
        )
    accepted = 1.0 - draws.failed / draws.values[:, :, 0].size
    if accepted < fewest:
        notes.append(
            f"The model accepted {percent(accepted, 1.0)} of the draws proposed for the posterior, expected "
            f"{percent(fewest, 1.0)} or more: residuals have kinks there, or bend more than a polynomial does."
        )
    return notes


def about_tails(
    parameters: Sequence[ParameterDraws], free: Float[np.ndarray, "chains draws p"], ends: Mapping[EndKey, End]
) -> list[str]:
    """Notes on parameters of which fewer draws than can be chance lie beyond an end of their likelihood, far out."""
    missing = []
    for (place, side), end in ends.items():
        drawn = parameters[place]
        expected = BEYOND * (drawn.effective_tails or 0.0)
        beyond = float(np.mean(side * (free[:, :, place] - end.value) > 0.0)) / BEYOND
        if end.verdict == Verdict.BOUNDED and expected > ENOUGH_BEYOND and beyond < FEW_BEYOND:
            missing.append(f"{drawn.path} {'above' if side > 0 else 'below'}")
    if not missing:
        return []
    return [
        f"Fewer draws of the posterior than {percent(FEW_BEYOND, 1.0)} of what was expected lie beyond where the "
        f"likelihood ends: {', '.join(missing)}. Where profiles (--intervals profile) end further out than the draws, "
        "believe the profiles."
    ]


def about_endless(paths: Sequence[str], ends: Mapping[EndKey, End], logarithmic: Bool[np.ndarray, " p"]) -> list[str]:
    """Notes on parameters whose likelihood has no end where their values have none: what bounds them is the prior."""
    endless = [
        f"{paths[place]} {'above' if side > 0 else 'below'}"
        for (place, side), end in ends.items()
        if end.verdict == Verdict.FLAT and not (side < 0 and logarithmic[place])
    ]
    if not endless:
        return []
    return [
        f"The likelihood has no end: {', '.join(endless)}. Draws go as far there as the bounds of the study allow, and "
        "the posterior is that of the bounds; give min and max, or fix the parameter."
    ]


def about_better_optima(
    paths: Sequence[str],
    ends: Mapping[EndKey, End],
    in_si: Callable[[Float[np.ndarray, " p"]], Float[np.ndarray, " p"]],
) -> list[str]:
    """Write a note on the best point below the optimum that the searches for ends met."""
    better = [(end.point.chi2, place, end) for (place, _), end in ends.items() if end.verdict == Verdict.LOWER]
    if not better:
        return []
    _, place, end = min(better, key=lambda item: item[0])
    number = float(in_si(end.point.at)[place])
    return [about_better_optimum("While the posterior was learned", end.point.chi2, paths[place], number)]


def with_draws(estimate: Estimate, draws: Draws, notes: list[str], logarithmic: Bool[np.ndarray, " p"]) -> Estimate:
    """`estimate` with the intervals of `draws` for identifiable parameters.

    Draws take the noise as known.  Where it was estimated, the ends are moved outwards by the ratio of Student's t to
    the normal quantile, on the scale of the fit, but not beyond a bound.
    """
    parameters, most = dict(estimate.parameters), 1.0
    for drawn, by_logarithm in zip(draws.parameters, logarithmic, strict=True):
        found, ends = parameters[drawn.path], np.array(drawn.percentile)
        if not found.identifiable:
            continue
        wider = float(half_width_95(found.degrees_of_freedom)) / NORMAL_95
        if wider != 1.0:
            if by_logarithm and found.value > 0.0:
                ends = found.value * (ends / found.value) ** wider
            else:
                ends = found.value + wider * (ends - found.value)
            ends = np.clip(ends, *found.bounds)
        interval = float(ends[0]), float(ends[1])
        parameters[drawn.path], most = dataclasses.replace(found, interval=interval), max(most, wider)
    if most > 1.01:
        more = f"up to {percent(most - 1.0, 1.0)} farther out than 95 % of the draws"
        draws = dataclasses.replace(
            draws, description=f"{draws.description}; intervals end {more}, since the noise was found from few samples"
        )
    return dataclasses.replace(estimate, parameters=parameters, draws=draws, notes=tuple(notes))


def _description(problem: Problem, drawing: Drawing) -> str:
    noise = "white noise of the size fitted"
    if drawing.resampled == "noise":
        return noise
    cyclic = [record.name for record in problem.records if phases_of(record) is not None]
    if not cyclic:
        return f"{noise}; no record holds whole cycles with samples at equal phases"
    rest = "" if len(cyclic) == len(problem.records) else f"; {noise} in the others"
    return f"whole cycles of the residuals of {', '.join(cyclic)}{rest}"


def _about_replicates(replicates: list[Replicate], failed: int) -> list[str]:
    count, notes = len(replicates), []
    if failed:
        messages = [replicate.message for replicate in replicates if not replicate.success]
        often = max(set(messages), key=messages.count)
        less = "; the intervals then are too short" if failed > MANY_FAILED * count else ""
        notes.append(
            f"{failed} of {count} replicates of the bootstrap did not converge and are left out{less}: {often}."
        )
    if count - failed < FEWEST_DRAWS:
        notes.append(f"The bootstrap has {count - failed} replicates only: the ends of its intervals are uncertain.")
    return notes
