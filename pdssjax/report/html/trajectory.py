"""A trajectory as HTML: ranges of what moved, and how the run went."""

import numpy as np

from ...core import display_unit
from ...simulation import TRAJECTORY_UNITS, Trajectory
from ._layout import paragraph, table


def trajectory_html(run: Trajectory) -> str:
    """The least, the greatest and the last value of every channel, with its unit."""
    if np.ndim(run.time) != 1:
        return paragraph("Trajectory", f"of arrays of shape {np.shape(run.effector)}")
    rows = []
    for name, unit in TRAJECTORY_UNITS.items():
        shown, scale = display_unit(unit)
        values = scale * np.asarray(getattr(run, name))
        rows.append([name, *(f"{number:.5g}" for number in (values.min(), values.max(), values[-1])), shown])
    outcome = run.message or f"{int(run.steps)} steps, {int(run.events)} switches of the mode"
    return "\n".join(
        [
            paragraph(f"Trajectory of {np.size(run.time)} samples", outcome),
            table("<>>><", ["", "least", "greatest", "last", "unit"], rows),
        ]
    )
