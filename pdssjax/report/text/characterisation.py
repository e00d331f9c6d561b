"""What one record says by itself, as plain text."""

from ...core import decimals_for, display_unit, rounded
from ...metrics import Characterisation, Summary
from ._layout import aligned_table, heading

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

_LONG = 1e3
"""Lengths of a record from a clock's zero to its first sample from which times count from that sample."""


def format_characterisation(found: Characterisation) -> str:
    """What one record says: its cycles, and each figure with mean, error and scatter."""
    cycles = found.cycles
    way = "backward, the slow flank falls: figures are turned" if cycles.falls else "forward, the slow flank rises"
    places = decimals_for(cycles.seen_error)
    seen = f"{rounded(cycles.seen, places)} +/- {rounded(cycles.seen_error, places)} Hz"
    begins = cycles.start - _zero(found)
    lines = [
        ("record", f"{found.column}, {len(found.time)} samples, {_span(found)}"),
        ("direction", way),
        ("frequency", f"{cycles.frequency:g} Hz, given (seen: {seen})" if found.given else f"{seen}, found"),
        ("cycles", f"{cycles.count} complete, {cycles.rejected} left out, the first from {begins:.4g} s on"),
    ]
    head = ["", "unit", "mean", "+/-", "deviation"]
    rows = [_figure(title, found.summary[name]) for name, title in FIGURES.items() if name in found.summary]
    text = "".join(f"    {name:<10}= {text}\n" for name, text in lines)
    legend = "    +/-: standard error of the mean; deviation: standard deviation of the cycles.\n"
    return heading(str(found.file)) + text + aligned_table("<<>>>", [head, *rows]) + legend


def _zero(found: Characterisation) -> float:
    """What times are counted from: the clock's zero, or the first sample where a clock counts from long before."""
    first, last = float(found.time[0]), float(found.time[-1])
    return first if abs(first) > _LONG * (last - first) else 0.0


def _span(found: Characterisation) -> str:
    zero = _zero(found)
    told = f"{found.time[0] - zero:g} s to {found.time[-1] - zero:g} s"
    return f"{told} from the first one, at {zero:.10g} s" if zero else told


def _figure(title: str, summary: Summary) -> list[str]:
    unit, scale = display_unit(summary.unit) if summary.unit else ("%", 100.0)
    error = summary.standard_error * scale
    numbers = (summary.mean * scale, error, summary.standard_deviation * scale)
    return [title, unit, *(rounded(number, decimals_for(error)) for number in numbers)]
