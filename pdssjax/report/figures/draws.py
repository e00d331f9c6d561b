"""Figure of the draws of a bootstrap or a posterior: every parameter alone, and every two against each other."""

import matplotlib
import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...core import InputError, display_unit
from ...study import Draws, Estimate
from ._style import BLUE, GREY, STYLE, VERMILION

_MOST = 12
"""Parameters shown; of more, those that the draws tell least about."""

_POINTS = 2000
"""Draws shown of two parameters."""

_ELLIPSE = np.sqrt(-2.0 * np.log(0.05))
"""Half axes of what holds 95 % of a normal distribution of two numbers, in standard deviations."""

_SIZE = 1.35
"""Inches of a panel."""


def draws_figure(estimate: Estimate) -> Figure:
    """Histograms on the diagonal, draws of two parameters below it; both beside the linear model.

    **Raises:** `InputError` where the estimate has no draws.
    """
    if estimate.draws is None:
        raise InputError("plot: found an estimate without draws, expected one of a bootstrap or a posterior.")
    paths = _shown(estimate.draws)
    size = len(paths)
    with matplotlib.rc_context(STYLE), matplotlib.rc_context({"font.size": 7.0, "axes.titlesize": 7.0}):
        figure = Figure(figsize=(1.0 + _SIZE * max(size, 2), 0.6 + _SIZE * size), layout="constrained")
        grid: list[list[Axes]] = figure.subplots(size, size, squeeze=False).tolist()
        values = {path: _in_unit(estimate, path) for path in paths}
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
        figure.legend(*grid[0][0].get_legend_handles_labels(), loc=place, title=_caption(estimate.draws))
    return figure


def _shown(draws: Draws) -> list[str]:
    """Parameters that move, in their order."""
    told = {each.path: each.deviation / max(abs(each.mean), 1e-300) for each in draws.parameters if each.deviation > 0}
    least = sorted(told, key=lambda path: told[path], reverse=True)[:_MOST]
    return [path for path in draws.names if path in least]


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
    every = max(1, values[0].size // _POINTS)
    axes.plot(values[0][::every], values[1][::every], ".", color=BLUE, markersize=1.0, alpha=0.4, rasterized=True)
    places = [estimate.names.index(path) for path in paths]
    factors = np.array([_factor(estimate, path) for path in paths])
    centre = factors * np.array([estimate.parameters[path].value for path in paths])
    covariance = np.outer(factors, factors) * estimate.covariance[np.ix_(places, places)]
    if np.isfinite(covariance).all() and np.linalg.det(covariance) > 0.0:
        turn = np.linspace(0.0, 2.0 * np.pi, 100)
        ring = np.linalg.cholesky(covariance) @ np.stack([np.cos(turn), np.sin(turn)]) * _ELLIPSE
        axes.plot(centre[0] + ring[0], centre[1] + ring[1], color=GREY, linestyle="--", linewidth=0.9)
    axes.plot(*centre, "+", color="black", markersize=5.0)


def _in_unit(estimate: Estimate, path: str) -> Float[np.ndarray, " draws"]:
    """All draws of a parameter in the unit shown."""
    assert estimate.draws is not None
    return _factor(estimate, path) * estimate.draws.values[:, :, estimate.draws.names.index(path)].ravel()


def _factor(estimate: Estimate, path: str) -> float:
    return display_unit(estimate.parameters[path].unit)[1]


def _label(estimate: Estimate, path: str) -> str:
    unit = display_unit(estimate.parameters[path].unit)[0].replace("um", "µm")
    return f"{path.split('.', 1)[-1]}\n[{unit or '-'}]"


def _caption(draws: Draws) -> str:
    chains, each = draws.values.shape[:2]
    count = f"{each} draws" if chains == 1 else f"{chains} chains of {each} draws"
    return f"{draws.kind}: {count}"
