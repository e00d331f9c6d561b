"""Figures of what an estimate says of its parameters: errors, correlations, amplification, ways side by side."""

from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import SymLogNorm
from matplotlib.figure import Figure

from ...inference import half_width_95
from ...study import NEGLIGIBLE_AMPLIFICATION, Amplification, Estimate, FittedParameter
from ._style import BLUE, GREEN, GREY, VERMILION, styled_figure
from .intervals import draws_figure, multistart_figure, profile_figure


def parameter_figures(estimate: Estimate) -> dict[str, Callable[[], Figure]]:
    """What an estimate has figures of beside its records, by name; each is drawn when it is called."""
    figures: dict[str, Callable[[], Figure]] = {"errors": lambda: error_figure(estimate)}
    if len(estimate.names) > 1:
        figures["correlations"] = lambda: correlation_figure(estimate)
    if estimate.profiles:
        figures["profiles"] = lambda: profile_figure(estimate.profiles, estimate.parameters)
    if estimate.draws is not None:
        figures["draws"] = lambda: draws_figure(estimate)
    if (starts := estimate.multistart) is not None:
        figures["starts"] = lambda: multistart_figure(starts)
    if (amplification := estimate.amplification) is not None:
        figures["amplification"] = lambda: amplification_figure(amplification)
    return figures


def error_figure(estimate: Estimate) -> Figure:
    """Standard errors in per cent of the values, by every error model; of a sequential fit also the naive ones."""
    known = [p for p in estimate.parameters.values() if p.free and p.value and np.isfinite(p.standard_error)]
    rows = range(len(known))
    with styled_figure(5.6, 1.6 + 0.28 * len(known)) as figure:
        axes = figure.subplots()
        models = list(next((p.errors for p in known if p.errors), {}))
        label = f"standard error ({models[0]})" if models else "standard error"
        axes.plot([_percent(p, p.standard_error) for p in known], rows, "o", color=BLUE, label=label)
        for model, (mark, colour) in zip(models[1:], (("s", GREY), ("|", "black")), strict=False):
            errors = [_percent(p, p.errors[model].standard_error) if p.errors else np.nan for p in known]
            axes.plot(errors, rows, mark, color=colour, fillstyle="none", markersize=9, label=model.replace("-", " "))
        if any(p.naive_standard_error for p in known):
            naive = [_percent(p, p.naive_standard_error or np.nan) for p in known]
            axes.plot(naive, rows, "D", color=VERMILION, fillstyle="none", label="naive standard error")
        if len(axes.lines) > 1:
            # Beside the rows: on one of them a key would be taken for an error.
            figure.legend(loc="outside upper right", ncols=3)
        axes.set_xscale("log")
        axes.set_yticks(rows, [p.path for p in known])
        axes.invert_yaxis()
        axes.grid(axis="both", color="0.9")
        axes.set_axisbelow(True)
        axes.set_xlabel("standard error (% of the value)")
    return figure


def _percent(parameter: FittedParameter, error: float) -> float:
    return 100.0 * error / abs(parameter.value)


def correlation_figure(estimate: Estimate) -> Figure:
    """The lower triangle of the correlation matrix; crosses where there is no information."""
    names, count = estimate.names, len(estimate.names)
    shown = np.where(np.tri(count, k=-1, dtype=bool), estimate.correlation, np.nan)[1:, :-1]
    with styled_figure(2.6 + 0.5 * count, 1.6 + 0.45 * count) as figure:
        axes = figure.subplots()
        image = axes.imshow(shown, vmin=-1.0, vmax=1.0, cmap="RdBu_r", aspect="auto")
        axes.set_xticks(range(count - 1), names[:-1], rotation=40, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(count - 1), names[1:])
        for row in range(count - 1):
            for column in range(row + 1):
                value = shown[row, column]
                label = f"{value:.2f}" if np.isfinite(value) else "×"
                colour = "white" if abs(value) > 0.6 else "black"
                axes.text(column, row, label, ha="center", va="center", fontsize=7.5, color=colour)
        blank = "" if np.isfinite(estimate.correlation).all() else " (×: no information)"
        axes.set_title(f"Correlations of the estimates{blank}", loc="left")
        figure.colorbar(image, ax=axes, label="correlation", shrink=0.8)
    return figure


