"""Binary files of oscilloscopes, by RigolWFM: Rigol, Tektronix, LeCroy, Keysight, Siglent, Yokogawa, R&S.

The clock is the oscilloscope's, with 0 at the trigger.  A file is read as a whole.  Rohde & Schwarz write two: NAME.bin
describes the samples in NAME.Wfm.bin, which must lie beside it.
"""

import contextlib
import gc
import io
import warnings
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ...core import InputError
from .base import AbstractReader, Block, Channel, blocks_of, library, refusing

Shown = list[tuple[Channel, Float[np.ndarray, " samples"]]]
"""Channels that were on, each with its samples."""


class Oscilloscope(AbstractReader):
    """A binary file of an oscilloscope."""

    ending = ".wfm"
    expected = "a file of an oscilloscope that RigolWFM knows (or export it as CSV)"

    @classmethod
    def recognises(cls, file: Path, head: bytes) -> bool:
        # How LeCroy's files begin, whatever they end in; the answer of a query has some bytes before it.
        is_lecroy = b"WAVEDESC" in head[:64]
        return is_lecroy or file.suffix.lower() in (".wfm", ".trc", ".isf", ".bin", ".wvf", ".wdf", ".hdr")

    def channels(self) -> list[Channel]:
        return [channel for channel, _ in self._active_channels()]

    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        shown = self._active_channels()
        chosen = [shown[number - 1] for number in numbers]
        yield from blocks_of(self.file, [(channel.name, samples) for channel, samples in chosen], first)

    def _active_channels(self) -> Shown:
        """The channels that were on."""
        wfm = library("RigolWFM.wfm", "oscilloscope", self.file)
        expected = self.expected
        if self.file.name.lower().endswith(".wfm.bin"):
            expected = f"{self.file.name[:-8]}.bin, which describes the samples that are in this one"
        with refusing(self.file, expected):
            shown = _quietly(lambda: _channels_of(wfm.Wfm.from_file(str(self.file)).channels))
        if not shown:
            raise InputError(f"{self.file}: found no channel that was on, expected one at least.")
        return shown


def _quietly(read: Callable[[], Shown]) -> Shown:
    """What is read by the library, which prints what it makes of a file, and leaves files open."""
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore", ResourceWarning)
        try:
            return read()
        except Exception as error:  # of many types; its traceback would keep the file open
            said = str(error)
        finally:
            gc.collect()
    raise ValueError(said)


def _channels_of(read: Any) -> Shown:
    """The library's channels that were on, copied, so that nothing refers to the library's own."""
    found: Shown = []
    for shown in read:
        if shown.enabled and shown.volts is not None and len(shown.volts) > 1:
            name, unit = shown.name.replace(" ", ""), str(getattr(shown.unit, "name", "v")).upper()
            interval = float(shown.times[-1] - shown.times[0]) / (len(shown.times) - 1)
            channel = Channel(name, len(found) + 1, unit, len(shown.volts), interval, float(shown.times[0]))
            found.append((channel, np.asarray(shown.volts, float)))
    return found
