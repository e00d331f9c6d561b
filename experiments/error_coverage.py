"""What do the three errors of a parameter cover when the model is wrong and the noise is coloured?

A decaying ring and a ramp in every cycle are fitted to eight cycles of 200 samples with a free zero.  The data have
more: a misfit that every cycle repeats, and noise e_t = rho e_(t-1) + w_t.  Counted is how often the 95 % intervals
cover the pseudo-true parameters (those of the fit without noise) and the physical ones (with which the data were made),
over the four parameters:

- none: no misfit;
- fixed: always the same ring of another frequency and a slow wave, of 0.05 or 0.2 of the signal's height;
- smooth: in every run another random sum of 39 harmonics, half of the power below the sixth;
- local: in every run another ring right after the start of the cycle, much like the signal itself: what a fit takes up.

The whole is numpy; no actuator is simulated.

    python -m experiments.error_coverage [RUNS]
"""

import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from experiments.common import BLUE, GREEN, VERMILION, Row, print_table, save, styled
from pdssjax.inference import curvature_of, influence_of, principal_directions
from pdssjax.inference.uncertainty.error_models.base import RecordErrors
from pdssjax.inference.uncertainty.error_models.coloured import Coloured
from pdssjax.inference.uncertainty.error_models.white import White
from pdssjax.inference.uncertainty.error_models.with_misfit import WithMisfit

NAME = "error_coverage"
CYCLES, SAMPLES = 8, 200
TIME = np.arange(CYCLES * SAMPLES) / SAMPLES
PHASE = np.arange(SAMPLES) / SAMPLES
TRUTH = np.array([1.0, 60.0, 10.0, 0.4])
"""Height, angular frequency and decay rate of the ring, slope of the ramp; a cycle lasts 1."""
MODELS = ("white", "coloured", "with misfit")
Misfit = Callable[[np.random.Generator], Float[np.ndarray, " phases"]]


class Situation(NamedTuple):
    """How data are made."""

    name: str
    misfit: Misfit
    noise: float
    """Standard deviation."""
    correlation: float
    """Of neighbouring noise."""
    scattered: bool
    """The misfit is another one in every run."""


def fixed(height: float) -> Misfit:
    ring = 1.5 * np.exp(-25.0 * PHASE) * np.cos(90.0 * PHASE + 1.0)
    return lambda random: height * (ring + 0.5 * np.sin(2.0 * np.pi * PHASE + 0.3))


def smooth(random: np.random.Generator) -> Float[np.ndarray, " phases"]:
    orders = np.arange(1, 40)
    sizes = 1.0 / (1.0 + (orders / 6.0) ** 2)
    angles = 2.0 * np.pi * np.outer(orders, PHASE)
    waves = (random.normal(size=39) * sizes) @ np.cos(angles) + (random.normal(size=39) * sizes) @ np.sin(angles)
    return 0.05 * waves / np.sqrt(np.sum(sizes**2))


def local(random: np.random.Generator) -> Float[np.ndarray, " phases"]:
    rate, decay, turn = random.uniform(40.0, 120.0), random.uniform(8.0, 25.0), random.uniform(0.0, 2.0 * np.pi)
    return 0.125 * random.normal() * np.exp(-decay * PHASE) * np.cos(rate * PHASE + turn)


SITUATIONS = (
    Situation("none, white noise", lambda random: 0.0 * PHASE, 0.05, 0.0, False),
    Situation("none", lambda random: 0.0 * PHASE, 0.05, 0.8, False),
    Situation("fixed, small", fixed(0.05), 0.05, 0.8, False),
    Situation("fixed, large", fixed(0.2), 0.05, 0.8, False),
    Situation("smooth", smooth, 0.05, 0.8, True),
    Situation("local", local, 0.02, 0.5, True),
)


