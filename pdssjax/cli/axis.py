"""Axes of a sweep, written as FROM:TO:COUNT or as a list, and ranges of a sample, written as FROM:TO."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ..core import MOST_POINTS, InputError, Quantity, nearest
from .option_values import read_number, read_whole

_EXPECTED = (
    'expected FROM:TO:COUNT such as "20:80:40", FROM:TO:COUNT:log for equal ratios, values with commas between them, '
    "or one value"
)


def read_axis(
    path: str, text: str, legal: Mapping[str, Quantity], words: Mapping[str, Mapping[str, float]] | None = None
) -> Float[np.ndarray, " values"]:
    """The values [SI] of the axis `path`, as `text` says: "20 V:80 V:40", "20 V, 35 V", or a single value.

    **Arguments:** `legal` tells what is declared of each path, `words` what stands for numbers in one of words, such
    as "forward" and "backward".

    **Raises:** `InputError` for an unknown path, a text that is no range, ends the wrong way round, or a unit that
    does not fit.
    """
    where = f'sweep: path "{path}"'
    if words is not None and path in words:
        return np.array([_word(part.strip(), words[path], where) for part in text.split(",")])
    unit = unit_of(path, legal)
    parts = [part.strip() for part in text.split(":")]
    if len(parts) == 1:
        return np.array([read_number(part.strip(), unit, where) for part in text.split(",")])
    if len(parts) not in (3, 4) or not parts[2].isdecimal() or parts[3:] not in ([], ["log"]):
        raise InputError(f'{where}: found "{text}", {_EXPECTED}.')
    count = read_whole(parts[2], f'{where}: number of values in "{text}"', 1, MOST_POINTS)
    low, high = (read_number(part, unit, where) for part in parts[:2])
    _check_order(low, high, text, where)
    if parts[3:] and not low > 0:
        raise InputError(f'{where}: found "{text}", expected ends above 0 for equal ratios.')
    spaced = np.geomspace if parts[3:] else np.linspace
    return spaced(low, high, count)


def read_range(path: str, text: str, legal: Mapping[str, Quantity]) -> tuple[float, float]:
    """The ends [SI] of the range of `path` from which a sample is taken, as `text` says: "20 V:80 V".

    **Raises:** `InputError` as `read_axis` does.
    """
    where = f'sweep: path "{path}"'
    unit, parts = unit_of(path, legal), [part.strip() for part in text.split(":")]
    if len(parts) != 2:
        raise InputError(f'{where}: found "{text}", expected FROM:TO such as "20:80", of which the sample is taken.')
    low, high = (read_number(part, unit, where) for part in parts)
    _check_order(low, high, text, where)
    return low, high


def _check_order(low: float, high: float, text: str, where: str) -> None:
    if low > high:
        raise InputError(f'{where}: found "{text}", expected the lower end first.')


def unit_of(path: str, legal: Mapping[str, Quantity]) -> str:
    """The unit of `path`; **raises** `InputError` where it is unknown."""
    # Quantities of the drive need not be parameters of the study.
    unit = legal[path].unit if path in legal else {"drive.voltage": "V", "drive.frequency": "Hz"}.get(path)
    if unit is None:
        raise InputError(
            f'sweep: found the unknown path "{path}"; {nearest(path, [*legal, "drive.voltage", "drive.frequency"])}'
        )
    return unit


def _word(text: str, words: Mapping[str, float], where: str) -> float:
    if text not in words:
        raise InputError(f'{where}: found "{text}"; {nearest(text, words)}')
    return words[text]
