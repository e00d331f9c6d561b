"""An estimate, or what records say by themselves, as plain text.

The order and the vocabulary follow lmfit's `fit_report`, which people in the field know.
"""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from .catalogue import Entry
from .characterise import Characterisation, Summary
from .display import decimals_for, display_unit, percent, rounded, strongest_pairs
from .estimate import Estimate, FittedParameter, FittedRecord

WORTH_KNOWING = 0.3
"""Correlations smaller than this are left out of the report."""

FIGURES = {
    "stroke": "stroke S",
    "back_slip": "back-slip S_0",
    "net_step": "net step S - S_0",
    "efficiency": "step efficiency (3.1)",
    "efficiency_by_extremes": "the same, by extremes",
    "speed": "average speed",
    "noise": "noise on the flanks",
    "output": "output force",
    "maximum": "highest sample",
    "minimum": "lowest sample",
    "mean": "mean force",
}
"""What a characterisation reports, in order."""


def format_report(estimate: Estimate) -> str:
    """The whole report, in ASCII apart from what the study's own title and names contain."""
    parts = [
        _heading(estimate.title) + _outcome(estimate) + _statistics(estimate),
        _heading("Parameters") + _parameters(estimate),
        format_records(estimate.records),
        _heading(f"Correlations of size {WORTH_KNOWING:g} or more") + _correlations(estimate),
    ]
    if estimate.notes:
        parts.append(_heading("Notes") + "".join(map(_note, estimate.notes)))
    return "\n".join(parts)


def format_records(records: Sequence[FittedRecord]) -> str:
    """How well each record is predicted, lengths in micrometres and forces in newtons."""
    head = [
        "",
        "role",
        "samples",
        "r2",
        "error index",
        "rmse",
        "noise",
        "",
        "neighbours",
        "chi2/n",
        "offset",
        "+/-",
        "",
    ]
    units = {"m": "lengths in um", "N": "forces in N"}
    shown = ", ".join(text for unit, text in units.items() if unit in {record.unit for record in records})
    legend = (
        "    neighbours: the noise seen between neighbouring samples, whatever the fit;\n"
        "    chi2/n: chi-square per degree of freedom against the noise given, 1 where the record is explained.\n"
    )
    if any(record.noise_estimated for record in records):
        legend += "    found: the noise was estimated from these residuals, so there is no chi2/n to judge them by.\n"
    return _heading(f"Records ({shown})") + _table("<<>>>>><>>>><", [head, *map(_record, records)]) + legend


def format_comparison(joint: Estimate, sequential: Estimate) -> str:
    """Both fits side by side: values, and the errors with and without those of the earlier step."""
    head = ["", "unit", "joint", "+/-", "sequential", "+/- naive", "+/- corrected", "shift/sigma"]
    rows = [_compared(joint.parameters[path], sequential.parameters[path]) for path in joint.names]
    legend = (
        "    naive: the results of the earlier step taken for exact; corrected: their errors carried on.\n"
        "    shift/sigma: difference of the two values, in corrected standard errors.\n"
    )
    return _heading("Sequential against joint") + _table("<<>>>>>>", [head, *rows]) + legend


def format_characterisation(found: Characterisation) -> str:
    """What one record says: its cycles, and each figure with mean, error and scatter."""
    cycles = found.cycles
    way = "backward, the slow flank falls: figures are turned" if cycles.falls else "forward, the slow flank rises"
    places = decimals_for(cycles.seen_error)
    seen = f"{rounded(cycles.seen, places)} +/- {rounded(cycles.seen_error, places)} Hz"
    lines = [
        ("record", f"{found.column}, {len(found.time)} samples, {found.time[0]:g} s to {found.time[-1]:g} s"),
        ("direction", way),
        ("frequency", f"{cycles.frequency:g} Hz, given (seen: {seen})" if found.given else f"{seen}, found"),
        ("cycles", f"{cycles.count} complete, {cycles.rejected} left out, the first from {cycles.start:.4g} s on"),
    ]
    head = ["", "unit", "mean", "+/-", "deviation"]
    rows = [_figure(title, found.summary[name]) for name, title in FIGURES.items() if name in found.summary]
    text = "".join(f"    {name:<10}= {text}\n" for name, text in lines)
    legend = "    +/-: standard error of the mean; deviation: standard deviation of the cycles.\n"
    return _heading(str(found.file)) + text + _table("<<>>>", [head, *rows]) + legend


