"""What shows results in a notebook: `pdssjax.core.presenter()` is this module, by its name (`pdssjax/__init__.py`).

As HTML a result has its numbers with units, as in the report; all that comes from outside is escaped.
"""

import html
import math
import os
import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..core import Figure, InputError, display_unit, draw_in_notebook, member_name, rounded
from ..design import Plan
from ..selection import Comparison
from ..simulation import TRAJECTORY_UNITS, Trajectory
from ..study import Estimate, FittedParameter, FittedRecord, Parameter, Study
from .page import Table, plan_html, table_html
from .text import parameter_cells, selection_sentences


def as_html(shown: object) -> str:
    """A result as a piece of HTML."""
    ways: dict[type, Callable[[Any], str]] = {
        Estimate: _estimate_html,
        Study: _study_html,
        Trajectory: _trajectory_html,
        Plan: plan_html,
        Comparison: _comparison_html,
    }
    for kind, html_of in ways.items():
        if isinstance(shown, kind):
            return html_of(shown)
    raise TypeError(f"Argument `shown` must be a result, but it is a {type(shown).__name__}")


def as_figure(shown: object, what: str | None = None) -> Figure:
    """A result as a figure; **raises** `InputError` for a `what` that it does not have."""
    from . import figures

    match shown:
        case Estimate():
            figure = _estimate_figure(shown, what)
        case Study():
            figure = figures.study_figure(shown)
        case Trajectory():
            figure = figures.trajectory_figure(shown)
        case Plan():
            figure = figures.design_figure(shown)
        case Comparison():
            figure = _comparison_figure(shown, what)
        case _:
            figure = figures.sweep_figure(shown)  # pyright: ignore[reportArgumentType]
    draw_in_notebook(type(figure))
    return figure


def _estimate_figure(estimate: Estimate, what: str | None) -> Figure:
    from .figures import estimate_figure, parameter_figures, record_figure

    if what is None:
        return estimate_figure(estimate)
    known = parameter_figures(estimate)
    known |= {record.name: lambda record=record: record_figure(record) for record in estimate.records}
    if what not in known:
        raise InputError(f'plot: found "{what}", expected one of {", ".join(known)}.')
    return known[what]()


def write_report(shown: object, path: str | os.PathLike[str], overwrite: bool) -> None:
    """Write a result into one HTML file; **raises** `InputError` as `write_page` does."""
    from .page import comparison_page, estimate_page, write_page

    if not isinstance(shown, Comparison | Estimate):
        raise TypeError(f"Argument `shown` must be an estimate or a comparison, but it is a {type(shown).__name__}")
    page = comparison_page(shown) if isinstance(shown, Comparison) else estimate_page(shown)
    write_page(path, page, overwrite=overwrite)


