"""A study as HTML: models, parameters, records."""

import math

from ...core import display_unit, member_name
from ...study import Parameter, Record, Study
from ._layout import paragraph, table


def study_html(study: Study) -> str:
    """What a study knows and what was measured."""
    reading = f" ({study.friction_state} state)" if study.friction.__name__.startswith("Anisotropic") else ""
    feedback = ", with friction feedback" if study.feedback else ""
    resting = ", at rest under its load from the beginning" if study.rests_under_load else ""
    models = f"piezo: {member_name(study.piezo)}, friction: {member_name(study.friction)}{reading}{feedback}{resting}"
    return "\n".join(
        [
            paragraph(study.title, models),
            table(
                "<<><<",
                ["parameter", "", "number", "unit", "bounds given"],
                [_parameter(parameter) for parameter in study.parameters.values()],
            ),
            table(
                "<<<<>>>",
                ["record", "measures", "role", "drive", "samples", "from (s)", "to (s)"],
                [_record(record) for record in study.records],
            ),
        ]
    )


def _parameter(parameter: Parameter) -> list[str]:
    unit, scale = display_unit(parameter.unit)
    number = "found in the data" if parameter.number is None else f"{parameter.number * scale:.6g}"
    given = [end for end in (parameter.low, parameter.high) if end is not None]
    low, high = (math.nan if end is None else end * scale for end in (parameter.low, parameter.high))
    bounds = f"{low:.4g} .. {high:.4g}".replace("nan", "") if given else ""
    kind = "free" if parameter.free else "fixed"
    if parameter.measured_apart is not None:
        kind, number = "measured apart", f"{number} +/- {parameter.measured_apart[1] * scale:.2g}"
    return [parameter.path, kind, number, unit, bounds]


def _record(record: Record) -> list[str]:
    drive = "prescribed motion" if record.drive is None else _drive(record)
    ends = [f"{record.time[at]:.4g}" for at in (0, -1)]
    return [record.name, record.measures, record.role, drive, str(record.time.size), *ends]


def _drive(record: Record) -> str:
    drive = record.drive
    assert drive is not None
    frequency = drive.cycle_frequency()
    cycles = "" if frequency is None else f", {float(frequency):g} Hz"
    return f"{member_name(type(drive))}, {float(drive.peak()):g} V{cycles}"
