"""How a result shows itself, although what shows it lives above it.

A result may not import `report`, which imports results.  The face of the package says by name which module shows
results (`present_with`); it is imported when a result is first shown, so that no computation loads plots.
"""

import importlib
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


_presenters: list[str] = []


def present_with(module: str) -> None:
    """Let the module of that name, a `Presenter`, show results from now on."""
    _presenters[:] = [module]


def presenter() -> Presenter:
    """What shows results; imported now, if it was not yet."""
    return cast(Presenter, importlib.import_module(_presenters[0]))
