"""Figures of how far parameters may lie from their estimates: profiles, draws, and the optima of many starts."""

from collections.abc import Mapping, Sequence

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from ...core import InputError, display_unit, with_micro_sign
from ...study import Estimate, FittedParameter, Multistart, Profile
from ._style import BLUE, GREY, VERMILION, styled_figure


def profile_figure(profiles: Sequence[Profile], parameters: Mapping[str, FittedParameter]) -> Figure:
    """Small multiples, one a parameter: the curve, the linear model's parabola, and the level of the 95 % interval."""
    columns = min(3, len(profiles))
    rows = -(-len(profiles) // columns)
    with styled_figure(0.6 + 2.6 * columns, 0.7 + 1.9 * rows) as figure:
        grid = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
        for axes, profile in zip(grid, profiles, strict=False):
            _draw_profile(axes, profile, parameters[profile.path])
        for axes in grid[len(profiles) :]:
            axes.set_visible(False)
        for axes in grid[::columns]:
            axes.set_ylabel("excess of chi-square")
        handles, labels = grid[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4 if columns > 2 else columns)
    return figure


def _draw_profile(axes: Axes, profile: Profile, parameter: FittedParameter) -> None:
    unit, factor = display_unit(parameter.unit)
    value = factor * profile.value
    axes.plot(value, profile.linear, color=GREY, linestyle="--", linewidth=1.0, label="linear model")
    axes.plot(value, profile.excess, color=BLUE, linewidth=1.3, label="minimised over the others")
    computed = profile.computed
    axes.plot(value[computed], profile.excess[computed], "o", color=BLUE, markersize=3.0, label="computed")
    axes.axhline(profile.threshold, color=VERMILION, linewidth=0.8, label="95 %")
    axes.axvline(factor * parameter.value, color=GREY, linewidth=0.5)
    axes.set_ylim(0.0, 1.4 * profile.threshold)
    axes.set_title(f"{profile.path}\n{profile.verdict}", loc="left")
    axes.set_xlabel(f"[{with_micro_sign(unit)}]" if unit else "[-]")
    axes.locator_params(axis="x", nbins=3)


def draws_figure(estimate: Estimate) -> Figure:
    """Histograms on the diagonal, draws of two parameters below it; both beside the linear model.

    Of more than twelve parameters only the least certain are shown.

    **Raises:** `InputError` where the estimate has no draws.
    """
    draws = estimate.draws
    if draws is None:
        raise InputError("plot: found an estimate without draws, expected one of a bootstrap or a posterior.")
    spread = {of.path: of.deviation / max(abs(of.mean), 1e-300) for of in draws.parameters if of.deviation > 0}
    least_certain = sorted(spread, key=lambda path: spread[path], reverse=True)[:12]
    paths = [path for path in draws.names if path in least_certain]
    size = len(paths)
    chains, each = draws.values.shape[:2]
    count = f"{each} draws" if chains == 1 else f"{chains} chains of {each} draws"
    with (
        styled_figure(1.0 + 1.35 * max(size, 2), 0.6 + 1.35 * size) as figure,
        matplotlib.rc_context({"font.size": 7.0, "axes.titlesize": 7.0}),
    ):
        grid: list[list[Axes]] = figure.subplots(size, size, squeeze=False).tolist()
        drawn = lambda path: _factor(estimate, path) * draws.values[:, :, draws.names.index(path)].ravel()
        values = {path: drawn(path) for path in paths}
        for row, column in np.ndindex(size, size):
            axes, name = grid[row][column], paths[column]
            if row < column:
                axes.set_visible(False)
                continue
            axes.locator_params(nbins=3)
            axes.tick_params(labelbottom=row == size - 1, labelleft=0 < row != column and column == 0)
            if row == column:
                _draw_one(axes, estimate, name, values[name])
            else:
                _draw_two(axes, estimate, (name, paths[row]), (values[name], values[paths[row]]))
            if row == size - 1:
                axes.set_xlabel(_label(estimate, name))
                axes.tick_params(axis="x", labelrotation=45.0)
            if column == 0 and row > 0:
                axes.set_ylabel(_label(estimate, paths[row]))
        # Where the upper right corner holds no panel, and beside the only one.
        place = "upper right" if size > 1 else "outside right upper"
        figure.legend(*grid[0][0].get_legend_handles_labels(), loc=place, title=f"{draws.kind}: {count}")
    return figure


def _draw_one(axes: Axes, estimate: Estimate, path: str, values: Float[np.ndarray, " draws"]) -> None:
    parameter, factor = estimate.parameters[path], _factor(estimate, path)
    axes.hist(values, bins="auto", density=True, color=BLUE, alpha=0.35, label="draws")
    at = np.linspace(*axes.get_xlim(), 200)
    error = factor * parameter.standard_error
    if np.isfinite(error) and error > 0.0:
        height = np.exp(-0.5 * ((at - factor * parameter.value) / error) ** 2) / (np.sqrt(2.0 * np.pi) * error)
        axes.plot(at, height, color=GREY, linestyle="--", linewidth=0.9, label="linear model")
    for number, end in enumerate(parameter.interval):
        axes.axvline(factor * end, color=VERMILION, linewidth=0.8, label=None if number else "95 % interval")
    axes.axvline(factor * parameter.value, color="black", linewidth=0.8, label="estimate")
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_title(path.replace(".", "\n"), loc="left")


def _draw_two(
    axes: Axes,
    estimate: Estimate,
    paths: tuple[str, str],
    values: tuple[Float[np.ndarray, " draws"], Float[np.ndarray, " draws"]],
) -> None:
    every = max(1, values[0].size // 2000)
    axes.plot(values[0][::every], values[1][::every], ".", color=BLUE, markersize=1.0, alpha=0.4, rasterized=True)
    places = [estimate.names.index(path) for path in paths]
    factors = np.array([_factor(estimate, path) for path in paths])
    centre = factors * np.array([estimate.parameters[path].value for path in paths])
    covariance = np.outer(factors, factors) * estimate.covariance[np.ix_(places, places)]
    if np.isfinite(covariance).all() and np.linalg.det(covariance) > 0.0:
        turn = np.linspace(0.0, 2.0 * np.pi, 100)
        # Half axes, in standard deviations, that hold 95 % of a bivariate normal distribution.
        ring = np.linalg.cholesky(covariance) @ np.stack([np.cos(turn), np.sin(turn)]) * np.sqrt(-2.0 * np.log(0.05))
        axes.plot(centre[0] + ring[0], centre[1] + ring[1], color=GREY, linestyle="--", linewidth=0.9)
    axes.plot(*centre, "+", color="black", markersize=5.0)


def _factor(estimate: Estimate, path: str) -> float:
    return display_unit(estimate.parameters[path].unit)[1]


def _label(estimate: Estimate, path: str) -> str:
    unit = with_micro_sign(display_unit(estimate.parameters[path].unit)[0])
    return f"{path.split('.', 1)[-1]}\n[{unit or '-'}]"


_OTHERS = VERMILION, "#009E73", "#CC79A7", "#56B4E9", "#E69F00"
"""Colours of the optima after the best; from the palette of Okabe and Ito."""


def multistart_figure(multistart: Multistart) -> Figure:
    """The waterfall above; below, every parameter over that of the best optimum."""
    with styled_figure(6.4, 3.4 + 0.26 * len(multistart.names)) as figure:
        heights = [2.0, 0.6 + 0.26 * len(multistart.names)]
        above, below = figure.subplots(2, 1, gridspec_kw={"height_ratios": heights})
        _waterfall(above, multistart)
        _optima(below, multistart)
    return figure


def _colour(number: int) -> str:
    return GREY if number < 0 else BLUE if number == 0 else _OTHERS[(number - 1) % len(_OTHERS)]


def _waterfall(axes: Axes, multistart: Multistart) -> None:
    known = np.isfinite(multistart.chi2)
    rank, least = np.arange(1, multistart.chi2.size + 1), float(np.min(multistart.chi2))
    excess = np.maximum(multistart.chi2 - least, 1e-3)  # the axis is logarithmic
    axes.plot(rank[known], excess[known], color="0.85", linewidth=0.8, zorder=0)
    for number in range(-1, multistart.distinct):
        at = known & (multistart.optimum == number)
        name = "not converged" if number < 0 else f"optimum {number + 1}" if number < len(_OTHERS) else None
        marker = "x" if number < 0 else "o"
        if at.any():
            axes.plot(rank[at], excess[at], marker, color=_colour(number), markersize=4.0, label=name)
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0.0, multistart.chi2.size + 1.0)
    axes.set_ylabel("chi-square above the lowest")
    failed = int(np.sum(~known))
    axes.set_xlabel("start, sorted" + (f" ({failed} could not be simulated)" if failed else ""))
    axes.legend(loc="upper left")


def _optima(axes: Axes, multistart: Multistart) -> None:
    """Draw the parameters of the optima relative to the best one, on a scale that is linear within one per cent."""
    rows = np.arange(len(multistart.names))
    firsts = [int(np.flatnonzero(multistart.optimum == n)[0]) for n in range(min(multistart.distinct, 12))]
    best = multistart.ends[firsts[0] if firsts else 0]
    scale = np.where(best == 0.0, 1.0, np.abs(best))
    spread = [multistart.ranges.get(path, (np.nan, np.nan)) for path in multistart.names]
    low, high = (100.0 * (np.array(ends) - best) / scale for ends in zip(*spread, strict=True))
    axes.hlines(rows, low, high, color="0.85", linewidth=5.0, label="range of the starts")
    for first in reversed(firsts):
        number = int(multistart.optimum[first])
        change = 100.0 * (multistart.ends[first] - best) / scale
        axes.plot(change, rows, "o-", color=_colour(number), markersize=3.5, linewidth=0.8)
    axes.set_xscale("symlog", linthresh=1.0)
    axes.set_yticks(rows, multistart.names)
    axes.invert_yaxis()
    axes.grid(axis="x", color="0.9")
    axes.set_axisbelow(True)
    axes.set_xlabel("from the best optimum (% of its value)")
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0))
