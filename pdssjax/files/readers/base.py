"""The interface of readers: a file of an instrument as a list of channels.

A member reads one format.  It opens the file for each call, so that nothing stays open, and yields samples in blocks,
so that a file need not fit into memory.  All formats but text are read in a process of their own.
"""

import abc
import contextlib
import importlib
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import ClassVar, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from ...core import InputError, factor, member_name


class Channel(NamedTuple):
    """One channel of a file."""

    name: str
    """The name that the file gives the channel; its number in the file where it has no name."""
    number: int
    """The number by which a study may name the channel, from 1: its column in a table, else its place in the list."""
    unit: str
    """The unit as the file writes it, not checked; "" where it says none."""
    samples: int | None
    """Number of samples; None where only reading them tells."""
    interval: float | None = None
    """Interval between samples [s], where the file has a clock instead of times."""
    start: float = 0.0
    """Time of the first sample [s] on that clock."""
    written: str = ""
    """The name with the remarks in brackets beside it."""
    letter: bool = False
    """Whether the unit is only the channel's name of one letter, which may be a symbol: V of a velocity."""

    def measures(self, unit: str) -> bool:
        """Whether its unit is given, is more than a `letter`, and converts to `unit`."""
        try:
            return bool(self.unit) and not self.letter and factor(self.unit, unit, "") > 0
        except InputError:
            return False


class Block(NamedTuple):
    """Consecutive samples of some channels."""

    values: Float[np.ndarray, "samples channels"]
    """In the units of the file; NaN where there is no number."""
    places: Int[np.ndarray, " samples"]
    """The line or the number of each sample, from 1."""


BLOCK = 200_000
"""Samples of a block."""


class AbstractSource(abc.ABC):
    """A file of samples, read in this or in another process."""

    file: Path
    place: ClassVar[str] = "sample"
    """The unit that `Block.places` counts, as messages call it."""

    @property
    @abc.abstractmethod
    def kind(self) -> str:
        """The format: the name of the member that reads it."""

    @abc.abstractmethod
    def channels(self) -> list[Channel]:
        """The channels, in the order of the file.

        **Raises:** `InputError` if the file is broken, holds no samples, or a library to read it is missing.
        """

    @abc.abstractmethod
    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        """The samples of the channels with these `numbers`, from the sample `first` (from 0) on.

        **Raises:** `InputError` if the file is broken, or the channels have different lengths.
        """

    def header_at_fault(self, name: str) -> str:
        """The fault of a header with a `name` that no channel has; "" for none."""
        return ""

    def written(self, place: int, number: int) -> str:
        """The text of the file at a `place` of the channel `number`; "" where it has none."""
        return ""


class AbstractReader(AbstractSource):
    """A format of files; the final members are made from the path of a file and the decimal sign given."""

    ending: ClassVar[str]
    """Endings of the names of files of this format, for messages: "`.tdms`"."""
    expected: ClassVar[str]
    """The name of such a file in messages: "a TDMS file"."""
    in_process: ClassVar[bool] = False
    """Whether the calling process reads the file: for formats whose reader no file can crash."""

    def __init__(self, file: Path, decimal: str = "") -> None:
        """A reader of `file`; nothing is read yet.  `decimal` is "," or ".", or "" to detect it."""
        self.file = file
        self.decimal = decimal

    @property
    def kind(self) -> str:
        return member_name(type(self))

    @classmethod
    @abc.abstractmethod
    def recognises(cls, file: Path, head: bytes) -> bool:
        """Whether the `file`, which begins with the bytes `head`, has this format."""


def library(module: str, extra: str, file: Path) -> ModuleType:
    """The `module` of an optional library.

    **Raises:** `InputError` with the line that installs it, where it is missing.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        package = module.split(".")[0]
        raise InputError(
            f"{file}: found a file that the library {package} reads, which is not installed; "
            f'expected: pip install "pdssjax[{extra}]"'
        ) from None


@contextlib.contextmanager
def refusing(file: Path, expected: str) -> Iterator[None]:
    """Turn whatever a library raises on an unreadable file into an `InputError` of one line."""
    try:
        yield
    except InputError:
        raise
    except MemoryError:
        raise InputError(
            f"{file}: found more data than memory can hold, as a broken file may claim, expected {expected}."
        ) from None
    except FileNotFoundError:
        raise InputError(f"{file}: there is no such file, expected {expected}.") from None
    except PermissionError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}), expected {expected}.") from None
    except Exception as error:  # libraries raise errors of many types
        reason = " ".join(str(error).replace(f"{file.parent}{os.sep}", "").split())[:120] or type(error).__name__
        raise InputError(f"{file}: found a broken file ({reason}), expected {expected}.") from None


def blocks_of(
    file: Path, lengths: dict[str, int], first: int, read: Callable[[slice], Sequence[Float[np.ndarray, " samples"]]]
) -> Iterator[Block]:
    """The samples from `first` (from 0) on of channels with these `lengths`, by name; `read` gives them for a slice.

    **Raises:** `InputError` where lengths differ.
    """
    count = next(iter(lengths.values()))
    if any(length != count for length in lengths.values()):
        listed = ", ".join(f'{length} in "{name}"' for name, length in lengths.items())
        raise InputError(f"{file}: found {listed}, expected channels of one length.")
    for begin in range(first, count, BLOCK):
        end = min(begin + BLOCK, count)
        yield Block(np.column_stack(read(slice(begin, end))), np.arange(begin + 1, end + 1))
