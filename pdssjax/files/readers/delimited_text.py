"""Tables of text in the dialects of instruments and spreadsheets (CSV, TSV), which `_dialect` detects.

Semicolons, commas, tabs or blanks, decimal point or comma, UTF-8, UTF-16 or Latin-1, preambles, a row of units, a
header or none, the layouts of oscilloscopes.  A file is read a part at a time.

Thousands may be separated: "1.070,5", "1,070.5", and "1.070", which is ambiguous.  A number with both signs, or twice
the same, is clear.  A single sign separates thousands only where the user gives the decimal sign.  A column where the
sign always has three digits after it, beside whole numbers without it, likely has separated thousands; there the user
must decide.
"""

import functools
import re
from collections.abc import Callable, Iterator, Sequence
from itertools import compress, islice
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from ...core import InputError
from ._dialect import HEAD, Dialect, cells_of, dialect_of, plain_number, with_points
from .base import BLOCK, AbstractReader, Block, Channel, refusing


class DelimitedText(AbstractReader):
    """A table of text."""

    ending = ".csv"
    expected = "a table of text"
    in_process = True
    place = "line"

    @classmethod
    def recognises(cls, file: Path, head: bytes) -> bool:
        return file.suffix.lower() in (".csv", ".txt", ".tsv", ".dat", ".asc", ".prn") or b"\0" not in head[:512]

    @functools.cached_property
    def dialect(self) -> Dialect:
        """The dialect of the file."""
        with refusing(self.file, self.expected), self.file.open("rb") as stream:
            return dialect_of(self.file, stream.read(HEAD), self.decimal)

    def channels(self) -> list[Channel]:
        start, interval = self.dialect.clock or (0.0, None)
        return [
            Channel(c.name or str(c.position + 1), c.position + 1, c.unit, None, interval, start, c.written, c.letter)
            for c in self.dialect.columns
        ]

    def blocks(self, numbers: Sequence[int], first: int = 0) -> Iterator[Block]:
        dialect, positions = self.dialect, [number - 1 for number in numbers]
        grouped = None if self.decimal else _GroupedColumns(positions, dialect.decimal)
        with (
            refusing(self.file, self.expected),
            self.file.open(encoding=dialect.encoding, errors="replace", newline=None) as stream,
        ):
            count = sum(1 for _ in islice(stream, dialect.skipped))
            while lines := list(islice(stream, BLOCK)):
                places = np.arange(count + 1, count + len(lines) + 1)
                count += len(lines)
                holds = [not line.isspace() and not line.startswith("#") and line != "" for line in lines]
                places, samples = places[holds], list(compress(lines, holds))
                if first >= len(samples):
                    first -= len(samples)
                    continue
                places, samples, first = places[first:], samples[first:], 0
                if samples:
                    values = self._numbers(places, samples, positions)
                    if grouped is not None:
                        self._check_thousands(grouped, places, values, samples)
                    yield Block(values, places)

    def written(self, place: int, number: int) -> str:
        with self.file.open(encoding=self.dialect.encoding, errors="replace", newline=None) as stream:
            row = cells_of(next(islice(stream, place - 1, None), ""), self.dialect.separator)
        return row[number - 1] if number <= len(row) else ""

    def header_at_fault(self, name: str) -> str:
        above, width = self.dialect.above, self.dialect.width
        if name not in above:
            return ""
        if len(above) == width:
            line = self.dialect.skipped + 1
            found = self.written(line, above.index(name) + 1)
            return f'line {line}, column "{name}": found "{found}", expected numbers' if found else ""
        comma = "; are decimal commas among them?" if self.dialect.separator == "," and width > len(above) else ""
        return f"line {self.dialect.skipped + 1}: found {width} cells, expected {len(above)} as in the header{comma}"

    def _numbers(self, places: np.ndarray, lines: list[str], positions: list[int]) -> np.ndarray:
        """The cells of some columns as numbers or NaN; **raises** `InputError` for rows of another width."""
        separator, width = self.dialect.separator, self.dialect.width
        if separator != " " and any('"' in line for line in lines):
            # Line by line, since an unclosed quote would swallow the lines after it.
            lines = ["\t".join(cells_of(line, separator)) for line in lines]
            separator = "\t"
        cells = [len(line.split()) if separator == " " else line.count(separator) + 1 for line in lines]
        if any(count != width for count in cells):
            self._check_widths(places, lines, separator, cells)
        pointed = lines
        if self.dialect.decimal == ",":
            pointed = with_points("\n".join(line.rstrip("\n") for line in lines)).split("\n")
        try:
            delimiter = None if separator == " " else separator
            return np.loadtxt(pointed, delimiter=delimiter, usecols=positions, comments=None, ndmin=2)
        except ValueError:
            number = lambda cell: float(plain_number(cell, self.dialect.decimal, bool(self.decimal)) or "nan")
            rows = (cells_of(line, separator) for line in lines)
            return np.array([[number(row[j]) if j < len(row) else np.nan for j in positions] for row in rows])

    def _check_thousands(
        self, grouped: "_GroupedColumns", places: np.ndarray, values: np.ndarray, lines: list[str]
    ) -> None:
        """**Raises** `InputError` for a column in which thousands may be separated, so that the user must decide."""
        found = grouped.first_ambiguous(places, values, lines, lambda line: cells_of(line, self.dialect.separator))
        if found is None:
            return
        place, position, text = found
        name = {channel.number: channel.name for channel in self.channels()}.get(position + 1, position + 1)
        sign, other = ("comma", ".") if self.dialect.decimal == "," else ("point", ",")
        raise InputError(
            f'{self.file}: line {place}, column "{name}": found "{text}" in a column that has whole '
            f'numbers, and a {sign} before three digits only: it may separate thousands.  Expected decimal = "{other}" '
            f'in the record (or --decimal "{other}") if it does, decimal = "{self.dialect.decimal}" if it is the '
            "decimal sign."
        )

    def _check_widths(self, places: np.ndarray, lines: list[str], separator: str, cells: list[int]) -> None:
        least = 1 + max(column.position for column in self.dialect.columns)
        for place, line, count in zip(places, lines, cells, strict=True):
            if count == self.dialect.width:
                continue
            # Between blanks no cell is empty: a missing cell moves all after it.
            filled = count if separator == " " else len(line.rstrip(f" \r\n{separator}").split(separator))
            if filled > self.dialect.width or count < least:
                found = f"{count} cell{'s' * (count > 1)}"
                raise InputError(
                    f"{self.file}: line {place}: found {found}, expected {self.dialect.width} as in the header."
                )


