"""Results as a table, for the terminal and in Markdown, and as JSON."""

import json
import math
from typing import Any

import numpy as np

from .measure import Entry, Outcome

_COLUMNS = (
    "accuracy",
    "who",
    "tolerance",
    "error",
    "compile",
    "first call",
    "warm, median",
    "spread",
    "times ours",
)


def as_text(head: dict[str, Any], outcomes: dict[str, Outcome]) -> str:
    """For the terminal."""
    parts = [_headline(head)]
    for job, rows in _tables(outcomes).items():
        widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
        lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
        parts.append("\n".join([job, "-" * len(lines[0]), *lines]))
    return "\n\n".join([*parts, "\n".join(_sentences(outcomes))])


def as_markdown(head: dict[str, Any], outcomes: dict[str, Outcome], picture: str | None) -> str:
    """For the documentation and the results folder."""
    parts = ["# Speed beside other simulators", _headline(head)]
    for job, rows in _tables(outcomes).items():
        lines = [f"| {' | '.join(row)} |" for row in rows]
        rule = f"|{'|'.join('---' for _ in rows[0])}|"
        parts.append("\n".join([f"## {job}", "", lines[0], rule, *lines[1:]]))
    if picture:
        parts.append(f"![Work and precision]({picture})")
    return "\n\n".join([*parts, "\n".join(f"- {line}" for line in _sentences(outcomes))]) + "\n"


def as_json(head: dict[str, Any], outcomes: dict[str, Outcome]) -> str:
    """For comparison with other days and machines; unknown numbers are null."""
    entries = [_record(entry) for outcome in outcomes.values() for entry in outcome.entries]
    curves = [
        {
            "job": curve.job,
            "who": curve.who,
            "wrong": curve.wrong,
            "tolerance": [rung.tolerance for rung in curve.rungs],
            "error": [_plain(rung.error) for rung in curve.rungs],
            "seconds": [rung.seconds for rung in curve.rungs],
        }
        for outcome in outcomes.values()
        for curve in outcome.curves
    ]
    facts = {name: value for outcome in outcomes.values() for name, value in outcome.facts.items()}
    lines = _sentences(outcomes)
    return json.dumps(
        {
            "format": "pdssjax-benchmark/1",
            "header": head,
            "entries": entries,
            "curves": curves,
            "facts": facts,
            "lines": lines,
        },
        indent=1,
    )


def _record(entry: Entry) -> dict[str, Any]:
    names = "job who target tolerance error wrong compile_seconds first_seconds times note ours cut".split()
    return {name: _plain(getattr(entry, name)) for name in names} | {"median_seconds": _plain(entry.median)}


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _headline(head: dict[str, Any]) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in head["packages"].items() if version)
    compiler = f", gcc {head['gcc']}" if head["gcc"] else ""
    loads = " → ".join(str(head[key][0]) for key in ("load_before", "load_after") if head.get(key))
    return (
        f"{head['date']}, {head['processor']}, {head['cores']} cores, {head['system']}; load {loads or 'unknown'}\n"
        f"Python {head['python']}{compiler}; {versions}; revision {head['revision'] or 'unknown'}"
    )


def _tables(outcomes: dict[str, Outcome]) -> dict[str, list[list[str]]]:
    """A table for every kind of job: its columns' names, then the entries by accuracy, the fastest first."""
    jobs: dict[str, list[Entry]] = {}
    for outcome in outcomes.values():
        for entry in outcome.entries:
            jobs.setdefault(entry.job, []).append(entry)
    tables = {}
    for job, entries in jobs.items():
        targets = list(dict.fromkeys(entry.target for entry in entries))
        ordered = sorted(entries, key=lambda e: (targets.index(e.target), e.median))
        rows = [[*_COLUMNS, "remarks"], *(_row(entry, entries) for entry in ordered)]
        # A column in which nobody has anything is left out.
        used = [i for i in range(len(rows[0])) if any(row[i] for row in rows[1:])]
        tables[job] = [[row[i] for i in used] for row in rows]
    return tables


def _row(entry: Entry, entries: list[Entry]) -> list[str]:
    ours = [e.median for e in entries if e.ours and e.target == entry.target and not e.wrong]
    compared = ours and len(entries) > 1 and (entry.target or not all(e.ours for e in entries))
    more = "> " if entry.cut else ""
    ratio = f"{more}{entry.median / min(ours):.2g}" if compared else ""
    return [
        entry.target,
        entry.who,
        f"{entry.tolerance:.1e}" if math.isfinite(entry.tolerance) else "",
        "" if not math.isfinite(entry.error) else f"{entry.error:.1e}",
        duration(entry.compile_seconds),
        duration(entry.first_seconds),
        more + duration(entry.median),
        _spread(entry.times),
        ratio,
        "; ".join(remark for remark in ("WRONG" * entry.wrong, "cut off" * entry.cut, entry.note) if remark),
    ]


def _spread(times: list[float]) -> str:
    """Quartiles and number of rounds."""
    if len(times) < 2:
        return "once" if times else ""
    low, high = np.quantile(times, [0.25, 0.75])
    return f"{duration(low)} to {duration(high)} ({len(times)})"


def duration(seconds: float) -> str:
    """Three digits, in ms below a second."""
    if not math.isfinite(seconds):
        return ""
    if seconds < 1.0:
        return f"{1e3 * seconds:.3g} ms"
    return f"{seconds:.3g} s"


def _sentences(outcomes: dict[str, Outcome]) -> list[str]:
    return [line for outcome in outcomes.values() for line in outcome.lines]
