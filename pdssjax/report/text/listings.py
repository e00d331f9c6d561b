"""Tables that commands print: channels of a file, guesses for a new study, cycles of a record, the catalogue."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from ...core import decimals_for, display_unit, rounded
from ._layout import aligned_table, heading

if TYPE_CHECKING:  # listing channels and models loads no JAX
    from ...metrics import ChannelSummary, Characterisation, RecordGuess, Summary
    from ...study import Entry


def format_channels(file: str, form: str, channels: "Sequence[ChannelSummary]") -> str:
    """A table of the `channels` of a `file` of the format `form`."""
    head = ["", "channel", "unit", "samples", "least", "greatest", "interval", ""]
    return heading(f"{file}, {form}") + aligned_table("><<>>>><", [head, *map(_channel, channels)])


def _channel(channel: "ChannelSummary") -> list[str]:
    interval = ""
    if channel.interval:
        interval = f"{channel.interval:.6g} s"
    elif channel.step:
        interval = f"{channel.step:.6g} {channel.unit}".rstrip()
    notes = ["increases"] * (channel.step is not None)
    if channel.uneven:
        notes.append(f"unevenly: steps of {channel.shortest:.4g} to {channel.longest:.4g}")
    if channel.coarse:
        notes.append("rises, but repeats numbers: too few digits for a clock")
    if channel.symbol:
        notes.append("a unit or a symbol?")
    notes += [f"{channel.missing} without a number"] * (channel.missing > 0)
    numbers = channel.samples > channel.missing
    return [
        str(channel.number),
        channel.name,
        channel.unit or "-",
        str(channel.samples),
        f"{channel.low:.6g}" if numbers else "-",
        f"{channel.high:.6g}" if numbers else "-",
        interval,
        ", ".join(notes),
    ]


def format_guesses(guesses: "Sequence[tuple[str, RecordGuess]]") -> str:
    """A table of what each named record is taken to be."""
    head = ["", "measures", "drive", "", "V", "Hz", "t = 0 (s)", "", "noise"]
    return heading("Guessed from the files") + aligned_table("<<<<>>><>", [head, *(_guess(*pair) for pair in guesses)])


def _guess(name: str, guess: "RecordGuess") -> list[str]:
    wave = guess.waveform
    frequency = wave.numbers.get("frequency")
    begins = {"held": "held before", "clock": "by the clock", "running": "ran before", "motion": "by the motion"}
    return [
        name,
        guess.measures + (", turned" if guess.turned else ""),
        wave.name,
        wave.direction,
        f"{wave.numbers['voltage']:.5g}" + (f" from {wave.counted_from:.4g}" if wave.counted_from else ""),
        "" if frequency is None else f"{frequency:.6g}",
        f"{round(guess.start, 9) + 0.0:.6g}",
        begins.get(wave.begins, wave.begins),
        guess.display.text(guess.noise),
    ]


FIGURES = {
    "stroke": "stroke S",
    "back_slip": "back-slip S_0",
    "net_step": "net step S - S_0",
    "efficiency": "step efficiency (3.1)",
    "efficiency_by_extremes": "efficiency, by extremes",
    "speed": "average speed",
    "noise": "noise on the flanks",
    "output": "output force",
    "maximum": "highest sample",
    "minimum": "lowest sample",
    "mean": "mean force",
}
"""Titles of the figures of a characterisation, in the order of its report."""


def format_characterisation(found: "Characterisation") -> str:
    """Report of a characterised record: its cycles, and mean, error and scatter of each figure."""
    cycles = found.cycles
    way = "backward, the slow flank falls: figures are turned" if cycles.falls else "forward, the slow flank rises"
    places = decimals_for(cycles.slip_frequency_error)
    seen = f"{rounded(cycles.slip_frequency, places)} +/- {rounded(cycles.slip_frequency_error, places)} Hz"
    # Times count from the clock's zero, or from the first sample if that is far from it.
    first, last = float(found.time[0]), float(found.time[-1])
    zero = first if abs(first) > 1e3 * (last - first) else 0.0
    span = f"{first - zero:g} s to {last - zero:g} s" + (f" from the first one, at {zero:.10g} s" if zero else "")
    begins = cycles.start - zero
    lines = [
        ("record", f"{found.column}, {len(found.time)} samples, {span}"),
        ("direction", way),
        ("frequency", f"{cycles.frequency:g} Hz, given (seen: {seen})" if found.given else f"{seen}, found"),
        ("cycles", f"{cycles.count} complete, {cycles.rejected} left out, the first from {begins:.4g} s on"),
    ]
    head = ["", "unit", "mean", "+/-", "deviation"]
    rows = [_figure(title, found.summary[name]) for name, title in FIGURES.items() if name in found.summary]
    text = "".join(f"    {name:<10}= {text}\n" for name, text in lines)
    legend = "    +/-: standard error of the mean; deviation: standard deviation of the cycles.\n"
    return heading(str(found.file)) + text + aligned_table("<<>>>", [head, *rows]) + legend


def _figure(title: str, summary: "Summary") -> list[str]:
    unit, scale = display_unit(summary.unit) if summary.unit else ("%", 100.0)
    error = summary.standard_error * scale
    numbers = (summary.mean * scale, error, summary.standard_deviation * scale)
    return [title, unit, *(rounded(number, decimals_for(error)) for number in numbers)]


def format_catalogue(summaries: Mapping[str, str]) -> str:
    """List all members and parts, each with its summary."""
    return aligned_table("<<", [["", "what it is"], *map(list, summaries.items())])


def format_entry(entry: "Entry") -> str:
    """Describe one member: its equations, from its module's docstring, and its parameters."""
    head = ["", "unit", "nominal", "", "what it is"]
    rows = [
        [name, unit, f"{declared.nominal * scale:.6g}", "optional" if declared.optional else "", meaning]
        for name, (declared, meaning) in entry.parameters.items()
        for unit, scale in [display_unit(declared.unit)]
    ]
    rows += [[name, "", "", "one of", ", ".join(words)] for name, words in entry.choices.items()]
    text = textwrap.indent(entry.text, "    ")
    return heading(entry.name) + f"{text}\n\n" + (aligned_table("<<><<", [head, *rows]) if rows else "")
