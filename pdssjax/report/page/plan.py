"""A plan as a page, and as a piece of one: what to measure, where samples go, the expected errors, what to do next."""

import html

from ...design import Plan
from ..text import CONTRIBUTES, ERROR_HEAD, RECORD_HEAD, error_rows, plan_summary, record_row, sampling_words
from .document import Illustration, Page, Section, Table, table_html


def _record_table(plan: Plan) -> Table:
    return Table(RECORD_HEAD, [record_row(planned) for planned in plan.records], "<>>><<>", CONTRIBUTES)


def _error_table(plan: Plan) -> Table:
    return Table(ERROR_HEAD, error_rows(plan), "<>>>>", "Standard errors, in per cent of the value.")


def plan_html(plan: Plan) -> str:
    """The plan in short, as a piece of HTML."""
    head = f"<p>{html.escape(plan_summary(plan))}</p>"
    return "\n".join([head, table_html(_record_table(plan)), table_html(_error_table(plan))])


def plan_page(plan: Plan) -> Page:
    """The page of a plan."""
    from ..figures import design_figure  # which loads matplotlib

    caption = "Expected errors, and where the samples of each record lie within a cycle of its drive."
    placed = [f"{planned.name}: {sampling_words(planned)}" for planned in plan.records]
    steps = [
        "pdssjax record plan.toml --out virtual",
        "pdssjax identify plan.toml --out identified",
        "pdssjax design . --out next",
    ]
    files = "The folder has a drive file for each record (drives), a template of what is to be measured (templates), "
    files += "and a study (plan.toml) whose files belong into the folder measured."
    drawn = [Illustration(design_figure(plan), caption)]
    sections = [
        Section("In short", text=[plan_summary(plan)], points=list(plan.notes)),
        Section("Records", tables=[_record_table(plan)], points=placed),
        Section("Expected errors", tables=[_error_table(plan)], figures=drawn),
        Section("What to do with it", text=[files], lines=steps),
    ]
    return Page(f"Next records: {plan.study.title}", sections)
