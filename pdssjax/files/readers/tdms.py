"""LabVIEW's TDMS files, by npTDMS: channels are called "group/channel".

Units are the property `unit_string`; the clock of a waveform is `wf_increment` [s], and its first sample is at
`wf_start_offset` [s].  Samples are read block by block.
"""

import logging
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...core import InputError, InputWarning
from ._errors import library, refusing, same_length
from .base import BLOCK, AbstractReader, Block, Channel

_EXPECTED = "a TDMS file"


class Tdms(AbstractReader):
    """A TDMS file."""

    ending = ".tdms"

    def __init__(self, file: Path, decimal: str = "") -> None:
        self.file = file

    @classmethod
    def recognises(cls, file: Path, head: bytes) -> bool:
        return head.startswith(b"TDSm") or file.suffix.lower() == ".tdms"

    def channels(self) -> list[Channel]:
        with refusing(self.file, _EXPECTED), _opened(self.file) as opened:
            found = [_channel(stored, number) for number, stored in enumerate(_numeric(opened), start=1)]
            told = [channel for group in opened.groups() for channel in group.channels()]
            if opened.file_status.incomplete_final_segment:
                empty = [f'"{channel.group_name}/{channel.name}"' for channel in told if not len(channel)]
                nothing = f", which is nothing of {', '.join(empty)}" if empty else ""
                warnings.warn(
                    f"{self.file}: the file ends before its samples do, as where what wrote it was broken off; what "
                    f"is there is read{nothing}.",
                    InputWarning,
                    stacklevel=2,
                )
        if not found:
            raise InputError(f"{self.file}: found no channel of numbers, expected {_EXPECTED} with some.")
        return found

    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        with refusing(self.file, _EXPECTED), _opened(self.file) as opened:
            stored = _numeric(opened)
            chosen = [stored[number - 1] for number in numbers]
            count = same_length(self.file, {channel.name: len(channel) for channel in chosen})
            for begin in range(first, count, BLOCK):
                end = min(begin + BLOCK, count)
                values = np.column_stack([np.asarray(channel[begin:end], float) for channel in chosen])
                yield Block(values, np.arange(begin + 1, end + 1))


def _opened(file: Path) -> Any:
    """The file, open; what npTDMS would say of it on standard error is left unsaid."""
    nptdms = library("nptdms", "tdms", file)
    library("nptdms.log", "tdms", file).log_manager.set_level(logging.ERROR)
    return nptdms.TdmsFile.open(file)


def _numeric(opened: Any) -> list[Any]:
    """The channels that hold numbers."""
    stored = [channel for group in opened.groups() for channel in group.channels()]
    return [c for c in stored if c.dtype is not None and np.issubdtype(c.dtype, np.number) and len(c)]


def _channel(stored: Any, number: int) -> Channel:
    properties = stored.properties
    interval = float(properties.get("wf_increment", 0.0))
    return Channel(
        f"{stored.group_name}/{stored.name}",
        number,
        str(properties.get("unit_string", "")),
        len(stored),
        interval if interval > 0 else None,
        float(properties.get("wf_start_offset", 0.0)),
    )
