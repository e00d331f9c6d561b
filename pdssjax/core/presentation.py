"""How results are shown, by a module above this room; figures and progress bars in a notebook.

A result may not import `report`, which imports results.  The face of the package says by name which module shows
results (`present_with`); it is imported when a result is first shown, so that no computation loads plots.  In a
notebook progress is a bar below the cell, of plain HTML, which needs no widgets.
"""

import importlib
import os
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, cast

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Figure
else:
    Figure = object


class Presenter(Protocol):
    """A module that shows results."""

    def as_html(self, shown: object) -> str:
        """A result as a piece of HTML, its numbers with units."""
        ...

    def as_figure(self, shown: object, what: str | None = None) -> Figure:
        """A result as a figure of matplotlib; `what` of it, or an overview."""
        ...

    def write_report(self, shown: object, path: "str | os.PathLike[str]", overwrite: bool) -> None:
        """A result as one HTML file."""
        ...


_presenters: list[str] = []


def present_with(module: str) -> None:
    """Let the module of that name, a `Presenter`, show results from now on."""
    _presenters[:] = [module]


def presenter() -> Presenter:
    """The module that shows results; imported now, if it was not yet."""
    return cast(Presenter, importlib.import_module(_presenters[0]))


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


class _Shown:
    """A line of text with a bar, full by how much the line says is done ("12 of 50"); nothing for no text."""

    def __init__(self, text: str):
        self._text = text

    def _repr_html_(self) -> str:
        import html
        import re

        if not self._text:
            return ""
        done = re.search(r"(\d+) of (\d+)", self._text)
        value = f' value="{int(done[1]) / max(int(done[2]), 1):.4f}"' if done else ""
        return f'<progress max="1"{value} style="width: 14em"></progress> <code>{html.escape(self._text)}</code>'

    def __repr__(self) -> str:
        return self._text


class NotebookProgress:
    """Shows lines of text with a bar below the cell, from the first line on until it is cleared."""

    def __init__(self) -> None:
        self._handle = None

    def __call__(self, message: str) -> None:
        if self._handle is None:
            self._handle = sys.modules["IPython"].display.display(_Shown(""), display_id=True)
        self._handle.update(_Shown(message))

    def clear(self) -> None:
        """Take the bar away."""
        if self._handle is not None:
            self._handle.update(_Shown(""))


def notebook_progress() -> NotebookProgress | None:
    """A display of lines of text with a bar; None outside a notebook."""
    return NotebookProgress() if in_notebook() else None


def notebook_counter(what: str) -> Callable[[int, int], None] | None:
    """A notebook's display of how many `what` are done, and of how many; None outside a notebook."""
    show = notebook_progress()
    return None if show is None else lambda done, count: show(f"{done} of {count} {what}")


def clear_bar(tell: object) -> None:
    """Take the bar away if that is what showed the lines of text."""
    if isinstance(tell, NotebookProgress):
        tell.clear()
