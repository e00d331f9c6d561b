"""Figure of an estimate's relative standard errors."""

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ...study import Estimate, FittedParameter
from ._style import BLUE, STYLE, VERMILION


def error_figure(estimate: Estimate) -> Figure:
    """Standard errors in per cent of the values; of a sequential fit also the naive ones."""
    known = [p for p in estimate.parameters.values() if p.free and p.value and np.isfinite(p.standard_error)]
    rows = range(len(known))
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(5.6, 1.3 + 0.28 * len(known)), layout="constrained")
        axes = figure.subplots()
        axes.plot([_percent(p, p.standard_error) for p in known], rows, "o", color=BLUE, label="standard error")
        if any(p.naive_standard_error for p in known):
            naive = [_percent(p, p.naive_standard_error or np.nan) for p in known]
            axes.plot(naive, rows, "D", color=VERMILION, fillstyle="none", label="naive standard error")
            axes.legend(loc="best")
        axes.set_xscale("log")
        axes.set_yticks(rows, [p.path for p in known])
        axes.invert_yaxis()
        axes.grid(axis="both", color="0.9")
        axes.set_axisbelow(True)
        axes.set_xlabel("standard error (% of the value)")
    return figure


def _percent(parameter: FittedParameter, error: float) -> float:
    return 100.0 * error / abs(parameter.value)
