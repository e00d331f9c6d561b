"""Opens a file of any known format, lists and finds its channels, and reads samples of a window."""

import functools
import math
import re
import stat
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ..core import InputError, member, members, nearest
from ..metrics import ChannelSummary
from ..study import check_increasing
from .readers.base import AbstractReader, AbstractSource, Block, Channel, refusing
from .reading_process import Pairs, run_isolated

_FAMILY = "files.readers"


class Clock(NamedTuple):
    """The source of the sample times: a channel, or an interval where no times were stored."""

    number: int | None
    """Number of the channel; None where the interval gives the times."""
    factor: float = 1.0
    """Factor from the channel's unit to seconds."""
    start: float = 0.0
    """Time of the first sample of the file [s]."""
    interval: float = math.nan
    """Interval between samples [s]."""


class Samples(NamedTuple):
    """Samples of a file, or of a window in it."""

    time: Float[np.ndarray, " samples"]
    """[s]; NaN where the file has no number."""
    values: Float[np.ndarray, "samples channels"]
    """In the units of the file; NaN where it has no number."""
    places: Int[np.ndarray, " samples"]
    """Line or number of each sample in the file, from 1."""
    begin: float
    """Time of the first sample of the file [s]."""
    end: float
    """Time of the last sample that was read [s]."""


def open_file(file: Path, decimal: str = "") -> AbstractSource:
    """A reader of `file`, chosen by its content and its ending.

    **Arguments:** `decimal` is the decimal sign of a text, "" to detect it.
    """
    expected = "expected a file of samples"
    try:
        is_stream = not (stat.S_ISREG(file.stat().st_mode) or file.is_dir())
        head = b""
        if not is_stream:
            with file.open("rb") as stream:
                head = stream.read(1024)
    except FileNotFoundError:
        raise InputError(f"{file}: there is no such file, {expected}.") from None
    except (OSError, ValueError) as error:  # ValueError: of a name that no file can have
        raise InputError(f"{file}: cannot be read ({getattr(error, 'strerror', error)}), {expected}.") from None
    if is_stream:
        raise InputError(f"{file}: found a pipe or a device, {expected} that can be read repeatedly.")
    if head.startswith(b"PK\x03\x04"):
        raise InputError(f"{file}: found a workbook or a ZIP archive, expected the sheet saved as CSV.")
    # Fields of six characters: the mark of a dataset, and its number.
    if dataset := re.match(rb"    -1 *\r?\n {0,5}(\d+)b?\s", head):
        raise InputError(
            f"{file}: found a Universal File (UFF, beginning with dataset {dataset[1].decode()}), which is not read; "
            "expected its time histories exported as CSV or MATLAB arrays."
        )
    # Text last, since any file may be text.
    kinds = [member(_FAMILY, name) for name in sorted(members(_FAMILY), key=lambda name: name == "delimited-text")]
    for kind in kinds:
        if kind.recognises(file, head):
            reader: AbstractReader = kind(file, decimal)
            return reader if reader.in_process else _IsolatedReader(reader)
    known = ", ".join(kind.ending for kind in kinds)
    raise InputError(f"{file}: found an unknown format (it begins with {head[:8]!r}), expected one of {known}.")


class _IsolatedReader(AbstractSource):
    """A file that another process reads, by a `reader` of the same kind."""

    def __init__(self, reader: AbstractReader) -> None:
        self.reader = reader
        self.file = reader.file
        self.place = reader.place  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def kind(self) -> str:
        return self.reader.kind

    def channels(self) -> list[Channel]:
        return self._channels

    @functools.cached_property
    def _channels(self) -> list[Channel]:
        with refusing(self.file, self.reader.expected):
            return [Channel(*channel) for channel, _ in run_isolated(channels_of, self.file, self.kind)]

    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        with refusing(self.file, self.reader.expected):
            for _, rows in run_isolated(blocks_of, self.file, self.kind, list(numbers), first):
                yield Block(rows[:, 1:], rows[:, 0].astype(int))


def channels_of(file: Path, kind: str) -> Pairs:
    """The channels of a `file` of a `kind`, each with an empty array."""
    for channel in member(_FAMILY, kind)(file).channels():
        yield channel, np.zeros(0)


def blocks_of(file: Path, kind: str, numbers: Sequence[int], first: int) -> Pairs:
    """The blocks of a `file` of a `kind`, each as an array: places in the first column, samples in the others."""
    for block in member(_FAMILY, kind)(file).blocks(numbers, first):
        yield None, np.column_stack([block.places, block.values])