def format_numbers(used: Mapping[str, Mapping[str, Any]]) -> str:
    """The numbers with which records were predicted, as `numbers_used` tells them."""
    head = ["", "unit", "value", "from"]
    rows = []
    for path, told in used.items():
        unit, scale = display_unit(told["unit"])
        rows.append([path, unit, f"{told['value'] * scale:.7g}", told["source"]])
    return _heading("Parameters used") + _table("<<><", [head, *rows])


def format_catalogue(entries: Sequence[Entry]) -> str:
    """All members and parts, one line each."""
    return _table("<<", [["", "what it is"], *([entry.name, entry.summary] for entry in entries)])


def format_entry(entry: Entry) -> str:
    """One member: its parameters, and its equations as its module tells them."""
    head = ["", "unit", "nominal", "", "what it is"]
    rows = [
        [name, unit, f"{declared.nominal * scale:.6g}", "optional" if declared.optional else "", told]
        for name, (declared, told) in entry.parameters.items()
        for unit, scale in [display_unit(declared.unit)]
    ]
    rows += [[name, "", "", "one of", ", ".join(words)] for name, words in entry.choices.items()]
    text = textwrap.indent(entry.text, "    ")
    return _heading(entry.name) + f"{text}\n\n" + (_table("<<><<", [head, *rows]) if rows else "")


def format_sweep(data: Any) -> str:
    """The extremes of a sweep, and where they lie."""
    head = ["", "unit", "least", "most", "where it is most"]
    rows = []
    for name in ("speed", "net_step", "efficiency", "stroke", "back_slip"):
        values = data[name]
        unit, scale = ("%", 100.0) if name == "efficiency" else display_unit(values.attrs["units"])
        if not bool(values.notnull().any()):
            rows.append([values.attrs["long_name"], unit, "-", "-", "every point failed"])
            continue
        place = values.isel(values.argmax(dim=...))
        where = [_where(place[name]) for name in values.dims]
        least, most = (f"{float(end) * scale:.5g}" for end in (values.min(), values.max()))
        rows.append([values.attrs["long_name"], unit, least, most, ", ".join(where)])
    failed = int((data.failure.values != 0).sum())
    text = _heading(f"Sweep of {data.failure.size} points") + _table("<<>><", [head, *rows])
    return text + (f"    {failed} points failed: {data.failure.attrs['meanings']}\n" if failed else "")


def _where(coordinate: Any) -> str:
    unit, scale = display_unit(coordinate.attrs["units"])
    return f"{coordinate.attrs['long_name']} = {float(coordinate) * scale:.5g} {'' if unit == '1' else unit}".rstrip()


def _figure(title: str, summary: Summary) -> list[str]:
    unit, scale = display_unit(summary.unit) if summary.unit else ("%", 100.0)
    error = summary.standard_error * scale
    numbers = (summary.mean * scale, error, summary.standard_deviation * scale)
    return [title, unit, *(rounded(number, decimals_for(error)) for number in numbers)]


def _heading(text: str) -> str:
    return f"[[{text}]]\n"


def _outcome(estimate: Estimate) -> str:
    verdict = "converged" if estimate.converged else "DID NOT CONVERGE"
    return f"    {estimate.method} fit {verdict}: {estimate.message}\n"


def _statistics(estimate: Estimate) -> str:
    statistics = estimate.statistics
    fitted = sum(record.role == "fit" for record in estimate.records)
    lines = [
        ("records fitted", f"{fitted} of {len(estimate.records)}"),
        ("samples fitted", f"{statistics.samples}"),
        ("free parameters", f"{len(estimate.names)}, with offsets {statistics.free}"),
        ("iterations", f"{statistics.iterations} ({statistics.evaluations} evaluations, {estimate.seconds:.1f} s)"),
        ("chi-square", f"{statistics.chi2:.6g}"),
        ("reduced chi-square", _reduced_chi2(estimate)),
        ("Akaike criterion", f"{statistics.aic:.6g}"),
        ("Bayesian criterion", f"{statistics.bic:.6g}"),
    ]
    return "".join(f"    {name:<19}= {text}\n" for name, text in lines)