def _table(align: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows below a head; `align` holds "<" or ">" for each column."""
    return table_html(Table(list(map(_units, head)), [list(map(_units, row)) for row in rows], align))


def _paragraph(strong: str, text: str) -> str:
    """A paragraph of one line, what matters most of it in bold."""
    return f"<p><strong>{html.escape(strong)}</strong> {html.escape(_units(text))}".rstrip() + "</p>"


def _folded(title: str, lines: Sequence[str]) -> str:
    """Lines that open at a click; nothing where there are none."""
    if not lines:
        return ""
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<details><summary>{html.escape(title)} ({len(lines)})</summary><ul>{items}</ul></details>"


def _units(text: str) -> str:
    """Micro as a letter of its own, since HTML is no terminal."""
    return re.sub(r"\bum\b", "µm", text)


def _estimate_html(estimate: Estimate) -> str:
    """The tables of the report, and its notes folded."""
    verdict = estimate.verdict if estimate.success else estimate.verdict.upper()
    known = not estimate.statistics.noise_estimated
    chi2 = f", reduced chi-square {estimate.statistics.reduced_chi2:.5g}" if known else ""
    more = "" if estimate.explained else f"; {estimate.why_unexplained}, see the notes"
    parts = [
        _paragraph(estimate.title, f"{estimate.method} fit {verdict}: {estimate.message}{chi2}{more}"),
        _table(
            "<>>><<<",
            ["parameter", "value", "+/-", "", "unit", "95 % interval", ""],
            list(map(_fitted_parameter, estimate.parameters.values())),
        ),
        _table(
            "<<>>>>><",
            ["record", "role", "samples", "r2", "rmse", "noise", "chi2/n", "unit"],
            list(map(_fitted_record, estimate.records)),
        ),
        _folded("Notes", estimate.notes),
    ]
    return "\n".join(filter(None, parts))


def _fitted_parameter(parameter: FittedParameter) -> list[str]:
    cells, free = parameter_cells(parameter), parameter.free
    return [
        parameter.path,
        cells.value,
        cells.error if free else "",
        cells.share if free else "",
        cells.unit,
        f"{cells.low} .. {cells.high}" if free and parameter.identifiable else "",
        parameter.remark,
    ]


def _fitted_record(record: FittedRecord) -> list[str]:
    scale, places = record.display.scale, record.display.decimals(record.rmse, record.noise)
    return [
        record.name,
        "fitted" if record.role == "fit" else "validation",
        str(record.samples),
        rounded(record.r2, 7),
        rounded(record.rmse * scale, places),
        rounded(record.noise * scale, places) + (" (found)" if record.noise_estimated else ""),
        rounded(record.reduced_chi2, 3),
        record.display.unit if record.simulated else "simulation failed",
    ]


def _study_html(study: Study) -> str:
    """A study as HTML: its models, parameters and records."""
    reading = f" ({study.friction_state} state)" if study.friction.__name__.startswith("Anisotropic") else ""
    feedback = ", with friction feedback" if study.feedback else ""
    resting = ", at rest under its load from the beginning" if study.rests_under_load else ""
    models = f"piezo: {member_name(study.piezo)}, friction: {member_name(study.friction)}{reading}{feedback}{resting}"
    record_cells = lambda record: [
        *(record.name, record.measures, record.role, record.excitation, str(record.time.size)),
        *(f"{record.time[at]:.4g}" for at in (0, -1)),
    ]
    parts = [
        _paragraph(study.title, models),
        _table(
            "<<><<",
            ["parameter", "", "number", "unit", "bounds given"],
            list(map(_study_parameter, study.parameters.values())),
        ),
        _table(
            "<<<<>>>",
            ["record", "measures", "role", "drive", "samples", "from (s)", "to (s)"],
            list(map(record_cells, study.records)),
        ),
    ]
    return "\n".join(parts)


def _study_parameter(parameter: Parameter) -> list[str]:
    unit, scale = display_unit(parameter.unit)
    number = "found in the data" if parameter.number is None else f"{parameter.number * scale:.6g}"
    given = [end for end in (parameter.low, parameter.high) if end is not None]
    low, high = (math.nan if end is None else end * scale for end in (parameter.low, parameter.high))
    bounds = f"{low:.4g} .. {high:.4g}".replace("nan", "") if given else ""
    kind = "free" if parameter.free else "fixed"
    if parameter.measured_apart is not None:
        kind, number = "measured apart", f"{number} +/- {parameter.measured_apart[1] * scale:.2g}"
    return [parameter.path, kind, number, unit, bounds]


def _trajectory_html(run: Trajectory) -> str:
    """The least, the greatest and the last value of every channel, with its unit."""
    if np.ndim(run.time) != 1:
        return _paragraph("Trajectory", f"of arrays of shape {np.shape(run.effector)}")
    rows = []
    for name, unit in TRAJECTORY_UNITS.items():
        shown, scale = display_unit(unit)
        values = scale * np.asarray(getattr(run, name))
        rows.append([name, *(f"{number:.5g}" for number in (values.min(), values.max(), values[-1])), shown])
    outcome = run.message or f"{int(run.steps)} steps, {int(run.events)} switches of the mode"
    head = ["", "least", "greatest", "last", "unit"]
    return f"{_paragraph(f'Trajectory of {np.size(run.time)} samples', outcome)}\n{_table('<>>><', head, rows)}"


def _comparison_html(found: Comparison) -> str:
    """The answer and the table of models."""
    words = selection_sentences(found)
    first, *others = words.answer
    table = table_html(Table(words.head, words.rows, "<>>>>>><"))
    parts = [_paragraph(found.title, first), table, *(_paragraph("", text) for text in others)]
    return "\n".join([*parts, _folded("What each other model leaves", words.lacks)]).strip()


def _comparison_figure(found: Comparison, what: str | None) -> Figure:
    from .figures import residual_strips_figure, selection_figure

    if what not in (None, "residuals"):
        raise InputError(f'plot: found "{what}", expected "residuals" or nothing.')
    if not found.chosen:
        raise InputError("plot: found no model with a fit, expected one at least.")
    return selection_figure(found) if what is None else residual_strips_figure(found)
