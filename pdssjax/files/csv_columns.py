"""Reads named columns of a CSV file as SI numbers.

Commas, semicolons or tabs separate the columns, whichever splits the header most.  Lines
that start with "#" are remarks; where the numbers come without a header, the last remark
above them is the header.  A remark in brackets may follow a column's name,
"time_s (dSPACE clock, corrected)", and is not part of it.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from ..core import InputError, column_unit, factor, nearest

Line = tuple[int, str]

Row = tuple[int, list[str]]


def read_csv(
    file: Path, columns: Mapping[str, str], si_units: Mapping[str, str], units: Mapping[str, str]
) -> tuple[dict[str, Float[np.ndarray, " samples"]], Int[np.ndarray, " samples"]]:
    """Columns of `file` in SI, and the line on which each sample stands.

    **Arguments:** `columns` maps a quantity, such as "time", to the name of its column;
    `si_units` maps it to the SI unit wanted; `units` to the unit in the file, and where it
    says nothing, the column's name ends in it ("time_s").

    **Returns:** the numbers by quantity, and those of their lines, from 1.

    **Raises:** `InputError` if the file or a column is missing, if there are no samples,
    or if a row has another number of cells than the header or a cell that is no finite
    number.
    """
    header, rows = _rows(file)
    data = {}
    for quantity, column in columns.items():
        where = f'{file}: column "{column}"'
        index = _position(file, header, column)
        name = units.get(quantity) or column_unit(_bare(column))
        if not name:
            raise InputError(
                f"{where}: found no unit, expected a column named like "
                f'"{_bare(column)}_{si_units[quantity]}" or the key "{quantity}" in [record.units].'
            )
        scale = factor(name, si_units[quantity], where)
        data[quantity] = scale * np.array([_cell(file, row, index, column) for row in rows])
    return data, np.array([line for line, _ in rows])


def column_names(file: Path) -> list[str]:
    """The names of the columns of `file`, without their remarks.

    **Raises:** `InputError` if the file is missing or holds no table of numbers.
    """
    return [_bare(name) for name in _rows(file)[0]]


def _lines(file: Path) -> list[Line]:
    try:
        text = file.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputError(f"{file}: there is no such file, expected a CSV file.") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{file}: found {error.reason} at byte {error.start}, expected UTF-8 text.") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}), expected a CSV file.") from None
    numbered = enumerate(text.splitlines(), start=1)
    return [(number, line) for number, line in numbered if line.strip()]


def _header(file: Path, lines: list[Line]) -> tuple[str, list[Line]]:
    """The header, without its mark, and the lines of numbers below it."""
    if not lines:
        raise InputError(f"{file}: the file is empty, expected a header line and numbers.")
    body = [line for line in lines if not line[1].startswith("#")]
    # A first line without any number is the header; otherwise a remark above must be.
    if body and not any(map(_is_number, re.split(r"[,;\t]", _bare(body[0][1])))):
        return body[0][1], body[1:]
    above = [text for number, text in lines if text.startswith("#") and (not body or number < body[0][0])]
    if not above:
        raise InputError(f"{file}: line {body[0][0]}: found numbers, expected a header that names the columns.")
    return above[-1].lstrip("# "), body


def _rows(file: Path) -> tuple[list[str], list[Row]]:
    """The names in the header, and the cells of every row with the number of its line."""
    header, body = _header(file, _lines(file))
    if not body:
        raise InputError(f"{file}: found a header but no samples below it, expected a row of numbers for each.")
    separator = max(",;\t", key=_bare(header).count)
    names = [_cleaned(name) for name in re.split(rf"{separator}(?![^(]*\))", header)]
    rows = [(number, [_cleaned(cell) for cell in text.split(separator)]) for number, text in body]
    for number, cells in rows:
        if len(cells) != len(names):
            raise InputError(
                f"{file}: line {number}: found {len(cells)} cells, expected {len(names)} as in the header."
            )
    return names, rows


def _position(file: Path, header: list[str], column: str) -> int:
    # The full name, remark included, tells apart columns that differ only in the remark.
    for names in (header, [_bare(name) for name in header]):
        if names.count(column) == 1:
            return names.index(column)
        if column in names:
            raise InputError(f'{file}: found {names.count(column)} columns named "{column}", expected one.')
    known = [_bare(name) for name in header]
    raise InputError(f'{file}: there is no column "{column}"; {nearest(column, known)}')


def _cell(file: Path, row: Row, index: int, column: str) -> float:
    line, cells = row
    try:
        value = float(cells[index])
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        found = f'"{cells[index]}"' if cells[index] else "an empty cell"
        raise InputError(f'{file}: line {line}, column "{column}": found {found}, expected a finite number.')
    return value


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _cleaned(cell: str) -> str:
    return cell.strip().strip('"').strip()


def _bare(name: str) -> str:
    """A name, or a whole header, without its remarks in brackets."""
    return re.sub(r"\s*\([^)]*\)", "", name)
