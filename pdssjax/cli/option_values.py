"""Values of options as they are written: whole numbers, numbers with a unit or without, pairs ("displacement=um")."""

import argparse
import re
from collections.abc import Callable, Collection, Iterable

from ..core import MOST_DRAWN, MOST_SEED, InputError, check_whole, to_si

_WHOLE = re.compile(r"[+-]?[0-9]+")

_SHOWN = 40
"""Characters of a value that a message quotes, and digits that a whole number may have."""


def read_whole(text: str, where: str, least: int, most: int = MOST_DRAWN) -> int:
    """The whole number from `least` to `most` that `text` is; **raises** `InputError` that begins with `where`."""
    shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
    if not _WHOLE.fullmatch(text):
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
            told = str(error).removeprefix(": ")
            raise argparse.ArgumentTypeError(f'{told[:-1]}, or "{word}".' if word else told) from None

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
    """The number [SI] that `text` is, with a unit or without, finite.

    **Raises:** `InputError` that begins with `where` for anything else, and for one that is less than `least`, or not
    `above` another one, where these are given.
    """
    number = to_si(number_or_text(text), unit, where)
    shown = f"{number:g} {unit}".strip()
    if least is not None and number < least:
        raise InputError(f"{where}: found {shown}, expected a number of at least {least:g}.")
    if above is not None and not number > above:
        raise InputError(f"{where}: found {shown}, expected a number above {above:g}.")
    return number


def read_pairs(given: Iterable[str], option: str, quantities: Collection[str], example: str) -> dict[str, str]:
    """Texts by quantity, one of the `quantities`, from what was `given` for an option, each such as the `example`.

    **Raises:** `InputError` for another quantity, or one without a text.
    """
    pairs = {}
    for text in given:
        quantity, _, value = (part.strip() for part in text.partition("="))
        if quantity not in quantities or not value:
            *others, last = quantities
            named = f"{', '.join(others)} or {last}"
            raise InputError(f'option {option}: found "{text}", expected {named}, "=" and what it has: "{example}".')
        pairs[quantity] = value
    return pairs
