"""In a notebook: progress as a bar below the cell, of plain HTML, which needs no widgets; figures as pictures."""

import html
import importlib
import re
import sys
from collections.abc import Callable
from typing import Protocol, TypeAlias

TellCount: TypeAlias = Callable[[int, int], None]
"""Takes how many are done, and of how many."""


class _Place(Protocol):
    """Where something is shown below a cell: a display handle of IPython."""

    def update(self, shown: object) -> None: ...


class _Nothing:
    """In place of a bar once all is done."""

    def _repr_html_(self) -> str:
        return ""

    def __repr__(self) -> str:
        return ""


class _Shown:
    """HTML for a notebook, and the same as plain text for what shows no HTML."""

    def __init__(self, text: str, share: float | None):
        self.text = text
        self.share = share

    def _repr_html_(self) -> str:
        value = "" if self.share is None else f' value="{self.share:.4f}"'
        return f'<progress max="1"{value} style="width: 14em"></progress> <code>{html.escape(self.text)}</code>'

    def __repr__(self) -> str:
        return self.text


def in_notebook() -> bool:
    """Whether this is a Jupyter kernel, whose front end shows HTML."""
    if "IPython" not in sys.modules:
        return False
    shell = sys.modules["IPython"].get_ipython()
    return shell is not None and hasattr(shell, "kernel")


def draw_in_notebook(figure: type) -> None:
    """Have a notebook draw the figures of that class of matplotlib; it does by itself once pyplot was imported."""
    if in_notebook():
        shell = sys.modules["IPython"].get_ipython()
        if figure not in shell.display_formatter.formatters["image/png"].type_printers:
            importlib.import_module("IPython.core.pylabtools").select_figure_formats(shell, {"png"})


def told_in_notebook() -> "TextBar | None":
    """What shows lines of text with a bar; None outside a notebook."""
    return TextBar() if in_notebook() else None


def counted_in_notebook(what: str) -> TellCount | None:
    """Shows a bar of so many `what` done; None outside a notebook."""
    return _count_bar(_new_place(), what) if in_notebook() else None


def _new_place() -> Callable[[], _Place]:
    """Makes the place when something is first shown, so that what is quick shows nothing."""
    made: list[_Place] = []

    def place() -> _Place:
        if not made:
            made.append(sys.modules["IPython"].display.display(_Shown("", None), display_id=True))
        return made[0]

    return place


class TextBar:
    """Shows lines of text with a bar, full by how much they say is done ("12 of 50"), until it is cleared."""

    def __init__(self) -> None:
        self._place = _new_place()
        self._used = False

    def __call__(self, message: str) -> None:
        found = re.search(r"(\d+) of (\d+)", message)
        share = int(found[1]) / max(int(found[2]), 1) if found else None
        self._place().update(_Shown(message, share))
        self._used = True

    def clear(self) -> None:
        """Takes the bar away."""
        if self._used:
            self._place().update(_Nothing())


def clear_bar(tell: object) -> None:
    """Takes the bar away if that is what showed the lines of text."""
    if isinstance(tell, TextBar):
        tell.clear()


def _count_bar(place: Callable[[], _Place], what: str) -> TellCount:
    def tell(done: int, count: int) -> None:
        place().update(_Shown(f"{done} of {count} {what}", done / max(count, 1)))

    return tell
