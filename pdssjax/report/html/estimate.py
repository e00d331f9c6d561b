"""An estimate as HTML: verdict, parameters, records, notes."""

from ...core import decimals_for, display_unit, percent, rounded
from ...study import Estimate, FittedParameter, FittedRecord
from ._layout import folded, paragraph, table


def estimate_html(estimate: Estimate) -> str:
    """The tables of the report, and its notes folded."""
    parameters = list(estimate.parameters.values())
    parts = [
        paragraph(estimate.title, _outcome(estimate)),
        table(
            "<>>><<<",
            ["parameter", "value", "+/-", "", "unit", "95 % interval", ""],
            [_parameter(parameter) for parameter in parameters],
        ),
        table(
            "<<>>>>><",
            ["record", "role", "samples", "r2", "rmse", "noise", "chi2/n", "unit"],
            [_record(record) for record in estimate.records],
        ),
        folded("Notes", estimate.notes),
    ]
    return "\n".join(filter(None, parts))


def _outcome(estimate: Estimate) -> str:
    verdict = estimate.verdict if estimate.success else estimate.verdict.upper()
    known = not estimate.statistics.noise_estimated
    chi2 = f", reduced chi-square {estimate.statistics.reduced_chi2:.5g}" if known else ""
    more = (
        ""
        if estimate.explained
        else "; the records leave more than noise, contradict each other or are missed, see the notes"
    )
    return f"{estimate.method} fit {verdict}: {estimate.message}{chi2}{more}"


def _parameter(parameter: FittedParameter) -> list[str]:
    unit, scale = display_unit(parameter.unit)
    places = decimals_for(parameter.standard_error * scale)
    low, high = (rounded(end * scale, places) for end in parameter.interval)
    return [
        parameter.path,
        rounded(parameter.value * scale, places),
        rounded(parameter.standard_error * scale, places) if parameter.free else "",
        percent(parameter.standard_error, parameter.value) if parameter.free else "",
        unit,
        f"{low} .. {high}" if parameter.free and parameter.identifiable else "",
        parameter.remark,
    ]


def _record(record: FittedRecord) -> list[str]:
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
