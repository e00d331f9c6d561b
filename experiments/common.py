"""What every experiment shares: the table "thesis | ours | difference | why", the figure's style and its place.

    from experiments.common import Row, print_table, save, styled

    print_table("Mode ratio", [Row("mass ratio 138.8", None, 0.027, "", "the thesis prints a curve only")], NAME)
    with styled():
        save(draw(), NAME)

A table goes to the screen and to out/experiments/NAME.md, a figure to out/experiments/NAME.png.
With `PDSSJAX_FIGURES=1` in the environment a small copy is also put in experiments/figures, for the documentation.
"""

import contextlib
import dataclasses
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

OUT = Path("out/experiments")
"""Where tables and figures go, below the current folder."""
SMALL = Path(__file__).parent / "figures"
"""Where the small copies for the documentation go."""

BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
"""From the palette of Okabe and Ito, told apart by the colour-blind."""

STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.formatter.useoffset": False,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "legend.frameon": False,
    "lines.linewidth": 1.4,
}


@dataclasses.dataclass(frozen=True)
class Row:
    """One number of the thesis beside ours."""

    name: str
    """What the number is."""
    thesis: float | str | None
    """The thesis's number, a word about it, or None where it gives none."""
    ours: float | str | None
    """Ours, in the same unit."""
    unit: str = ""
    """Unit of both, such as "um"; "" for a pure number."""
    why: str = ""
    """What explains the difference."""

    @property
    def difference(self) -> str:
        """Ours relative to the thesis's, in per cent; "-" where either is not a number or the thesis's is 0."""
        if not isinstance(self.thesis, (int, float)) or not isinstance(self.ours, (int, float)) or self.thesis == 0:
            return "-"
        return f"{100.0 * (self.ours / self.thesis - 1.0):+.3g} %"


def print_table(title: str, rows: Sequence[Row], name: str | None = None, notes: Sequence[str] = ()) -> str:
    """Print the table and return it as Markdown.

    **Arguments:** `title` stands above it, `notes` below it, a paragraph each.  With a `name`
    the Markdown is also written to out/experiments/NAME.md, in place of an older one.  An
    experiment with several tables leaves `name` out and hands what is returned, joined, to `write`.
    """
    header = ("", "thesis", "ours", "difference", "why")
    cells = [(_labelled(row), _shown(row.thesis), _shown(row.ours), row.difference, row.why) for row in rows]
    widths = [max(len(line[i]) for line in (header, *cells)) for i in range(len(header))]
    print(f"\n{title}")
    for first, *numbers, why in (header, *cells):
        figures = [cell.rjust(width) for cell, width in zip(numbers, widths[1:4], strict=True)]
        print("  ".join([first.ljust(widths[0]), *figures, why]).rstrip())
    for note in notes:
        print(note)
    text = "\n".join(
        [f"## {title}", "", "| " + " | ".join(header) + " |", "|---|--:|--:|--:|---|"]
        + ["| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in cells]
        + [f"\n{note}" for note in notes]
    )
    if name is not None:
        write(text, name)
    return text


def write(markdown: str, name: str) -> None:
    """Put the text of one or more tables in out/experiments/NAME.md."""
    OUT.mkdir(parents=True, exist_ok=True)
    (OUT / f"{name}.md").write_text(markdown.rstrip() + "\n", encoding="utf-8")


@contextlib.contextmanager
def styled() -> Iterator[None]:
    """Figures made within look alike; nothing global stays changed."""
    with matplotlib.rc_context(STYLE):
        yield


def save(figure: Figure, name: str) -> Path:
    """Write the figure to out/experiments/NAME.png (and its small copy, see above); returns where it is."""
    OUT.mkdir(parents=True, exist_ok=True)
    place = OUT / f"{name}.png"
    figure.savefig(place, dpi=200)
    if os.environ.get("PDSSJAX_FIGURES"):
        SMALL.mkdir(exist_ok=True)
        figure.savefig(SMALL / f"{name}.png", dpi=100)
    print(f"Figure: {place}")
    return place


def _labelled(row: Row) -> str:
    return f"{row.name} [{row.unit}]" if row.unit else row.name


def _shown(value: float | str | None) -> str:
    """A number to four digits."""
    if value is None:
        return "-"
    return value if isinstance(value, str) else f"{float(value):.4g}"
