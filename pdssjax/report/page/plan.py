"""A plan as a page: what to measure, where samples go, the expected errors, and the commands that go on."""

from ...design import Plan
from ..figures import design_figure
from ..text import CONTRIBUTES, ERROR_HEAD, RECORD_HEAD, error_rows, plan_summary, record_row, sampling_words
from .document import Illustration, Page, Section, Table


def plan_page(plan: Plan) -> Page:
    """The page of a plan."""
    caption = "Expected errors, and where the samples of each record lie within a cycle of its drive."
    records = Table(RECORD_HEAD, [record_row(planned) for planned in plan.records], "<>>><<>", CONTRIBUTES)
    errors = Table(ERROR_HEAD, error_rows(plan), "<>>>>", "Standard errors, in per cent of the value.")
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
            Section("Records", tables=[records], points=placed),
            Section("Expected errors", tables=[errors], figures=[Illustration(design_figure(plan), caption)]),
            Section(
                "What to do with it",
                text=[
                    "The folder has a drive file for each record (drives), a template of what is to be measured "
                    "(templates), and a study (plan.toml) whose files belong into the folder measured."
                ],
                commands=steps,
            ),
        ],
    )
