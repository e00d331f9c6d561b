"""Values of options as they are written: numbers with a unit or without, and pairs such as "displacement=um"."""

from collections.abc import Collection, Iterable

from ..core import InputError, to_si


def number_or_text(text: str) -> float | str:
    """The number that `text` is, which is SI where it has no unit, or else the text."""
    try:
        return float(text)
    except ValueError:
        return text


def read_number(text: str, unit: str, where: str) -> float:
    """The number [SI] that `text` is, with a unit or without; **raises** `InputError` that begins with `where`."""
    return to_si(number_or_text(text), unit, where)


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
