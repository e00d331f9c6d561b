"""Tables and folded paragraphs of HTML; all that comes from outside is escaped."""

import html
import re
from collections.abc import Sequence


def table(align: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Rows below a head; `align` holds "<" or ">" for each column."""
    sides = ["left" if side == "<" else "right" for side in align]
    lines = [_row("th", sides, head), *(_row("td", sides, row) for row in rows)]
    return f"<table>\n<thead>{lines[0]}</thead>\n<tbody>\n" + "\n".join(lines[1:]) + "\n</tbody>\n</table>"


def _row(tag: str, sides: Sequence[str], cells: Sequence[str]) -> str:
    shown = [
        f'<{tag} style="text-align: {side}">{html.escape(units(cell))}</{tag}>'
        for side, cell in zip(sides, cells, strict=True)
    ]
    return f"<tr>{''.join(shown)}</tr>"


def paragraph(strong: str, text: str = "") -> str:
    """One line, what matters most of it in bold."""
    return f"<p><strong>{html.escape(strong)}</strong> {html.escape(units(text))}".rstrip() + "</p>"


def folded(title: str, lines: Sequence[str]) -> str:
    """Lines that open at a click; nothing where there are none."""
    if not lines:
        return ""
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    return f"<details><summary>{html.escape(title)} ({len(lines)})</summary><ul>{items}</ul></details>"


def units(text: str) -> str:
    """Micro as a letter of its own, since HTML is no terminal."""
    return re.sub(r"\bum\b", "µm", text)
