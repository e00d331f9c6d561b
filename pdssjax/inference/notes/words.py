"""Numbers, names and lists as sentences have them."""

from collections.abc import Iterable, Sequence

from ...core import display_unit
from ...study import FittedRecord


def shown(number: float, unit: str) -> str:
    """A number in SI as people read it, with its unit."""
    name, factor = display_unit(unit)
    return f"{number * factor:.4g} {name}".rstrip()


def listed(texts: Iterable[str]) -> str:
    """One, two and three, as a sentence has them."""
    texts = list(texts)
    return " and ".join([", ".join(texts[:-1]), texts[-1]]) if len(texts) > 1 else "".join(texts)


def quoted(records: Sequence[FittedRecord]) -> str:
    """The names of records."""
    return listed(f'"{record.name}"' for record in records)


def about_better_optimum(when: str, chi2: float, path: str, number: float) -> str:
    """A note on a point below the optimum, with the `number` [SI] of one parameter there."""
    return f"{when} a better optimum was found (chi-square {chi2:.6g}): start the fit from {path} = {number:.6g} in SI."
