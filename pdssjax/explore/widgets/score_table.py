"""How well every record is predicted at the numbers of the sliders: a table below the plots."""

import html
import math
from collections.abc import Mapping, Sequence

import panel as pn

from ...core import decimals_for, rounded
from ...study import Record
from ..redraw import Score
from .style import CUT, TABLE, Widget

_POOR = 1.5
"""Chi-square a degree of freedom from which on it stands out."""


class ScoreTable:
    """A row a record."""

    def __init__(self, records: Sequence[Record]):
        self._records = records
        self.view: Widget = pn.pane.HTML(
            "", stylesheets=[TABLE, CUT], sizing_mode="stretch_width", margin=(2, 0, 0, 8), css_classes=["scores"]
        )

    def show(self, scores: Mapping[str, Score], chosen: str, stale: bool) -> None:
        """Shows the `scores` known, by record; those of other records than the `chosen` one may be `stale`."""
        head = "".join(
            f"<th{_side(i)}>{text}</th>"
            for i, text in enumerate(["record", "measures", "role", "chi-square / n", "rmse", "noise", "offset"])
        )
        rows = "".join(self._row(r, scores.get(r.name), chosen, stale and r.name != chosen) for r in self._records)
        self.view.object = f"<table><tr>{head}</tr>{rows}</table>"

    def _row(self, record: Record, score: Score | None, chosen: str, stale: bool) -> str:
        name = html.escape(record.name)
        cells = [
            f'<span class="cut" title="{name}">{name}</span>',
            record.measures,
            "fitted" if record.role == "fit" else "validation",
        ]
        poor = ""
        if score is None:
            cells += ["…", "", "", ""]
        else:
            display = record.measurement.display
            unit = display.unit.replace("um", "µm")
            places = decimals_for(0.1 * score.noise * display.scale)
            amount = lambda number: f"{rounded(number * display.scale, places)} {unit}"
            chi2 = f"{score.chi2:.4g}" if math.isfinite(score.chi2) else "simulation failed"
            cells += [chi2, amount(score.rmse), amount(score.noise), amount(score.offset)]
            cells[5] += "" if score.noise_given else " (seen)"
            poor = " poor" if not score.chi2 < _POOR else ""
        grey = ' style="color:#999"' if stale else ""
        told = "".join(f"<td{_side(i, poor if i == 3 else '')}{grey}>{cell}</td>" for i, cell in enumerate(cells))
        return f"<tr{' class=chosen' if record.name == chosen else ''}>{told}</tr>"


def _side(column: int, more: str = "") -> str:
    return f' class="number{more}"' if column > 2 else ""
