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

ActiveChannels = list[tuple[Channel, Float[np.ndarray, " samples"]]]
"""Channels that were on, each with its samples."""


class Oscilloscope(AbstractReader):
    """A binary file of an oscilloscope."""

    ending = ".wfm"
    expected = "a file of an oscilloscope that RigolWFM knows (or export it as CSV)"

    @classmethod
    def recognises(cls, file: Path, head: bytes) -> bool:
        # The beginning of LeCroy's files with any ending, after some bytes in the answer of a query.
        is_lecroy = b"WAVEDESC" in head[:64]
        return is_lecroy or file.suffix.lower() in (".wfm", ".trc", ".isf", ".bin", ".wvf", ".wdf", ".hdr")

    def channels(self) -> list[Channel]:
        return [channel for channel, _ in self._active_channels()]

    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        active = self._active_channels()
        chosen = [active[number - 1] for number in numbers]
        lengths = {channel.name: samples.size for channel, samples in chosen}
        yield from blocks_of(self.file, lengths, first, lambda part: [samples[part] for _, samples in chosen])

    def _active_channels(self) -> ActiveChannels:
        wfm = library("RigolWFM.wfm", "oscilloscope", self.file)
        expected = self.expected
        if self.file.name.lower().endswith(".wfm.bin"):
            expected = f"{self.file.name[:-8]}.bin, which describes the samples that are in this one"
        with refusing(self.file, expected):
            active = _quietly(lambda: _channels_of(wfm.Wfm.from_file(str(self.file)).channels))
        if not active:
            raise InputError(f"{self.file}: found no channel that was on, expected one at least.")
        return active


def _quietly(read: Callable[[], ActiveChannels]) -> ActiveChannels:
    """The result of `read`, without the output of the library and the files that it leaves open."""
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore", ResourceWarning)
        try:
            return read()
        except Exception as error:  # of many types; its traceback would keep the file open
            reason = str(error)
        finally:
            gc.collect()
    raise ValueError(reason)


def _channels_of(stored: Any) -> ActiveChannels:
    """Copies of the library's channels that were on, so that the library's objects can be freed."""
    active: ActiveChannels = []
    for one in stored:
        if one.enabled and one.volts is not None and len(one.volts) > 1:
            name, unit = one.name.replace(" ", ""), str(getattr(one.unit, "name", "v")).upper()
            interval = float(one.times[-1] - one.times[0]) / (len(one.times) - 1)
            channel = Channel(name, len(active) + 1, unit, len(one.volts), interval, float(one.times[0]))
            active.append((channel, np.asarray(one.volts, float)))
    return active
