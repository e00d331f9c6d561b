"""The dialect of a table of text: encoding, separator, decimal sign, first line of samples, names and units.

The first lines determine it: separator and decimal sign are those with most numbers among the cells, in rows of one
width.  Lines above the first row of numbers are a preamble.  A row of words of the same width right above the numbers
has the names, or the units with the names above.  Lines that begin with "#" are remarks; without another header, the
last remark above the numbers is the header.
"""

import csv
import functools
import re
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from ...core import InputError, unit_named

HEAD, _LINES = 1 << 18, 400
"""Bytes and lines that are examined."""

_KINDS = [(";", ","), (";", "."), ("\t", "."), ("\t", ","), (",", "."), (" ", "."), (" ", ","), (",", ",")]
"""Separators with decimal signs; of equal scores the first is taken."""

_BRACKETS = re.compile(r"\s*(\([^)]*\)|\[[^\]]*\])")

_UNITS_ALONE = set("s ms us µs μs ns v mv kv m mm um µm μm nm n mn a ma second seconds sec volt volts".split())
"""Units that may be the whole header of a column."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.IGNORECASE)

_GROUPED = re.compile(r"([+-]?[1-9]\d{0,2})((?:,\d{3})+)(\.\d*)?")

_CLOCKS = ("t", "time", "zeit", "temps")
"""Names of a clock."""


class Column(NamedTuple):
    """One column that holds numbers."""

    position: int
    """Index of the column, from 0."""
    name: str
    """The header without brackets; "" where there is none."""
    written: str
    """The header as it stands in the file."""
    unit: str
    letter: bool = False
    """Whether the unit is only a name of one letter beside other symbols: V of "t, x, V" may be a velocity."""


class Dialect(NamedTuple):
    """How to read a table of text."""

    encoding: str
    separator: str
    """ "," ";" or a tab; " " stands for any blanks."""
    decimal: str
    skipped: int
    """Lines above the first sample."""
    width: int
    """Number of cells in a row."""
    columns: tuple[Column, ...]
    named: bool
    """Whether columns have names."""
    above: tuple[str, ...]
    """Cells of the line right above the samples."""
    clock: tuple[float, float] | None
    """Start and interval [s] in the preamble (Rigol)."""


def encoding_of(file: Path, head: bytes) -> str:
    """The encoding of text that begins with `head`."""
    for mark, name in ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if head.startswith(mark):
            return name
    if head[:4096].count(0) > 0.3 * len(head[:4096]):
        return "utf-16-le" if head[1:2] == b"\0" else "utf-16-be"
    if control := re.search(rb"[\x00-\x08\x0e-\x1f]", head):
        raise InputError(
            f"{file}: found the byte {head[control.start()]} at byte {control.start()}, "
            "expected text, or a file of a known format."
        )
    try:
        head.decode("utf-8")
    except UnicodeDecodeError as error:
        # The last character may be cut.
        return "utf-8" if len(head) >= HEAD and error.start > len(head) - 8 else "cp1252"
    return "utf-8"


def dialect_of(file: Path, head: bytes, decimal: str) -> Dialect:
    """The dialect of a table that begins with `head`; `decimal` is "" to detect it."""
    encoding = encoding_of(file, head)
    text = head.decode(encoding, errors="replace")
    # Not `splitlines`, which also splits at characters that end no line of a file.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")[:_LINES]
    if len(head) >= HEAD and len(lines) < _LINES:
        lines = lines[:-1] or lines  # the last one is cut
    if not any(line.strip() for line in lines):
        raise InputError(f"{file}: the file is empty, expected a header line and numbers.")
    for number, line in enumerate(lines, start=1):
        count = 1 + max(line.count(separator) for separator, _ in _KINDS)
        if count > 10_000:
            raise InputError(f"{file}: line {number}: found {count} cells, expected 10000 at most.")
    kinds = [kind for kind in _KINDS if decimal in ("", kind[1])]
    # All separators that do not occur score the same: each line is one cell.
    absent = [separator for separator, _ in kinds if not any(separator in line for line in lines)]
    score = functools.cache(lambda separator, decimal: _score(lines, separator, decimal))
    scores = [score(absent[0] if separator in absent else separator, sign) for separator, sign in kinds]
    best = max(scores)
    separator, sign = kinds[scores.index(best)]
    if best <= 0:
        number, last = next((k, line) for k, line in reversed(list(enumerate(lines, start=1))) if line.strip())
        if moment := re.search(r"\d{4}-\d\d?-\d\d?([T ]\d\d:[\d:.]+)?|\d+:\d\d[\d:.]*", last):
            found = f'line {number}: found "{moment[0]}", a date or the time of a clock'
            raise InputError(f"{file}: {found}, expected times in seconds.")
        raise InputError(f"{file}: found a header but no samples below it, expected a row of numbers for each.")
    if (separator, sign) == (",", ".") and _is_one_column(lines):
        separator, sign = ";", ","
    return _table(lines, encoding, separator, sign)


def cells_of(line: str, separator: str, header: bool = False) -> list[str]:
    """The cells of a line; in a `header`, brackets protect separators."""
    if separator == " ":
        return line.split()
    if '"' in line:
        try:
            return [cell.strip().strip('"').strip() for cell in next(csv.reader([line], delimiter=separator), [])]
        except csv.Error:  # a cell longer than the limit of the library
            return [cell.strip().strip('"') for cell in line.split(separator)]
    if header and "(" in line:
        masked = re.sub(r"\([^()]*\)", lambda inside: inside[0].replace(separator, "\0"), line)
        return [part.strip().replace("\0", separator) for part in masked.split(separator)]
    return [part.strip() for part in line.split(separator)]


def plain_number(cell: str, decimal: str, sure: bool = False) -> str:
    """A cell as a number with a decimal point and without separators of thousands; "" where it is no number.

    **Arguments:** `decimal` is the decimal sign; if it is `sure`, the other sign separates thousands even where it
    occurs once.
    """
    text = cell.translate(str.maketrans(",.", ".,")) if decimal == "," else cell
    grouped = _GROUPED.fullmatch(text) if "," in text else None
    if grouped is None:
        return text if _NUMBER.fullmatch(text) else ""
    whole, groups, fraction = grouped.groups()
    if sure or fraction or groups.count(",") > 1:
        return whole + groups.replace(",", "") + (fraction or "")
    return ""


def is_number(cell: str, decimal: str) -> bool:
    """Whether a cell may be a number, also with separators of thousands."""
    return plain_number(cell, decimal, sure=True) != ""


def with_points(text: str) -> str:
    """Text with points for decimal commas, and "?" for points, which makes their cells no numbers."""
    return text.replace(".", "?").replace(",", ".")


def _plain(lines: Sequence[str]) -> list[str]:
    return [line for line in lines if line.strip() and not line.lstrip().startswith("#")]


def _score(lines: Sequence[str], separator: str, decimal: str) -> float:
    """The score of a separator and a decimal sign: numbers in rows of the usual width, less penalties."""
    if (separator, decimal) == (",", ",") and not any('"' in line for line in lines):
        return 0.0
    rows = [cells_of(line, separator) for line in _plain(lines)]
    counted = [(row, sum(is_number(cell, decimal) for cell in row)) for row in rows]
    counted = [(row, count) for row, count in counted if count]
    if not counted:
        return 0.0
    width = Counter(len(row) for row, _ in counted).most_common(1)[0][0]
    usual = [row for row, _ in counted if len(row) == width]
    numbers = sum(count for row, count in counted if len(row) == width)
    words = sum(bool(cell) for row in usual for cell in row) - numbers
    # A decimal comma needs a number with one.
    needless = decimal == "," and not any("," in cell for row in usual for cell in row)
    # Blanks also occur beside tabs and within words.
    return (0.9 if separator == " " else 1.0) * (numbers - 1.5 * words - 0.5 * needless)


def _is_one_column(lines: Sequence[str]) -> bool:
    """Whether "0,5" is one number: rows of two whole numbers below a header of one cell."""
    plain = _plain(lines)
    rows = [line.split(",") for line in plain if is_number(line.strip(), ",") and "," in line]
    heads = [line for line in plain if not any(is_number(cell.strip(), ".") for cell in line.split(","))]
    whole = all(len(row) == 2 and "." not in "".join(row) for row in rows)
    return bool(rows) and whole and bool(heads) and "," not in _BRACKETS.sub("", heads[-1])


def _table(lines: Sequence[str], encoding: str, separator: str, decimal: str) -> Dialect:
    rows = [cells_of(line, separator) for line in lines]
    is_sample = lambda line, row: not line.lstrip().startswith("#") and any(is_number(cell, decimal) for cell in row)
    sampled = [k for k, (line, row) in enumerate(zip(lines, rows, strict=True)) if is_sample(line, row)]
    width = Counter(len(rows[k]) for k in sampled).most_common(1)[0][0]
    usual = [k for k in sampled if len(rows[k]) == width]
    late = usual[len(usual) // 2 :]
    share = [sum(is_number(rows[k][j], decimal) for k in late) / len(late) for j in range(width)]
    numeric = [j for j in range(width) if share[j] > 0.5] or list(range(width))
    first = _first(rows, usual, numeric, decimal)
    names, units, above = _header(lines[:first], separator, width, decimal)
    clock = _scope_clock(rows[:first], " ".join(lines[:first]), decimal)
    # A preamble may also lie beside the first samples (Tektronix).
    names, units = _from_preamble(lines[: max(first, 30)], separator, names, units, numeric, width)
    bare = [_BRACKETS.sub("", name).strip() for name in names]
    # Beside a named clock "s" is a displacement, not a second clock.
    clocked = any(name.lower() in _CLOCKS for name in bare)
    letters = {name.lower() for name in bare if len(name) == 1}
    symbols = clocked and bool(letters - _UNITS_ALONE - set(_CLOCKS))
    columns = tuple(_column(j, names[j] if names else "", units[j] if units else "", clocked, symbols) for j in numeric)
    return Dialect(encoding, separator, decimal, first, width, columns, bool(names), tuple(above), clock)


def _first(rows: list[list[str]], usual: list[int], numeric: list[int], decimal: str) -> int:
    """The index of the line of the first sample: no words in the numeric columns."""
    words = lambda row: [j for j in numeric if row[j] and not is_number(row[j], decimal)]
    first = next((k for k in usual if not words(rows[k]) and any(row for row in rows[k])), usual[0])
    # Lines with a word in them are samples as well, if their first cell, the clock, is a number or a header is above.
    while first > 0 and len(rows[first - 1]) == len(rows[first]):
        above, header = rows[first - 1], rows[first - 2] if first > 1 else []
        heads = len(header) == len(above) and not any(is_number(cell, decimal) for cell in header)
        counted = [is_number(above[j], decimal) for j in numeric]
        is_sample = counted[0] or (heads and any(counted))
        if not is_sample or any(unit_named(cell) for cell in above if cell):
            break
        first -= 1
    return first


def _header(above: Sequence[str], separator: str, width: int, decimal: str) -> tuple[list[str], list[str], list[str]]:
    """Names, units and the cells right above the samples."""
    plain = _plain(above)
    remarks = [line.lstrip("# ") for line in above if line.lstrip().startswith("#")]
    split = lambda line: cells_of(line, separator, header=True)
    rows = [split(line) for line in plain[-2:]]
    units = len(rows) > 1 and _are_units(rows[-1], decimal)
    if rows and "increment" in [cell.lower() for cell in rows[0][width:]]:
        rows = [row[:width] for row in rows]  # start and increment of the clock are beside them
    fits = lambda row: min(width, 2) <= len(_without_empty_end(row)) <= width <= len(row) + 1
    nearest = rows[-1] if rows else []
    if not rows or not fits(nearest):
        rows = rows or [split(line) for line in remarks[-2:]]
        if not rows or len(_without_empty_end(rows[-1])) != width:
            return [], [], nearest
    rows = [[*row, *[""] * width][:width] if fits(row) else [] for row in rows]
    last, before = rows[-1], rows[0] if len(rows) > 1 else []
    if before and (units or _are_units(last, decimal)) and not all(unit_named(cell) for cell in before if cell):
        return before, last, last
    return last, [], last


def _are_units(row: list[str], decimal: str) -> bool:
    """Whether a row above the samples has units; beside a clock (Rigol) one word may be among them."""
    numbers = sum(is_number(cell, decimal) for cell in row)
    units = sum(unit_named(cell) != "" for cell in row)
    words = sum(cell != "" for cell in row) - numbers - units
    return units > 0 and words <= (1 if numbers else 0)


def _without_empty_end(row: list[str]) -> list[str]:
    """A row without the empty cells at its end."""
    while row and not row[-1]:
        row = row[:-1]
    return row


def _scope_clock(above: Sequence[Sequence[str]], preamble: str, decimal: str) -> tuple[float, float] | None:
    """Start and interval [s] of the clock, if they are below or beside "Start" and "Increment" (Rigol)."""
    beside = re.findall(r"(start|increment)\s*[=,;]\s*([-+\d.eE]+)", preamble, re.IGNORECASE)
    pairs = [(key.lower(), value) for key, value in beside]
    for names, below in pairwise(above):
        lowered = [name.lower() for name in names]
        if "increment" in lowered:
            pairs += zip(lowered, below, strict=False)
    numbers = {key: float(number) for key, value in pairs if (number := plain_number(value, decimal))}
    return (numbers.get("start", 0.0), numbers["increment"]) if numbers.get("increment", 0.0) > 0 else None


def _from_preamble(
    above: Sequence[str], separator: str, names: list[str], units: list[str], numeric: list[int], width: int
) -> tuple[list[str], list[str]]:
    """Names and units, from an oscilloscope's preamble where the header lacks them (Tektronix)."""
    fields = {row[0].lower(): row[1] for row in (cells_of(line, separator) for line in above) if len(row) > 1}
    across, up = fields.get("horizontal units", ""), fields.get("vertical units", "")
    if len(numeric) < 2 or unit_named(across) == "":
        return names, units
    if not names:
        names = [""] * width
        names[numeric[0]], names[numeric[1]] = "time", fields.get("source", "") or "CH1"
    if not units:
        units = [up if unit_named(up) else ""] * width
        units[numeric[0]] = across
    return names, units


def _column(position: int, written: str, below: str, clocked: bool, symbols: bool) -> Column:
    bare = _BRACKETS.sub("", written).strip()
    inside = [part.strip()[1:-1] for part in _BRACKETS.findall(written)]
    tails = re.findall(r"(?:\s/\s*|\s+in\s+|^in\s+|,\s*)(\S+)$", bare)
    alone = [bare] if bare.lower() in _UNITS_ALONE and not (clocked and bare.lower() == "s") else []
    suffix = [bare.rpartition("_")[2]] if "_" in bare else []
    sure = next((unit_named(text) for text in [below, *suffix, *inside, *tails] if unit_named(text)), "")
    unit = sure or next((unit_named(text) for text in alone), "")
    return Column(position, bare or written, written, unit, letter=symbols and not sure and len(unit) == 1)