def list_channels(file: Path, decimal: str = "") -> tuple[str, list[ChannelSummary]]:
    """The format of `file`, and its channels; the file is read block by block.

    **Arguments:** `decimal` is the decimal sign of a text, "" to detect it.

    **Raises:** `InputError` if the file is missing, broken or of an unknown format.
    """
    reader = open_file(file, decimal)
    channels = reader.channels()
    summaries = [ChannelSummary(c.number, c.name, c.unit, c.interval, c.letter) for c in channels]
    for samples in dict.fromkeys(channel.samples for channel in channels):
        of_length = [s for s, channel in zip(summaries, channels, strict=True) if channel.samples == samples]
        for block in reader.blocks([summary.number for summary in of_length]):
            for summary, values in zip(of_length, block.values.T, strict=True):
                summary.add(values)
    return reader.kind.replace("-", " "), summaries


def name_or_number(given: str) -> str | int:
    """The name of a channel that an option gives, or its number."""
    return int(given) if given.isdecimal() else given


def find_channel(reader: AbstractSource, file: Path, channels: Sequence[Channel], given: str | int) -> Channel:
    """The channel with the name or the number `given`."""
    word = "column" if reader.place == "line" else "channel"
    if isinstance(given, int):
        numbered = {channel.number: channel for channel in channels}
        if given not in numbered:
            listed = ", ".join(map(str, list(numbered)[:20]))
            raise InputError(f"{file}: there is no {word} {given} of numbers, expected one of {listed}.")
        return numbered[given]
    for name_of in (lambda c: c.written, lambda c: c.name, lambda c: c.name.replace(".", "/").rpartition("/")[2]):
        found = [channel for channel in channels if name_of(channel) == given]
        if len(found) == 1:
            return found[0]
        if found:
            raise InputError(f'{file}: found {len(found)} {word}s named "{given}", expected one.')
    if at_fault := reader.header_at_fault(given):
        raise InputError(f"{file}: {at_fault}.")
    named = [channel.name for channel in channels if channel.name != str(channel.number)]
    if not named:
        line = next(reader.blocks([channels[0].number])).places[0]
        raise InputError(
            f"{file}: {reader.place} {line}: found numbers, expected a header that names the {word}s "
            f'("{given}"); or name it by its number: 1, 2, ...'
        )
    raise InputError(f'{file}: there is no {word} "{given}"; {nearest(given, named)}')


def read_samples(
    reader: AbstractSource, file: Path, numbers: Sequence[int], clock: Clock, window: tuple[float, float] | None
) -> Samples:
    """Samples of the channels with these `numbers`, within the `window` [s] where one is given.

    Takes memory for the samples returned and one block.
    """
    low, high = window or (-math.inf, math.inf)
    first = 0
    if clock.number is None and low > clock.start:
        first = max(int((low - clock.start) / clock.interval) - 1, 0)
    read_numbers: list[int] = list(dict.fromkeys([*([] if clock.number is None else [clock.number]), *numbers]))
    selected: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    begin, before, count = clock.start, -math.inf, first
    for block in reader.blocks(read_numbers, first):
        if clock.number is None:
            time = clock.start + clock.interval * np.arange(count, count + len(block.places))
        else:
            time = clock.factor * block.values[:, read_numbers.index(clock.number)]
            known = np.isfinite(time)
            times, places = time[known], block.places[known]
            if math.isfinite(before):
                times, places = np.append(before, times), np.append(places[:1] - 1, places)
            if np.any(np.diff(times) <= 0):
                name = next(channel.name for channel in reader.channels() if channel.number == clock.number)
                check_increasing(file, name, times, places, reader.place)
            begin = float(time[0]) if count == 0 else begin
        count += len(block.places)
        # A sample whose time is no number lies where the one before it does.
        last = np.maximum.accumulate(np.where(np.isfinite(time), np.arange(time.size), -1))
        filled = np.where(last >= 0, time[last], before)
        keep = (filled >= low) & (filled <= high) if window else slice(None)
        columns = [read_numbers.index(number) for number in numbers]
        selected.append((time[keep], block.values[keep][:, columns], block.places[keep]))
        before = filled[-1]
        if before > high:
            break
    if not selected:
        within = f" from {low:g} s to {high:g} s" if window else ""
        raise InputError(f"{file}: found no samples{within}, expected some.")
    time, values, places = (np.concatenate(parts) for parts in zip(*selected, strict=True))
    return Samples(time, values, places, begin, float(before))
