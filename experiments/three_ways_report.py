"""Table and figure of the Monte Carlo over three ways of identification (`three_ways`)."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from experiments.common import BLUE, GREEN, VERMILION
from experiments.three_ways import WAYS

COLOURS: dict[str, str] = dict(zip(WAYS, (BLUE, GREEN, VERMILION), strict=True))
INSIDE = 1.959964
"""Half width of a 95 % interval in standard errors."""


@dataclasses.dataclass(frozen=True)
class Cell:
    """One way in one scenario; relative, of the truth."""

    scenario: str
    way: str
    error: Float[np.ndarray, "draws p"]
    carried: Float[np.ndarray, "draws p"]
    """What the amplification matrix makes of the stack's errors; those themselves in the stack's places."""
    said: Float[np.ndarray, "draws p"]
    """Standard errors that the way gives, the earlier step's errors carried on."""
    naive: Float[np.ndarray, "draws p"]
    converged: Bool[np.ndarray, " draws"]

    @property
    def bias(self) -> Float[np.ndarray, " p"]:
        """The median error."""
        return np.median(self.error, axis=0)

    @property
    def spread(self) -> Float[np.ndarray, " p"]:
        """Half of what lies between the 16th and the 84th percentile: one standard deviation of a normal."""
        low, high = np.percentile(self.error, [15.87, 84.13], axis=0)
        return 0.5 * (high - low)

    @property
    def whole(self) -> Float[np.ndarray, " p"]:
        """Bias and spread together."""
        return np.hypot(self.bias, self.spread)

    def covered(self, errors: Float[np.ndarray, "draws p"], at: Sequence[int]) -> float:
        """Share of 95 % intervals, of the parameters `at`, that hold the truth; symmetric on the logarithm."""
        with np.errstate(invalid="ignore"):
            return float(np.mean(np.abs(np.log1p(self.error[:, at])) < INSIDE * errors[:, at]))


def table(cells: Sequence[Cell], paths: Sequence[str]) -> str:
    """Markdown: bias, spread and standard errors of every friction parameter, in per cent."""
    friction = _friction(paths)
    head = ["step tests", "way", "frequency", "gain", *(_name(paths[i]) for i in friction), "95 % hold", "naive"]
    rate, gain = paths.index("piezo.natural_frequency"), paths.index("piezo.gain")
    lines = [
        "## Errors of the friction in per cent, three ways: bias ± spread (said | naive)",
        "",
        "| " + " | ".join(head) + " |",
        "|---|---|" + "--:|" * (len(head) - 2),
    ]
    for cell in cells:
        row = [cell.scenario, cell.way, *(f"{100 * cell.whole[i]:.2g}" for i in (rate, gain))]
        row += [_shown(cell, i) for i in friction]
        row += [f"{100 * cell.covered(errors, friction):.0f} %" for errors in (cell.said, cell.naive)]
        lines.append("| " + " | ".join(row) + " |")
    draws, unconverged = sum(c.converged.size for c in cells), sum(int(np.sum(~c.converged)) for c in cells)
    lines += [
        "",
        "Frequency and gain of the stack: bias and spread together. Said: the median of the standard errors that the "
        "way gives, of the fits in two steps with the stack's errors carried on (Murphy and Topel 1985); naive: "
        f"without them. Hold: 95 % intervals of the friction parameters that hold the truth. "
        f"{cells[0].converged.size} draws each, {unconverged} of {draws} fits did not say converged.",
    ]
    return "\n".join(lines)


def bias_table(cells: Sequence[Cell], paths: Sequence[str]) -> str:
    """Markdown: the bias of the fits in two steps, in per cent, beside that which the stack's errors explain."""
    friction = _friction(paths)
    lines = [
        "## Bias in per cent: found (amplification matrix times the stack's error)",
        "",
        "| step tests | way | " + " | ".join(_name(paths[i]) for i in friction) + " |",
        "|---|---|" + "--:|" * len(friction),
    ]
    for cell in cells:
        if cell.way != "joint":
            carried = np.median(cell.carried, axis=0)
            row = [f"{100 * cell.bias[i]:+.1f} ({100 * carried[i]:+.1f})" for i in friction]
            lines.append(f"| {cell.scenario} | {cell.way} | " + " | ".join(row) + " |")
    return "\n".join(lines)


def _shown(cell: Cell, i: int) -> str:
    said, naive = (100.0 * float(np.median(errors[:, i])) for errors in (cell.said, cell.naive))
    second = f" ({said:.2g})" if cell.way == "joint" else f" ({said:.2g} \\| {naive:.2g})"
    return f"{100 * cell.bias[i]:+.1f} ± {100 * cell.spread[i]:.2g}{second}"


def _friction(paths: Sequence[str]) -> list[int]:
    return [i for i, path in enumerate(paths) if path.startswith("friction.")]


def _name(path: str) -> str:
    return path.split(".")[1]


def draw(cells: Sequence[Cell], paths: Sequence[str]) -> Figure:
    """One panel a friction parameter: the error of every way in every scenario, and what the way says of itself."""
    scenarios = list(dict.fromkeys(cell.scenario for cell in cells))
    figure = Figure(figsize=(9.6, 7.6), layout="constrained")
    panels = figure.subplots(2, 3, sharey=True, sharex=True)
    for axes, i in zip(panels.ravel(), _friction(paths), strict=True):
        for cell in cells:
            _mark(axes, cell, i, scenarios.index(cell.scenario) + 0.25 * (WAYS.index(cell.way) - 1))
        axes.set_xscale("log")
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_title(_name(paths[i]), loc="left")
        axes.set_yticks(range(len(scenarios)), scenarios)
        for line in range(1, len(scenarios)):
            axes.axhline(line - 0.5, color="0.85", linewidth=0.6)
        axes.grid(visible=False, axis="y")
    panels[0, 0].set_ylim(len(scenarios) - 0.5, -0.5)
    for axes in panels[1]:
        axes.set_xlabel("error (% of the truth)")
    axes = panels[0, 0]
    for way in WAYS:
        axes.plot([], [], "o", color=COLOURS[way], label=way)
    axes.plot([], [], "|", color="0.2", markersize=9, markeredgewidth=2, label="said, stack's errors carried on")
    axes.plot([], [], "x", color="0.2", markersize=5, label="said, stack taken for exact (naive)")
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    figure.suptitle(
        "What is wrong with the friction (dots: bias and spread over the draws) and what the fit says of it",
        fontsize=10,
    )
    return figure


def _mark(axes: Axes, cell: Cell, i: int, height: float) -> None:
    colour = COLOURS[cell.way]
    said, naive = (100.0 * float(np.median(errors[:, i])) for errors in (cell.said, cell.naive))
    axes.plot(100.0 * cell.whole[i], height, "o", color=colour, markersize=5)
    axes.plot(said, height, "|", color=colour, markersize=9, markeredgewidth=2)
    if cell.way != "joint":
        axes.plot(naive, height, "x", color=colour, markersize=5)
