"""The friction refitted with the stack moved from one identification to another, beside what the amplification says.

The thesis identified its stack twice: chapter 4 has 6527 rad/s and 0.2083 (and, read from H sin(pL), 0.0979 um/V),
chapter 5 uses 6736 rad/s, 0.1772 and 0.1007 um/V.  Its friction parameters were fitted with the latter held.  What
they would have been with the former is found here by refits to records that follow chapter 5 exactly, the
stack moved in small steps so that the optimum is followed.  The same with the record of Liu et al. 2015, whose
stack the paper gives without errors.
"""

import dataclasses
import json
import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

import pdssjax
from experiments.common import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, Row, print_table
from experiments.measured_fits import EARLIER, FOLDER, STARTS
from experiments.step_responses import CHAPTER_4, CHAPTER_5
from experiments.three_ways import ACCURACY, SCENARIOS, amplification, known_truth, rig_of, with_measured
from pdssjax import Study
from pdssjax.inference import Problem, least_squares_covariance, with_piezo_held

COLOURS = (BLUE, SKY, VERMILION, ORANGE, GREEN, PURPLE)
STEPS = 8
"""Refits on the way."""
ALONE = ("piezo.natural_frequency", "piezo.damping_ratio")
BETWEEN = {
    "piezo.natural_frequency": CHAPTER_4.frequency / CHAPTER_5.frequency,
    "piezo.damping_ratio": CHAPTER_4.damping / CHAPTER_5.damping,
    "piezo.gain": CHAPTER_4.gain / CHAPTER_5.gain,
}
"""Chapter 4's number over chapter 5's."""
WALKED = 13.75e-6 / (30.0 * 5.0)
"""Gain by the slope of the end-effector while it sticks, over that of the voltage [m/V] (PROVENANCE.md)."""
USUAL_DAMPING = 100.0
"""Start of the contact's damping [N s/m]; the other starts are those of `measured_laws`."""
PAPER = {"piezo.gain": 0.096e-6, "piezo.natural_frequency": 6685.5, "piezo.damping_ratio": 0.2488}
"""Liu et al. 2015, from step tests."""


@dataclasses.dataclass(frozen=True)
class Moved:
    """What becomes of the parameters fitted after the stack while that moves."""

    name: str
    paths: tuple[str, ...]
    """Of the parameters fitted."""
    base: Float[np.ndarray, " later"]
    """Their values before [SI]."""
    share: Float[np.ndarray, " steps"]
    """Of the way that the stack has gone, from 0 to 1."""
    refitted: Float[np.ndarray, "steps later"]
    """Relative change."""
    linear: Float[np.ndarray, " later"]
    """The same at the end by the amplification matrix."""
    misfit: Float[np.ndarray, " steps"]
    """Root mean square of the residuals over the noise."""
    r2: float
    """Coefficient of determination of the worst record at the end."""
    converged: bool


def follow(
    name: str, problem: Problem, values: Mapping[str, float], factors: Mapping[str, float], steps: int = STEPS
) -> Moved:
    """The fit with the stack held at `values` times `factors`, by so many `steps` from the fit at `values`."""
    transform = problem.residual.transform
    piezo = np.array([path.startswith("piezo.") for path in transform.paths])
    away = np.array([np.log(factors.get(path, 1.0)) for path in transform.paths])
    begun = problem.encode(values)
    fit = first = with_piezo_held(problem, begun, _quiet)
    base, matrix = fit.free[~piezo], amplification(problem, np.asarray(fit.state.jacobian), piezo)
    shares = np.linspace(0.0, 1.0, steps + 1)
    moved, misfits = [np.zeros(base.size)], [_misfit(problem, np.asarray(fit.state.residual))]
    for share in shares[1:]:
        free = np.where(piezo, begun + share * away, fit.free)
        fit = with_piezo_held(problem, free, _quiet)
        moved.append(np.expm1(fit.free[~piezo] - base))
        misfits.append(_misfit(problem, np.asarray(fit.state.residual)))
    linear = matrix @ np.expm1(away[piezo])
    paths = tuple(path for path, is_piezo in zip(transform.paths, piezo, strict=True) if not is_piezo)
    begins = problem.decode(first.free)
    return Moved(
        name,
        paths,
        np.array([float(begins[path]) for path in paths]),
        shares,
        np.stack(moved),
        linear,
        np.array(misfits),
        _worst_r2(problem, np.asarray(fit.state.residual)),
        bool(fit.success),
    )


def _walks(problem: Problem) -> np.ndarray:
    return np.array([not record.measurement.platform_alone for record in problem.records])


def _misfit(problem: Problem, residual: Float[np.ndarray, " n"]) -> float:
    walks = np.repeat(_walks(problem), [record.time.size for record in problem.records])
    return float(np.sqrt(np.mean(residual[walks] ** 2)))


def _worst_r2(problem: Problem, residual: Float[np.ndarray, " n"]) -> float:
    """Of the records that show more than the platform, from whitened residuals."""
    ends = np.cumsum([record.time.size for record in problem.records])[:-1]
    parts = zip(
        np.split(residual, ends), problem.residual.comparison.measured, problem.noise, _walks(problem), strict=True
    )
    return min(1.0 - float(np.mean((noise * r) ** 2) / np.var(y)) for r, y, noise, walks in parts if walks)


def _quiet(message: str) -> None:
    """Reports no progress."""


def thesis() -> list[Moved]:
    """From chapter 5's stack to chapter 4's: frequency and damping ratio, then the gain as well."""
    rig = rig_of(SCENARIOS[0])
    problem = with_measured(rig.problem, list(rig.motions))
    without = {path: BETWEEN[path] for path in ALONE}
    both = [("frequency and damping ratio", without), ("the gain, too", BETWEEN)]
    return [follow(name, problem, known_truth(), factors) for name, factors in both]


