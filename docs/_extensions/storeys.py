"""A chart of Mermaid as boxes of HTML, without its JavaScript: GitHub draws the chart of the rooms itself.

Reads what docs/architecture.md uses of the language: subgraphs, nodes with a text, and arrows.
"""

import html
import re

BOX = "border: 1px solid var(--color-foreground-border); border-radius: 4px; padding: 0.2rem 0.6rem; margin: 0.2rem;"


def boxes(chart: str) -> str:
    """The subgraphs below one another, the nodes of each side by side; then the arrows as a line."""
    storeys, arrows = [], []
    title, inside = "", []
    for line in map(str.strip, chart.splitlines()):
        if found := re.fullmatch(r"subgraph (\w+)(?:\[(.+)\])?", line):
            title, inside = found[2] or found[1], []
        elif found := re.fullmatch(r"(\w+)\[(.+)\]", line):
            inside.append(found[2])
        elif line == "end":
            storeys.append((title, inside))
        elif "-->" in line:
            arrows.append(" &rarr; ".join(html.escape(part.strip()) for part in line.split("-->")))
    rows = "".join(_storey(title, inside) for title, inside in storeys)
    return f"{rows}<p>What imports what: {'; '.join(arrows)}.</p>"


def _storey(title: str, inside: list[str]) -> str:
    rooms = "".join(f'<span style="{BOX}">{html.escape(room)}</span>' for room in inside)
    row = f'<div style="display: flex; flex-wrap: wrap;">{rooms}</div>'
    return f'<div style="{BOX}"><em>{html.escape(title)}</em>{row}</div>'
