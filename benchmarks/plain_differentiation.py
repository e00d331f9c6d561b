"""What differentiating the steps of an ordinary solver gets wrong, drawn: `python -m benchmarks.plain_differentiation`.

The derivatives of a walk by diffrax's Tsit5 with `jacfwd`, and by pdssjax, beside central differences of values.
The figure is that of docs/numerics.md.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from matplotlib.figure import Figure

from pdssjax import Accuracy, prepare_jax
from pdssjax.integration import TIGHT

from .peers.base import central_differences
from .peers.diffrax_plain import PEERS
from .problem import NAMES, PARAMETERS, Problem, column_errors, effector

FIGURE = Path(__file__).parents[1] / "docs" / "figures" / "plain_differentiation.png"
TOLERANCE = 1e-8
"""Relative, of diffrax."""
STEP = 1e-6
"""Of the differences, in the logarithm of a parameter."""
SHOWN = ("natural frequency", "mass", "damping ratio")
PLAIN, BLACK, OURS = "#D55E00", "black", "#0072B2"


class Derivatives(NamedTuple):
    """d x_e / d log p [um], each of shape (samples, parameters)."""

    plain: np.ndarray
    ours: np.ndarray
    differences: np.ndarray


def derivatives(problem: Problem) -> Derivatives:
    """Of the parameters `NAMES`, at the samples of the `problem`."""
    values = jax.jit(lambda p: effector(p, problem, TIGHT))
    usual = lambda q: effector(PARAMETERS * jnp.exp(q), problem, Accuracy())
    tsit5 = PEERS[0].jacobian(problem)
    return Derivatives(
        plain=np.asarray(tsit5.run(PARAMETERS, TOLERANCE)),
        ours=np.asarray(jax.jit(jax.jacfwd(usual))(jnp.zeros(len(NAMES)))),
        differences=central_differences(values, PARAMETERS, STEP),
    )


def draw(problem: Problem, found: Derivatives) -> Figure:
    """A panel for each parameter in `SHOWN`."""
    figure = Figure(figsize=(9.6, 3.4), layout="constrained")
    every = slice(None, None, 6)
    wrong = column_errors(found.plain, found.differences)
    for axes, name in zip(figure.subplots(1, len(SHOWN)), SHOWN, strict=True):
        i = NAMES.index(name)
        axes.plot(problem.times, found.plain[:, i], color=PLAIN, label="diffrax's Tsit5, differentiated")
        axes.plot(problem.times, found.ours[:, i], color=OURS, label="pdssjax")
        differences = found.differences[every, i]
        axes.plot(problem.times[every], differences, ".", color=BLACK, markersize=4, label="central differences")
        axes.set_title(f"{name}: {100.0 * wrong[i]:.0f} % off", fontsize=10)
        axes.set_xlabel("time [s]")
        axes.spines[["top", "right"]].set_visible(False)
    figure.axes[0].set_ylabel("d x_e / d log p [um]")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False)
    return figure


def main() -> int:
    """Draw the figure, and print the errors of all columns."""
    prepare_jax(dedicated=True)
    problem = Problem(cycles=3, samples=301)
    found = derivatives(problem)
    print("| parameter | diffrax's Tsit5 | pdssjax |\n|---|--:|--:|")
    wrong = (column_errors(each, found.differences) for each in (found.plain, found.ours))
    for name, plain, ours in zip(NAMES, *wrong, strict=True):
        print(f"| {name} | {plain:.1e} | {ours:.1e} |")
    draw(problem, found).savefig(FIGURE, dpi=150)
    print(f"Figure: {FIGURE}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
