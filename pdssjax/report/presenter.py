"""What shows results in a notebook: `pdssjax.core.presenter()` is this module, by its name (`pdssjax/__init__.py`).

As HTML a result has its numbers with units, as in the report; all that comes from outside is escaped.
"""

import html
import math
import os
import re
from collections.abc import Sequence

import numpy as np

from ..core import Figure, InputError, display_unit, draw_in_notebook, member_name, rounded
from ..design import Plan
from ..selection import Comparison
from ..simulation import TRAJECTORY_UNITS, Trajectory
from ..study import Estimate, FittedParameter, FittedRecord, Parameter, Record, Study
from .page import Table, plan_html, table_html
from .text import parameter_cells, selection_sentences


def as_html(shown: object) -> str:
    """A result as a piece of HTML."""
    if isinstance(shown, Estimate):
        return estimate_html(shown)
    if isinstance(shown, Study):
        return study_html(shown)
    if isinstance(shown, Trajectory):
        return trajectory_html(shown)
    if isinstance(shown, Plan):
        return plan_html(shown)
    if isinstance(shown, Comparison):
        return comparison_html(shown)
    raise TypeError(f"Argument `shown` must be a result, but it is a {type(shown).__name__}")


def as_figure(shown: object, what: str | None = None) -> Figure:
    """A result as a figure; **raises** `InputError` for a `what` that it does not have."""
    figure = _figure(shown, what)
    draw_in_notebook(type(figure))
    return figure


def _figure(shown: object, what: str | None) -> Figure:
    from .figures import design_figure, study_figure, sweep_figure, trajectory_figure

    if isinstance(shown, Estimate):
        return _estimate_figure(shown, what)
    if isinstance(shown, Study):
        return study_figure(shown)
    if isinstance(shown, Trajectory):
        return trajectory_figure(shown)
    if isinstance(shown, Plan):
        return design_figure(shown)
    if isinstance(shown, Comparison):
        return _comparison_figure(shown, what)
    return sweep_figure(shown)  # pyright: ignore[reportArgumentType]


def _estimate_figure(estimate: Estimate, what: str | None) -> Figure:
    from .figures import (
        amplification_figure,
        correlation_figure,
        draws_figure,
        error_figure,
        estimate_figure,
        multistart_figure,
        profile_figure,
        record_figure,
    )

    known = {"errors": lambda: error_figure(estimate)}
    if len(estimate.names) > 1:
        known["correlations"] = lambda: correlation_figure(estimate)
    if estimate.profiles:
        known["profiles"] = lambda: profile_figure(estimate.profiles, estimate.parameters)
    if estimate.draws is not None:
        known["draws"] = lambda: draws_figure(estimate)
    if (starts := estimate.multistart) is not None:
        known["starts"] = lambda: multistart_figure(starts)
    if (amplification := estimate.amplification) is not None:
        known["amplification"] = lambda: amplification_figure(amplification)
    known |= {record.name: lambda record=record: record_figure(record) for record in estimate.records}
    if what is None:
        return estimate_figure(estimate)
    if what not in known:
        raise InputError(f'plot: found "{what}", expected one of {", ".join(known)}.')
    return known[what]()


def write_report(shown: object, path: str | os.PathLike[str], overwrite: bool) -> None:
    """Write a result into one HTML file; **raises** `InputError` as `write_page` does."""
    from .page import comparison_page, estimate_page, write_page

    if isinstance(shown, Comparison):
        write_page(path, comparison_page(shown), overwrite=overwrite)
    elif isinstance(shown, Estimate):
        write_page(path, estimate_page(shown), overwrite=overwrite)
    else:
        raise TypeError(f"Argument `shown` must be an estimate or a comparison, but it is a {type(shown).__name__}")


def _table(align: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows below a head; `align` holds "<" or ">" for each column."""
    return table_html(Table([units(cell) for cell in head], [[units(cell) for cell in row] for row in rows], align))


def paragraph(strong: str, text: str) -> str:
    """A paragraph of one line, what matters most of it in bold."""
    return f"<p><strong>{html.escape(strong)}</strong> {html.escape(units(text))}".rstrip() + "</p>"


def folded(title: str, lines: Sequence[str]) -> str:
    """Lines that open at a click; nothing where there are none."""
    if not lines:
        return ""
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<details><summary>{html.escape(title)} ({len(lines)})</summary><ul>{items}</ul></details>"


def units(text: str) -> str:
    """Micro as a letter of its own, since HTML is no terminal."""
    return re.sub(r"\bum\b", "µm", text)


def estimate_html(estimate: Estimate) -> str:
    """The tables of the report, and its notes folded."""
    parameters = list(estimate.parameters.values())
    parts = [
        paragraph(estimate.title, _outcome(estimate)),
        _table(
            "<>>><<<",
            ["parameter", "value", "+/-", "", "unit", "95 % interval", ""],
            [_fitted_parameter(parameter) for parameter in parameters],
        ),
        _table(
            "<<>>>>><",
            ["record", "role", "samples", "r2", "rmse", "noise", "chi2/n", "unit"],
            [_fitted_record(record) for record in estimate.records],
        ),
        folded("Notes", estimate.notes),
    ]
    return "\n".join(filter(None, parts))


def _outcome(estimate: Estimate) -> str:
    verdict = estimate.verdict if estimate.success else estimate.verdict.upper()
    known = not estimate.statistics.noise_estimated
    chi2 = f", reduced chi-square {estimate.statistics.reduced_chi2:.5g}" if known else ""
    more = "" if estimate.explained else f"; {estimate.why_unexplained}, see the notes"
    return f"{estimate.method} fit {verdict}: {estimate.message}{chi2}{more}"


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


def study_html(study: Study) -> str:
    """A study as HTML: its models, parameters and records."""
    reading = f" ({study.friction_state} state)" if study.friction.__name__.startswith("Anisotropic") else ""
    feedback = ", with friction feedback" if study.feedback else ""
    resting = ", at rest under its load from the beginning" if study.rests_under_load else ""
    models = f"piezo: {member_name(study.piezo)}, friction: {member_name(study.friction)}{reading}{feedback}{resting}"
    return "\n".join(
        [
            paragraph(study.title, models),
            _table(
                "<<><<",
                ["parameter", "", "number", "unit", "bounds given"],
                [_study_parameter(parameter) for parameter in study.parameters.values()],
            ),
            _table(
                "<<<<>>>",
                ["record", "measures", "role", "drive", "samples", "from (s)", "to (s)"],
                [_study_record(record) for record in study.records],
            ),
        ]
    )


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


def _study_record(record: Record) -> list[str]:
    ends = [f"{record.time[at]:.4g}" for at in (0, -1)]
    return [record.name, record.measures, record.role, record.excitation, str(record.time.size), *ends]


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
            _table("<>>><", ["", "least", "greatest", "last", "unit"], rows),
        ]
    )


def comparison_html(found: Comparison) -> str:
    """The answer and the table of models."""
    words = selection_sentences(found)
    first, *others = words.answer
    table = table_html(Table(words.head, words.rows, "<>>>>>><"))
    parts = [paragraph(found.title, first), table, *(paragraph("", text) for text in others)]
    return "\n".join([*parts, folded("What each other model leaves", words.lacks)]).strip()


def _comparison_figure(found: Comparison, what: str | None) -> Figure:
    from .figures import residual_strips_figure, selection_figure

    if what not in (None, "residuals"):
        raise InputError(f'plot: found "{what}", expected "residuals" or nothing.')
    if not found.chosen:
        raise InputError("plot: found no model with a fit, expected one at least.")
    return selection_figure(found) if what is None else residual_strips_figure(found)