class _GroupedColumns:
    """Finds columns in which thousands may be separated, a block at a time."""

    def __init__(self, positions: Sequence[int], decimal: str) -> None:
        self._positions = list(dict.fromkeys(positions))
        self._decimal = decimal
        self._group = re.compile(rf"[+-]?[1-9]\d{{0,2}}{re.escape(decimal)}\d{{3}}")
        self._open = set(self._positions)
        """Columns without a number that shows its sign to be a decimal sign."""
        self._whole: set[int] = set()
        """Columns with a whole number."""
        self._first: dict[int, tuple[int, int, str]] = {}
        """The first ambiguous number of each column."""

    def first_ambiguous(
        self,
        places: Int[np.ndarray, " samples"],
        values: Float[np.ndarray, "samples columns"],
        lines: Sequence[str],
        cells: Callable[[str], Sequence[str]],
    ) -> tuple[int, int, str] | None:
        """The first ambiguous number in a column that has only ambiguous and whole numbers.

        **Arguments:** `values` are the columns as numbers, `lines` their text, and `cells` splits a line.

        **Returns:** the line, the index of the column from 0, and the text of the number.
        """
        columns = dict(zip(self._positions, values.T, strict=False))
        self._open -= {position for position, column in columns.items() if _shows_decimals(column)}
        is_whole = lambda column: np.all(np.isnan(column) | (column == np.round(column)))
        # A whole number is ambiguous only with three zeros after the sign.
        zeros = f"{self._decimal}000"
        if not all(is_whole(columns[p]) for p in self._open) or (self._open and any(zeros in line for line in lines)):
            self._classify_cells(places, lines, cells)
        else:
            self._whole |= {position for position in self._open if np.any(np.isfinite(columns[position]))}
        return next((self._first[p] for p in self._positions if p in self._open & self._whole & set(self._first)), None)

    def _classify_cells(
        self, places: Int[np.ndarray, " samples"], lines: Sequence[str], cells: Callable[[str], Sequence[str]]
    ) -> None:
        for place, line in zip(places, lines, strict=True):
            row = cells(line)
            for position in list(self._open):
                cell = row[position] if position < len(row) else ""
                if self._group.fullmatch(cell):
                    self._first.setdefault(position, (int(place), position, cell))
                elif self._decimal in cell or len(cell.lstrip("+-")) > 3:
                    self._open.discard(position)
                elif cell.lstrip("+-").isdecimal():
                    self._whole.add(position)
            if not self._open:
                return


def _shows_decimals(column: Float[np.ndarray, " samples"]) -> bool:
    """Whether numbers show that their column has decimals, or thousands without separators."""
    size = np.abs(column[np.isfinite(column)])
    broken = size[size != np.round(size)]
    return bool(
        np.any(size >= 1000.0) or np.any(broken < 1.0) or np.any(np.abs(1e3 * broken - np.round(1e3 * broken)) > 1e-6)
    )
