"""Numbers of texts whose thousands may be divided: "1.070,5", "1,070.5", and "1.070", which is either.

Where both signs stand in a number, or one stands twice, it is clear what divides thousands.  A single one is taken for
that only where the user has told the decimal sign.  A column in which it always stands before three digits, beside
whole numbers without it, has thousands more likely than decimals: then nobody but the user can tell.
"""

import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.IGNORECASE)

_GROUPED = re.compile(r"([+-]?[1-9]\d{0,2})((?:,\d{3})+)(\.\d*)?")

_SWAPPED = str.maketrans(",.", ".,")


def plain_number(cell: str, decimal: str, sure: bool = False) -> str:
    """A cell as a number with a decimal point and nothing between its thousands; "" where it is none.

    **Arguments:** `decimal` is the decimal sign, of which the user is `sure`: then the other one divides thousands
    even where it stands once.
    """
    text = cell.translate(_SWAPPED) if decimal == "," else cell
    grouped = _GROUPED.fullmatch(text) if "," in text else None
    if grouped is None:
        return text if _NUMBER.fullmatch(text) else ""
    whole, groups, fraction = grouped.groups()
    if sure or fraction or groups.count(",") > 1:
        return whole + groups.replace(",", "") + (fraction or "")
    return ""


class Grouped(NamedTuple):
    """A number that may be read in two ways."""

    place: int
    position: int
    """Index of the column, from 0."""
    text: str


class GroupedColumns:
    """Looks for columns in which thousands may be divided, a block at a time."""

    def __init__(self, positions: Sequence[int], decimal: str) -> None:
        self._positions = list(dict.fromkeys(positions))
        self._decimal = decimal
        self._group = re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(decimal)}\d{{3}}")
        # Columns of which no number has shown that its sign is a decimal one.
        self._open = set(self._positions)
        self._whole: set[int] = set()
        self._first: dict[int, Grouped] = {}

    def look(
        self,
        places: Int[np.ndarray, " samples"],
        values: Float[np.ndarray, "samples columns"],
        lines: Sequence[str],
        cells: Callable[[str], Sequence[str]],
    ) -> Grouped | None:
        """The first number that may be read in two ways, of a column that has nothing but such and whole numbers.

        **Arguments:** `values` are the columns as they were read, `lines` what they were read from, and `cells` gives
        those of a line.
        """
        for number, position in enumerate(self._positions):
            if position in self._open and _shows_decimals(values[:, number]):
                self._open.discard(position)
        # Whole numbers can only be groups where three zeros follow the sign.
        zeros = f"{self._decimal}000"
        left = [p for k, p in enumerate(self._positions) if p in self._open and not _is_whole(values[:, k])]
        if self._open and (left or any(zeros in line for line in lines)):
            self._look_at_cells(places, lines, cells)
        elif self._open:
            self._whole |= {
                p for k, p in enumerate(self._positions) if p in self._open and np.any(np.isfinite(values[:, k]))
            }
        return next((self._first[p] for p in self._positions if p in self._open & self._whole & set(self._first)), None)

    def _look_at_cells(
        self, places: Int[np.ndarray, " samples"], lines: Sequence[str], cells: Callable[[str], Sequence[str]]
    ) -> None:
        for place, line in zip(places, lines, strict=True):
            row = cells(line)
            for position in list(self._open):
                cell = row[position] if position < len(row) else ""
                if self._group.fullmatch(cell):
                    self._first.setdefault(position, Grouped(int(place), position, cell))
                elif self._decimal in cell or len(cell.lstrip("+-")) > 3:
                    self._open.discard(position)
                elif cell.lstrip("+-").isdecimal():
                    self._whole.add(position)
            if not self._open:
                return


def _shows_decimals(column: Float[np.ndarray, " samples"]) -> bool:
    """Whether numbers as they were read show that their column has decimals, or thousands that nothing divides."""
    size = np.abs(column[np.isfinite(column)])
    broken = size[size != np.round(size)]
    return bool(
        np.any(size >= 1000.0) or np.any(broken < 1.0) or np.any(np.abs(1e3 * broken - np.round(1e3 * broken)) > 1e-6)
    )


def _is_whole(column: Float[np.ndarray, " samples"]) -> bool:
    return bool(np.all(np.isnan(column) | (column == np.round(column))))