def _reduced_chi2(estimate: Estimate) -> str:
    """The number, unless it is 1 by construction."""
    fitted = [record for record in estimate.records if record.role == "fit"]
    silent = sum(record.noise_estimated for record in fitted)
    if estimate.statistics.noise_estimated:
        return "- (noise estimated from these residuals)"
    mixed = f" (noise estimated from the residuals in {silent} of {len(fitted)} records)" if silent else ""
    return f"{estimate.statistics.reduced_chi2:.6g}{mixed}"


def _parameters(estimate: Estimate) -> str:
    head = ["", "unit", "value", "+/-", "", "naive", "95 % interval", "start", ""]
    rows = [head, *(_parameter(parameter) for parameter in estimate.parameters.values())]
    if estimate.method == "sequential":
        legend = "    naive: the error if the results of the piezo's own fit were exact; +/-: with their errors.\n"
        return _table("<<>>>>><<", rows) + legend
    return _table("<<>>>><<", [row[:5] + row[6:] for row in rows])


def _parameter(parameter: FittedParameter) -> list[str]:
    unit, factor = display_unit(parameter.unit)
    places = decimals_for(parameter.standard_error * factor)
    low, high = (rounded(end * factor, places) for end in parameter.interval)
    start = None if parameter.start is None else f"{parameter.start * factor:.4g}"
    return [
        parameter.path,
        unit,
        rounded(parameter.value * factor, places),
        rounded(parameter.standard_error * factor, places),
        percent(parameter.standard_error, parameter.value),
        _naive(parameter),
        "-" if low == high == "-" else f"{low} .. {high}",
        start or "-",
        _remark(parameter),
    ]


def _naive(parameter: FittedParameter) -> str:
    if parameter.naive_standard_error is None:
        return "-"
    return percent(parameter.naive_standard_error, parameter.value)


def _remark(parameter: FittedParameter) -> str:
    if not parameter.free:
        return "fixed"
    marks = ["at bound"] * parameter.at_bound + ["no information"] * (not parameter.informed)
    return ", ".join(marks)


def _record(record: FittedRecord) -> list[str]:
    _, scale = display_unit(record.unit)
    known = record.noise > 0
    residual, zero = [record.error_index, record.rmse], [record.offset, record.offset_standard_error]
    return [
        record.name,
        record.role,
        str(record.samples),
        rounded(record.r2, 7),
        *(rounded(figure * scale, 4) for figure in residual),
        rounded(record.noise * scale, 4) if known else "-",
        ("found" if record.noise_estimated else "given") if known else "",
        rounded(record.noise_floor * scale, 4),
        rounded(record.reduced_chi2, 3),
        *(rounded(figure * scale, 4) for figure in zero),
        "" if record.simulated else "simulation failed",
    ]


def _correlations(estimate: Estimate) -> str:
    pairs = strongest_pairs(estimate.names, estimate.correlation, WORTH_KNOWING)
    if not pairs:
        return "    none\n"
    return _table("<>", [[f"C({one}, {other})", f"{value:+.3f}"] for one, other, value in pairs])


def _compared(joint: FittedParameter, sequential: FittedParameter) -> list[str]:
    unit, factor = display_unit(joint.unit)
    places = decimals_for(min(joint.standard_error, sequential.standard_error) * factor)
    naive = sequential.naive_standard_error
    shift = (sequential.value - joint.value) / sequential.standard_error if sequential.standard_error else float("nan")
    return [
        joint.path,
        unit,
        rounded(joint.value * factor, places),
        percent(joint.standard_error, joint.value),
        rounded(sequential.value * factor, places),
        "-" if naive is None else percent(naive, sequential.value),
        percent(sequential.standard_error, sequential.value),
        rounded(shift, 2),
    ]


def _note(text: str) -> str:
    return textwrap.fill(text, 100, initial_indent="    ", subsequent_indent="    ") + "\n"


def _table(align: str, rows: Sequence[Sequence[str]]) -> str:
    """Rows with their columns lined up; `align` holds "<" or ">" for each column."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    layout = "    " + "  ".join(f"{{:{side}{width}}}" for side, width in zip(align, widths, strict=True))
    return "".join(layout.format(*row).rstrip() + "\n" for row in rows)