def predicted(free: Float[np.ndarray, " p"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n p"]]:
    """The model and its Jacobian, without their means: the zero is free."""
    height, rate, decay, slope = free
    phase = np.mod(TIME, 1.0)
    fade, c, s = np.exp(-decay * phase), np.cos(rate * phase), np.sin(rate * phase)
    columns = np.stack([fade * c, -height * fade * phase * s, -height * phase * fade * c, phase], axis=1)
    value = height * fade * c + slope * phase
    return value - value.mean(), columns - columns.mean(axis=0)


def fitted(measured: Float[np.ndarray, " n"], start: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    """Least squares by Levenberg and Marquardt."""
    best, damping = start, 1e-3
    off = measured - measured.mean()
    value, columns = predicted(best)
    cost = float(np.sum((value - off) ** 2))
    for _ in range(80):
        normal = columns.T @ columns
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -columns.T @ (value - off))
        trial = predicted(best + step)
        new = float(np.sum((trial[0] - off) ** 2))
        if new <= cost:
            done = np.max(np.abs(step / best)) < 1e-10
            best, cost, damping, (value, columns) = best + step, new, damping / 3.0, trial
            if done:
                break
        else:
            damping *= 4.0
    return best


def errors(
    measured: Float[np.ndarray, " n"], free: Float[np.ndarray, " p"], noise: float
) -> Float[np.ndarray, "models p"]:
    """Standard errors of a fit by the three models."""
    value, columns = predicted(free)
    residual = (value - measured + measured.mean()) / noise
    jacobian = columns / noise
    (curvature,) = curvature_of(
        lambda at: predicted(at)[1] / noise,
        free,
        residual,
        jacobian,
        principal_directions(jacobian),
        [slice(0, TIME.size)],
        (np.full(4, -np.inf), np.full(4, np.inf)),
    )
    freedom = TIME.size - 5.0
    plain = RecordErrors(
        residual, jacobian, influence_of(jacobian), TIME, 1.0, float(residual @ residual) / freedom, freedom
    )
    curved = plain._replace(influence=influence_of(jacobian, curvature))
    shares = White().share(plain), Coloured().share(curved), WithMisfit().share(curved)
    return np.sqrt([np.diag(share.covariance) for share in shares])


def coverage(situation: Situation, runs: int, seed: int = 1) -> Float[np.ndarray, "targets models p"]:
    """How often 95 % intervals hold the pseudo-true (first) and the physical parameters (second)."""
    random, inside, pseudo, clean = np.random.default_rng(seed), [], TRUTH, np.zeros(TIME.size)
    for run in range(runs):
        if run == 0 or situation.scattered:
            clean = predicted(TRUTH)[0] + np.tile(situation.misfit(random), CYCLES)
            pseudo = fitted(clean, TRUTH)
        white = random.normal(size=TIME.size + 200)
        noise = np.empty(white.size)
        noise[0] = white[0]
        for i in range(1, white.size):
            noise[i] = situation.correlation * noise[i - 1] + np.sqrt(1.0 - situation.correlation**2) * white[i]
        measured = clean + situation.noise * noise[200:]
        free = fitted(measured, pseudo)
        half = 1.96 * errors(measured, free, situation.noise)
        inside.append([np.abs(free - pseudo) < half, np.abs(free - TRUTH) < half])
    return np.mean(inside, axis=0)


def rows(found: dict[str, Float[np.ndarray, "targets models p"]]) -> list[Row]:
    """Least and largest coverage of the four parameters, per cent."""
    span = lambda share: f"{100 * share.min():.1f} .. {100 * share.max():.1f}"
    return [
        Row(f"{name}: {model}, {target}", None, span(shares[i, j]), "%")
        for name, shares in found.items()
        for i, target in enumerate(("pseudo-true", "physical"))
        for j, model in enumerate(MODELS)
    ]


def draw(found: dict[str, Float[np.ndarray, "targets models p"]]) -> Figure:
    """Coverage of every parameter by every model."""
    figure = Figure(figsize=(7.4, 3.4), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for i, (axes, target) in enumerate(zip(panels, ("pseudo-true parameters", "physical parameters"), strict=True)):
        axes.axvspan(93.0, 97.0, color="0.85", linewidth=0)
        for j, (model, colour) in enumerate(zip(MODELS, (BLUE, VERMILION, GREEN), strict=True)):
            for place, shares in enumerate(found.values()):
                places = np.full(4, place + 0.22 * (j - 1))
                label = model if place == 0 else None
                axes.plot(100.0 * shares[i, j], places, "o", color=colour, markersize=4, alpha=0.7, label=label)
        axes.set_yticks(range(len(found)), list(found))
        axes.set_xlim(-3.0, 103.0)
        axes.set_xlabel("covered by 95 % intervals (%)")
        axes.set_title(target, loc="left")
    panels[0].invert_yaxis()
    panels[0].legend(loc="lower left")
    return figure


def main(runs: int = 150) -> None:
    """Print the table and draw the figure."""
    found = {situation.name: coverage(situation, runs) for situation in SITUATIONS}
    print_table(f"Coverage of 95 % intervals, {runs} runs", rows(found), NAME)
    with styled():
        save(draw(found), NAME)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