def amplification_figure(amplification: Amplification) -> Figure:
    """The matrix as colours and numbers: per cent in the row for 1 % in the column."""
    amplification = amplification.visible()
    matrix = amplification.matrix
    rows, columns = matrix.shape
    most = max(2.0, float(np.max(np.abs(matrix))))
    with styled_figure(3.4 + 0.9 * columns, 1.7 + 0.36 * rows) as figure:
        axes = figure.subplots()
        # Linear up to one per cent for one per cent: there an error is passed on, beyond it grows.
        scale = SymLogNorm(1.0, vmin=-most, vmax=most)
        image = axes.imshow(matrix, norm=scale, cmap="RdBu_r", aspect="auto")
        axes.set_xticks(range(columns), amplification.earlier, rotation=25, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(rows), amplification.later)
        for i in range(rows):
            for j in range(columns):
                dark = abs(float(scale(matrix[i, j])) - 0.5) > 0.3
                # 110, not 1.1e+02; 0, not -0.
                label = f"{float(f'{matrix[i, j]:.2g}') if abs(matrix[i, j]) >= NEGLIGIBLE_AMPLIFICATION else 0.0:g}"
                axes.text(j, i, label, ha="center", va="center", fontsize=7.5, color="white" if dark else "black")
        axes.set_title("Per cent in the row for 1 % in the column", loc="left")
        figure.colorbar(image, ax=axes, label="% for 1 %", shrink=0.9)
    return figure


def comparison_figure(estimates: Sequence[Estimate]) -> Figure:
    """Draw each method's estimate and 95 % interval, a panel per parameter, in per cent from the joint fit's value.

    The first of the `estimates` is the joint fit.  Thick: the interval with the errors of the earlier step; thin, with
    ends: that which takes them for exact.
    """
    first = estimates[0].parameters
    shown = [path for path in estimates[0].names if first[path].value and np.isfinite(first[path].standard_error)]
    rows = max(-(-len(shown) // 3), 1)
    with styled_figure(7.4, 0.9 + 1.15 * rows) as figure:
        panels = figure.subplots(rows, 3, squeeze=False, sharey=True).ravel()
        for axes, path in zip(panels, shown, strict=False):
            _draw_ways(axes, path, estimates)
        for axes in panels[len(shown) :]:
            axes.set_axis_off()
        for axes in panels[: len(shown)][-3:]:
            axes.set_xlabel("off the joint fit (%)")
        figure.suptitle(
            f"{estimates[0].title}\n95 % intervals: thick with the earlier step's errors, thin without (naive)",
            x=0.01,
            ha="left",
            fontsize=9.5,
            wrap=True,
        )
    return figure


def _naive_interval(found: FittedParameter) -> tuple[float, float]:
    """95 % interval by the naive error, on the same scale, linear or logarithmic, as that by the whole error."""
    naive, (low, high) = found.naive_standard_error or 0.0, found.interval
    whole = found.errors["white"].interval if "white" in found.errors else (low, high)
    naive *= float(half_width_95(found.degrees_of_freedom))
    is_positive = found.value > 0.0 and min(whole) > 0.0
    if is_positive and np.isclose(whole[0] * whole[1], found.value**2, rtol=1e-6):
        factor = float(np.exp(naive / found.value))
        return found.value / factor, found.value * factor
    return found.value - naive, found.value + naive


def _draw_ways(axes: Axes, path: str, estimates: Sequence[Estimate]) -> None:
    joint = estimates[0].parameters[path].value
    for place, (estimate, colour) in enumerate(zip(estimates, (BLUE, GREEN, VERMILION), strict=False)):
        found = estimate.parameters[path]
        off = 100.0 * (found.value / joint - 1.0)
        low, high = (100.0 * (end / joint - 1.0) for end in found.interval)
        axes.plot([low, high], [place, place], color=colour, alpha=0.35, linewidth=5.0, solid_capstyle="butt")
        if found.naive_standard_error is not None:
            ends = [100.0 * (end / joint - 1.0) for end in _naive_interval(found)]
            reach = np.abs(np.array(ends) - off)[:, None]
            axes.errorbar(off, place, xerr=reach, color=colour, linewidth=1.0, capsize=2.5)
        axes.plot(off, place, "o", color=colour, markersize=4.0)
    axes.axvline(0.0, color="0.6", linewidth=0.7, zorder=0)
    axes.set_yticks(range(len(estimates)), [estimate.method for estimate in estimates])
    axes.set_ylim(len(estimates) - 0.4, -0.6)
    axes.set_title(path, loc="left")
