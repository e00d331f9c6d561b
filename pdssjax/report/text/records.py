"""How well each record is predicted, as plain text."""

from collections.abc import Mapping, Sequence

from ...core import display_unit, rounded
from ...study import FittedRecord, UsedNumber
from ._layout import aligned_table, heading


def format_records(records: Sequence[FittedRecord]) -> str:
    """How well each record is predicted, each in the unit that its measurement is shown in."""
    head = ["", "role", "samples", "r2", "error index", "rmse", "largest", "noise", "", "neighbours", "chi2/n"]
    head += ["offset", "+/-", ""]
    shown = ", ".join(dict.fromkeys(f"{record.display.plural} in {record.display.unit}" for record in records))
    legend = (
        "    error index: root of the sum of squared residuals over n - 1, the thesis's (4.14); rmse: over n;\n"
        "    largest: the largest residual;\n"
        "    neighbours: the noise seen between neighbouring samples, whatever the fit;\n"
        "    chi2/n: chi-square per degree of freedom against the noise given, 1 where the record is explained.\n"
    )
    if any(record.noise_estimated for record in records):
        legend += "    found: the noise was estimated from these residuals, so there is no chi2/n to judge them by.\n"
    return heading(f"Records ({shown})") + aligned_table("<<>>>>>><>>>><", [head, *map(_record, records)]) + legend


def format_numbers(used: Mapping[str, UsedNumber]) -> str:
    """The numbers with which records were predicted, as `numbers_used` tells them."""
    scattered = any("standard_error" in number for number in used.values())
    rows = [["", "unit", "value", *["+/-"] * scattered, "from"]]
    for path, number in used.items():
        unit, scale = display_unit(number["unit"])
        error = f"{number['standard_error'] * scale:.2g}" if "standard_error" in number else "-"
        rows.append([path, unit, f"{number['value'] * scale:.7g}", *[error] * scattered, number["source"]])
    text = heading("Parameters used") + aligned_table("<<>" + ">" * scattered + "<", rows)
    return text + "    +/-: standard error; the bands scatter about these numbers.\n" * scattered


def _record(record: FittedRecord) -> list[str]:
    scale, places = record.display.scale, record.display.decimals(record.rmse, record.noise)
    known, show = record.noise > 0, lambda figure: rounded(figure * scale, places)
    return [
        record.name,
        record.role,
        str(record.samples),
        rounded(record.r2, 7),
        *map(show, (record.error_index, record.rmse, record.largest_error)),
        show(record.noise) if known else "-",
        ("found" if record.noise_estimated else "given") if known else "",
        show(record.noise_floor),
        rounded(record.reduced_chi2, 3 if record.reduced_chi2 < 1e6 else None),
        *map(show, (record.offset, record.offset_standard_error)),
        "" if record.simulated else "simulation failed",
    ]
