"""Errors about files that cannot be read: a library that is missing, a file that is broken."""

import contextlib
import importlib
import os
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

from ...core import InputError


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
            f"{file}: found more than memory has room for, as a broken file may claim, expected {expected}."
        ) from None
    except FileNotFoundError:
        raise InputError(f"{file}: there is no such file, expected {expected}.") from None
    except PermissionError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}), expected {expected}.") from None
    except Exception as error:  # libraries raise errors of many types
        said = " ".join(str(error).replace(f"{file.parent}{os.sep}", "").split())[:120] or type(error).__name__
        raise InputError(f"{file}: found a broken file ({said}), expected {expected}.") from None


def same_length(file: Path, lengths: dict[str, int]) -> int:
    """How many samples channels have, by their names.

    **Raises:** `InputError` where they differ.
    """
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f'{count} in "{name}"' for name, count in lengths.items())
        raise InputError(f"{file}: found {listed}, expected channels with as many samples.")
    return next(iter(lengths.values()))
