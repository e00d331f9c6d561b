"""What changes on the page reaches the browser in the order in which it changed.

Panel sends the changes of widgets by itself and lets them wait while the connection is busy; Bokeh sends those of
plots and their data at once.  New data then overtake the plot that they are drawn in, and the browser knows no plot
of that name.  Here both go Panel's way.
"""

import functools
from collections.abc import Callable
from typing import ParamSpec

import panel as pn

Arguments = ParamSpec("Arguments")


def in_order(act: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """`act`, in the thread of the page, with all that it changes sent in one line."""

    @functools.wraps(act)
    def ordered(*args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        with pn.io.unlocked():
            act(*args, **kwargs)

    return ordered
