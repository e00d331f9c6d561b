"""LabVIEW's TDMS files, by npTDMS: channels are named "group/channel".

Units are the property `unit_string`; the clock of a waveform is `wf_increment` [s], and its first sample is at
`wf_start_offset` [s] after `wf_start_time`; times count from the earliest of these in the file.  Complex numbers are
two channels, "name.real" and "name.imag".  Samples are read block by block.
"""

import logging
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ...core import InputError, InputWarning
from .base import AbstractReader, Block, Channel, blocks_of, library, refusing


class Tdms(AbstractReader):
    """A TDMS file."""

    ending = ".tdms"
    expected = "a TDMS file"

    @classmethod
    def recognises(cls, file: Path, head: bytes) -> bool:
        return head.startswith(b"TDSm") or file.suffix.lower() == ".tdms"

    def channels(self) -> list[Channel]:
        with refusing(self.file, self.expected), _open_quietly(self.file) as opened:
            lines = _lines(opened)
            begins = [_begin(stored) for stored, _ in lines]
            earliest = min([begin for begin in begins if begin is not None], default=None)
            found = [_channel(line, number, earliest) for number, line in enumerate(lines, start=1)]
            if opened.file_status.incomplete_final_segment:
                every = [channel for group in opened.groups() for channel in group.channels()]
                empty = [f'"{channel.group_name}/{channel.name}"' for channel in every if not len(channel)]
                nothing = f", which is nothing of {', '.join(empty)}" if empty else ""
                warnings.warn(
                    f"{self.file}: the file ends before its samples do, as after an interrupted recording; the part "
                    f"before is read{nothing}.",
                    InputWarning,
                    stacklevel=2,
                )
        if not found:
            raise InputError(f"{self.file}: found no channel of numbers, expected {self.expected} with some.")
        return found

    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        with refusing(self.file, self.expected), _open_quietly(self.file) as opened:
            lines = _lines(opened)
            chosen = [lines[number - 1] for number in numbers]
            real = lambda values, part: np.asarray(getattr(values, part) if part else values, float)
            read = lambda samples: [real(stored[samples], part) for stored, part in chosen]
            yield from blocks_of(self.file, {stored.name: len(stored) for stored, _ in chosen}, first, read)


def _open_quietly(file: Path) -> Any:
    """The open file; the log of npTDMS on standard error is silenced."""
    nptdms = library("nptdms", "tdms", file)
    library("nptdms.log", "tdms", file).log_manager.set_level(logging.ERROR)
    return nptdms.TdmsFile.open(file)


_Line: TypeAlias = tuple[Any, str]
"""A channel of the file; of complex numbers with "real" or "imag"."""


def _lines(opened: Any) -> list[_Line]:
    """The channels that hold numbers."""
    stored = [channel for group in opened.groups() for channel in group.channels()]
    numeric = [c for c in stored if c.dtype is not None and np.issubdtype(c.dtype, np.number) and len(c)]
    parts = lambda c: ["real", "imag"] if np.issubdtype(c.dtype, np.complexfloating) else [""]
    return [(channel, part) for channel in numeric for part in parts(channel)]


def _begin(stored: Any) -> np.datetime64 | None:
    """Start of the clock of a waveform, where the file has it."""
    begin = stored.properties.get("wf_start_time")
    return None if begin is None else np.datetime64(begin, "ns")


def _channel(line: _Line, number: int, earliest: np.datetime64 | None) -> Channel:
    stored, part = line
    properties, begin = stored.properties, _begin(stored)
    interval = float(properties.get("wf_increment", 0.0))
    later = 0.0 if begin is None or earliest is None else float((begin - earliest) / np.timedelta64(1, "s"))
    return Channel(
        f"{stored.group_name}/{stored.name}{'.' if part else ''}{part}",
        number,
        str(properties.get("unit_string", "")),
        len(stored),
        interval if interval > 0 else None,
        float(properties.get("wf_start_offset", 0.0)) + later,
    )