def liu() -> tuple[dict[str, float], list[Moved]]:
    """The measured record with the paper's stack held, and that moved: as between the thesis's two, and in its gain.

    **Returns:** also the relative standard errors that a fit of everything at once would have there; NaN where the
    record does not tell.
    """
    study = _liu_study()
    known = json.loads(STARTS.read_text(encoding="utf-8"))["starts"]["simplified-lugre"]
    starts = {path: known[path] for path in study.parameters} | PAPER | {"friction.sigma1": USUAL_DAMPING}
    problem, _ = pdssjax.pose_problem(study.with_starts(starts), ACCURACY)
    fit = with_piezo_held(problem, problem.encode(starts), _quiet)
    found = {path: float(number) for path, number in problem.decode(fit.free).items()}
    whole = least_squares_covariance(np.asarray(fit.state.jacobian), np.zeros(fit.free.size, bool))
    errors = np.where(whole.identifiable, np.sqrt(np.diag(whole.matrix)), np.nan)
    without = {path: BETWEEN[path] for path in ALONE}
    moved = [
        follow("frequency and damping ratio as between the thesis's two", problem, found, without),
        follow("the gain of the walk itself", problem, found, {"piezo.gain": WALKED / PAPER["piezo.gain"]}),
    ]
    return dict(zip(problem.residual.transform.paths, map(float, errors), strict=True)), moved


def _liu_study() -> Study:
    """As the file has it, the clock set back by whole cycles to save time."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", pdssjax.InputWarning)  # the second record is shorter than a period
        study = pdssjax.load_study(FOLDER / "study.toml")
    records = tuple(dataclasses.replace(record, time=record.time - EARLIER) for record in study.records)
    return dataclasses.replace(study, records=records)


def show_thesis(found: Sequence[Moved]) -> str:
    """The friction parameters with chapter 5's stack beside those with chapter 4's."""
    published = known_truth()
    parts = []
    for moved in found:
        rows = [
            Row(path, published[path], published[path] * (1.0 + moved.refitted[-1, i]), "", _predicted(moved, i))
            for i, path in enumerate(moved.paths)
        ]
        notes = [
            f"Refitted with chapter 4's {moved.name} held; the worst record's r2 is {moved.r2:.5f} then, its residuals "
            f"{moved.misfit[-1]:.1f} times the noise (thesis: r2 0.9987). "
            + ("" if moved.converged else "The last refit did not converge.")
        ]
        parts.append(
            print_table(f"Friction with chapter 4's stack in place of chapter 5's: {moved.name}", rows, None, notes)
        )
    return "\n\n".join(parts)


def show_liu(errors: Mapping[str, float], found: Sequence[Moved]) -> str:
    """The measured record: what moving the stack does to what was fitted with it held."""
    lines = [
        "## Liu et al. 2015, measured: what was fitted with the paper's stack held, and with that moved",
        "",
        "| | held | " + " | ".join(f"{moved.name}: refit (amplification)" for moved in found) + " | together |",
        "|---|--:|" + "--:|" * (len(found) + 1),
    ]
    for i, path in enumerate(found[0].paths):
        ends = [f"{100 * moved.refitted[-1, i]:+.0f} % ({100 * moved.linear[i]:+.0f} %)" for moved in found]
        lines.append(f"| {path} | {found[0].base[i]:.4g} | " + " | ".join([*ends, _percent(errors[path])]) + " |")
    lines += [
        f"| {path} | {PAPER[path]:.4g} | " + "- | " * len(found) + f"{_percent(errors[path])} |" for path in PAPER
    ]
    misfits = "; ".join(f"{moved.name}: {moved.misfit[0]:.2f} to {moved.misfit[-1]:.2f}" for moved in found)
    lines += [
        "",
        f"Residuals over the reading error of 0.1 um, from the paper's stack to the moved one: {misfits}. Together: "
        "the standard error that a fit of the stack with all else would have, linearised.",
    ]
    print("\n".join(lines))
    return "\n".join(lines)


def _percent(error: float) -> str:
    return f"{100 * error:.2g} %" if np.isfinite(error) else "not told"


def _predicted(moved: Moved, i: int) -> str:
    return f"amplification x difference: {100.0 * moved.linear[i]:+.0f} %"


def draw(found: Sequence[Moved]) -> Figure:
    """One panel a way that the stack goes: every parameter over its value before, refitted and by the amplification."""
    figure = Figure(figsize=(9.2, 4.0), layout="constrained")
    panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    for axes, moved in zip(panels, found, strict=True):
        for i, (path, colour) in enumerate(zip(moved.paths, COLOURS, strict=False)):
            axes.plot(moved.share, 1.0 + moved.refitted[:, i], ".-", color=colour, label=path.split(".")[1])
            axes.plot(moved.share, 1.0 + moved.share * moved.linear[i], "--", color=colour, linewidth=0.9)
        axes.set_yscale("log")
        axes.set_ylim(0.2, 6.0)
        axes.set_yticks([0.2, 0.5, 1.0, 2.0, 5.0], ["0.2", "0.5", "1", "2", "5"])
        axes.yaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel("from chapter 5's stack (0) to chapter 4's (1)")
        axes.set_title(f"{moved.name}\nat the end {moved.misfit[-1]:.1f} times the noise is left", loc="left")
    panels[0].set_ylabel("friction parameter over its value before\n(dashed: by the amplification matrix)")
    panels[-1].legend(loc="lower left", ncols=2)
    return figure
