"""What is inside a file, as plain text: its channels with units, samples, interval and range."""

from collections.abc import Sequence

from ...metrics import ChannelSummary
from ._layout import aligned_table, heading


def format_channels(file: str, form: str, channels: Sequence[ChannelSummary]) -> str:
    """A table of the `channels` of a `file` of the format `form`."""
    head = ["", "channel", "unit", "samples", "least", "greatest", "interval", ""]
    return heading(f"{file}, {form}") + aligned_table("><<>>>><", [head, *map(_row, channels)])


def _row(channel: ChannelSummary) -> list[str]:
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
