"""Lists the channels of a file, with what their samples amount to."""

from pathlib import Path

from ..metrics import ChannelSummary
from .channel_samples import open_file


def list_channels(file: Path, decimal: str = "") -> tuple[str, list[ChannelSummary]]:
    """The format of `file`, and its channels; the file is read block by block.

    **Arguments:** `decimal` is the decimal sign of a text, "" where the file is to tell it.

    **Raises:** `InputError` if the file is missing, broken or of no format that is known.
    """
    reader = open_file(file, decimal)
    channels = reader.channels()
    found = [ChannelSummary(c.number, c.name, c.unit, c.interval, c.letter) for c in channels]
    for samples in dict.fromkeys(channel.samples for channel in channels):
        together = [s for s, channel in zip(found, channels, strict=True) if channel.samples == samples]
        for block in reader.blocks([summary.number for summary in together]):
            for summary, values in zip(together, block.values.T, strict=True):
                summary.add(values)
    return reader.kind.replace("-", " "), found
