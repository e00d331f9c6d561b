"""Figure of an estimate's relative standard errors."""

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ...study import Estimate, FittedParameter
from ._style import BLUE, GREY, STYLE, VERMILION


def error_figure(estimate: Estimate) -> Figure:
    """Standard errors in per cent of the values, by every error model; of a sequential fit also the naive ones."""
    known = [p for p in estimate.parameters.values() if p.free and p.value and np.isfinite(p.standard_error)]
    rows = range(len(known))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.6, 1.6 + 0.28 * len(known)), layout="constrained")
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
