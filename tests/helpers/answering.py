"""What another process runs when tests ask it: nothing but NumPy and pdssjax is imported."""

import os
import warnings
from pathlib import Path

import numpy as np

from pdssjax import InputError, InputWarning
from pdssjax.files.reading_process import Pairs


def numbered(file: Path, count: int, stop: str = "") -> Pairs:
    """Yields `count` pairs, then does what `stop` says."""
    for number in range(count):
        yield [file.name, number, os.getpid()], np.full((2, number), 0.1 * number)
    if stop == "refused":
        raise InputError(f"{file}: found nothing, expected all.")
    if stop == "broken":
        raise RuntimeError("no such thing")
    if stop == "warned":
        warnings.warn("the end is missing", InputWarning, stacklevel=1)
    if stop == "printed":
        os.write(1, b"a remark of a library")
    if stop == "crashed":
        os.abort()
    if stop == "endless":
        while True:
            pass
    if stop == "much":
        np.ones(1 << 28)
