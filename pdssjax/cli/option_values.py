"""Values of options as they are written: whole numbers, numbers with a unit or without, pairs, axes of a sweep."""

import argparse
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TYPE_CHECKING

from ..core import MOST_DRAWN, MOST_POINTS, MOST_SEED, InputError, check_whole, nearest, to_si

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import Float

    from ..core import Quantity

_SHOWN = 40
"""Characters of a value that a message quotes, and digits that a whole number may have."""


def read_whole(text: str, where: str, least: int, most: int = MOST_DRAWN) -> int:
    """The whole number from `least` to `most` that `text` is; **raises** `InputError` that begins with `where`."""
    shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
    if not re.fullmatch(r"[+-]?[0-9]+", text):
        raise InputError(f'{where}: found "{shown}", expected a whole number.')
    if len(text) > _SHOWN:
        raise InputError(f"{where}: found {shown}, expected a whole number from {least} to {most}.")
    check_whole(where, int(text), least, most)
    return int(text)


def whole(least: int, most: int = MOST_DRAWN, word: str = "") -> Callable[[str], int | str]:
    """The `type` of an option of argparse that takes a whole number from `least` to `most`, or a `word`."""

    def read(text: str) -> int | str:
        if word and text == word:
            return text
        try:
            return read_whole(text, "", least, most)
        except InputError as error:
            message = str(error).removeprefix(": ")
            raise argparse.ArgumentTypeError(f'{message[:-1]}, or "{word}".' if word else message) from None

    return read


SEED = whole(0, MOST_SEED)
"""The `type` of an option for a seed of random numbers."""


def number_or_text(text: str) -> float | str:
    """The number that `text` is, which is SI where it has no unit, or else the text."""
    try:
        # Python reads "1_0" as ten.
        return text if "_" in text else float(text)
    except ValueError:
        return text


def read_number(text: str, unit: str, where: str, *, least: float | None = None, above: float | None = None) -> float:
    """The number [SI] that `text` is, with a unit or without, finite."""
    number = to_si(number_or_text(text), unit, where)
    shown = f"{number:g} {unit}".strip()
    if least is not None and number < least:
        raise InputError(f"{where}: found {shown}, expected a number of at least {least:g}.")
    if above is not None and not number > above:
        raise InputError(f"{where}: found {shown}, expected a number above {above:g}.")
    return number


def read_pairs(given: Iterable[str], option: str, quantities: Collection[str], example: str) -> dict[str, str]:
    """The values of an option given as QUANTITY=VALUE, by quantity; `example` shows one in the message of an error."""
    pairs = {}
    for text in given:
        quantity, _, value = (part.strip() for part in text.partition("="))
        if quantity not in quantities or not value:
            *others, last = quantities
            named = f"{', '.join(others)} or {last}"
            raise InputError(f'option {option}: found "{text}", expected {named}, "=" and what it has: "{example}".')
        pairs[quantity] = value
    return pairs


def read_axis(
    path: str, text: str, legal: "Mapping[str, Quantity]", words: Mapping[str, Mapping[str, float]] | None = None
) -> 'Float[np.ndarray, " values"]':
    """The values [SI] of the axis `path`, as `text` says: "20 V:80 V:40", "20 V, 35 V", or a single value.

    **Arguments:** `legal` tells what is declared of each path, `words` what stands for numbers in one of words, such
    as "forward" and "backward".
    """
    import numpy as np

    where = f'sweep: path "{path}"'
    if words is not None and path in words:
        given, numbers = [part.strip() for part in text.split(",")], words[path]
        for word in given:
            if word not in numbers:
                raise InputError(f'{where}: found "{word}"; {nearest(word, numbers)}')
        return np.array([numbers[word] for word in given])
    unit = unit_of(path, legal)
    parts = [part.strip() for part in text.split(":")]
    if len(parts) == 1:
        return np.array([read_number(part.strip(), unit, where) for part in text.split(",")])
    if len(parts) not in (3, 4) or not parts[2].isdecimal() or parts[3:] not in ([], ["log"]):
        raise InputError(
            f'{where}: found "{text}", expected FROM:TO:COUNT such as "20:80:40", FROM:TO:COUNT:log for equal ratios, '
            "values with commas between them, or one value."
        )
    count = read_whole(parts[2], f'{where}: number of values in "{text}"', 1, MOST_POINTS)
    low, high = (read_number(part, unit, where) for part in parts[:2])
    _check_order(low, high, text, where)
    if parts[3:] and not low > 0:
        raise InputError(f'{where}: found "{text}", expected ends above 0 for equal ratios.')
    spaced = np.geomspace if parts[3:] else np.linspace
    return spaced(low, high, count)


def read_range(path: str, text: str, legal: "Mapping[str, Quantity]") -> tuple[float, float]:
    """The ends [SI] of the range of `path` from which a sample is taken, as `text` says: "20 V:80 V"."""
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


def unit_of(path: str, legal: "Mapping[str, Quantity]") -> str:
    """The unit of `path`; **raises** `InputError` where it is unknown."""
    # Quantities of the drive need not be parameters of the study.
    unit = legal[path].unit if path in legal else {"drive.voltage": "V", "drive.frequency": "Hz"}.get(path)
    if unit is None:
        raise InputError(
            f'sweep: found the unknown path "{path}"; {nearest(path, [*legal, "drive.voltage", "drive.frequency"])}'
        )
    return unit
