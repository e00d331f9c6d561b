"""Headings, tables and phrases of every report."""

import textwrap
from collections.abc import Sequence


def heading(text: str) -> str:
    return f"[[{text}]]\n"


def aligned_table(align: str, rows: Sequence[Sequence[str]]) -> str:
    """Rows with their columns lined up; `align` holds "<" or ">" for each column."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    layout = "    " + "  ".join(f"{{:{side}{width}}}" for side, width in zip(align, widths, strict=True))
    return "".join(layout.format(*row).rstrip() + "\n" for row in rows)


def note(text: str, indent: int = 4) -> str:
    """A sentence below a table, in lines of 100 characters."""
    return textwrap.fill(text, 100, initial_indent=" " * indent, subsequent_indent=" " * indent) + "\n"


def counted(number: int, what: str) -> str:
    """A `number` of things, such as "1 block" or "3 blocks"."""
    return f"{number} {what}" + "s" * (number != 1)
