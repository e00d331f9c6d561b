"""A plan as a page, and as a piece of one: what to measure, where samples go, the expected errors, what to do next."""

import html

from ...design import Plan
from ..text import CONTRIBUTES, ERROR_HEAD, RECORD_HEAD, error_rows, plan_summary, record_row, sampling_words
from .document import Illustration, Page, Section, Table, table_html


def record_table(plan: Plan) -> Table:
    """The records, one a row."""
    return Table(RECORD_HEAD, [record_row(planned) for planned in plan.records], "<>>><<>", CONTRIBUTES)


def error_table(plan: Plan) -> Table:
    """The expected errors, one parameter a row."""
    return Table(ERROR_HEAD, error_rows(plan), "<>>>>", "Standard errors, in per cent of the value.")


def plan_html(plan: Plan) -> str:
    """The plan in short, as a piece of HTML."""
    head = f"<p>{html.escape(plan_summary(plan))}</p>"
    return "\n".join([head, table_html(record_table(plan)), table_html(error_table(plan))])


def plan_page(plan: Plan) -> Page:
    """The page of a plan."""
    from ..figures import design_figure  # which loads matplotlib

    errors = [error_table(plan)]
    caption = "Expected errors, and where the samples of each record lie within a cycle of its drive."
    placed = [f"{planned.name}: {sampling_words(planned)}" for planned in plan.records]
    steps = [
        "pdssjax record plan.toml --out virtual",
        "pdssjax identify plan.toml --out identified",
        "pdssjax design . --out next",
    ]
    return Page(
        f"Next records: {plan.study.title}",
        [
            Section("In short", text=[plan_summary(plan)], points=list(plan.notes)),
            Section("Records", tables=[record_table(plan)], points=placed),
            Section("Expected errors", tables=errors, figures=[Illustration(design_figure(plan), caption)]),
            Section(
                "What to do with it",
                text=[
                    "The folder has a drive file for each record (drives), a template of what is to be measured "
                    "(templates), and a study (plan.toml) whose files belong into the folder measured."
                ],
                lines=steps,
            ),
        ],
    )
