"""A plan of records as plain text: the records, where their samples go, and the expected errors before and after."""

import math

from ...core import display_unit, percent
from ...design import Plan, PlannedRecord, Rehearsal
from ._layout import aligned_table, heading, note


def format_design(plan: Plan) -> str:
    """The plan in words and tables."""
    text = heading(f"Next records: {plan.study.title}")
    text += note(plan_summary(plan)) + "\n"
    text += heading("Records") + aligned_table("<>>><<>", [RECORD_HEAD, *map(record_row, plan.records)])
    text += note(CONTRIBUTES) + "\n"
    text += heading("Where the samples go")
    for planned in plan.records:
        text += f"    {planned.name}: {sampling_words(planned)}\n"
    text += "\n" + heading("Expected standard errors") + aligned_table("<>>>>", [ERROR_HEAD, *error_rows(plan)])
    for sentence in plan.notes:
        text += note(sentence)
    return text


def plan_summary(plan: Plan) -> str:
    """The criterion of the plan, and the candidates it was chosen from."""
    rival = f" {plan.study.models.chosen['friction']} from {plan.rival}" if plan.rival else ""
    draws = "" if plan.draws == 1 else f", the mean over {plan.draws} sets of parameters"
    return (
        f'Criterion "{plan.criterion.name}"{rival}: {plan.criterion.in_words(plan.value, plan.value_before)}{draws}. '
        f"{len(plan.records)} records with {plan.samples} samples were chosen of {plan.candidates} candidates. "
        f"Known before: {plan.knowledge.source}."
    )


RECORD_HEAD = ["", "samples", "interval", "seconds", "windows", "noise", "without it"]

CONTRIBUTES = (
    '"without it" is the factor by which the error of the criterion grows where a record is left out, or of a '
    "discrimination the share of the evidence that is lost."
)
"""Meaning of the last column."""


def record_row(planned: PlannedRecord) -> list[str]:
    """The row of a record in the table of a plan."""
    schedule, display = planned.schedule, planned.experiment.measurement.display
    windows = f"{schedule.windows} of {schedule.samples}" if schedule.windows > 1 else "1"
    coloured = f", {1e3 * planned.noise.correlation_time:.3g} ms" if planned.noise.correlation_time else ""
    gain = planned.contributes
    return [
        planned.name,
        str(schedule.count),
        _time(schedule.interval),
        f"{float(planned.times[-1]):.3g}",
        windows,
        display.text(planned.noise.deviation) + coloured,
        "needed" if math.isinf(gain) else f"{gain:.3g}",
    ]


def sampling_words(planned: PlannedRecord) -> str:
    """Where the samples of a record go, in a sentence."""
    schedule, windows = planned.schedule, planned.schedule.list_windows(planned.experiment.period)
    every = f"every {_time(schedule.interval)}"
    if len(windows) == 1:
        return f"{every} from {_time(windows[0].start)} to {_time(float(planned.times[-1]))}"
    starts = ", ".join(_time(window.start) for window in windows[:3])
    more = "" if len(windows) <= 3 else f" and {len(windows) - 3} more, one a cycle"
    moved = "" if schedule.shifts == 1 else f", each moved by {_time(schedule.interval / schedule.shifts)} more"
    return f"{every} over {_time(schedule.length)} from {starts}{more}{moved}"


def _time(seconds: float) -> str:
    """A time with a unit that suits it."""
    for factor, unit in ((1.0, "s"), (1e3, "ms")):
        if abs(seconds) * factor >= 1.0 or seconds == 0.0:
            return f"{seconds * factor:.5g} {unit}"
    return f"{1e6 * seconds:.5g} us"


ERROR_HEAD = ["", "value", "before", "alone", "together"]


def error_rows(plan: Plan) -> list[list[str]]:
    """A row for every free parameter: its number, and its errors before, by the plan alone and by both, in per cent."""
    rows = []
    for path in plan.after:
        unit, factor = display_unit(plan.study.parameters[path].unit)
        value = plan.knowledge.values[path]
        shares = [percent(errors[path], value) for errors in (plan.before, plan.alone, plan.after)]
        rows.append([path, f"{value * factor:.5g} {unit}".rstrip(), *shares])
    return rows


def format_rehearsal(rehearsal: Rehearsal) -> str:
    """The errors that a plan promised beside those of a fit of its records from the virtual rig."""
    rows = [["", "promised", "had", "ratio"]]
    for path, promised in rehearsal.promised.items():
        found = rehearsal.estimate.parameters[path]
        had = found.standard_error
        ratio = f"{had / promised:.3g}" if promised > 0 and math.isfinite(had / promised) else "-"
        rows.append([path, percent(promised, found.value), percent(had, found.value), ratio])
    text = heading("Rehearsal on the virtual rig") + aligned_table("<>>>", rows)
    return text + note(f"Errors had over errors promised, geometric mean: {rehearsal.ratio:.3f}.")
