"""The thread in which the widgets of a page are changed, and the jobs that are begun from the page.

What changes on the page reaches the browser in the order in which it changed.  Panel sends the changes of widgets by
itself and lets them wait while the connection is busy; Bokeh sends those of plots and their data at once.  New data
then overtake the plot that they are drawn in, and the browser knows no plot of that name.  Here both go Panel's way.

A page that is closed while a job is at work is no failure: the job is asked to stop, and what it says is dropped.
"""

import functools
import weakref
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import panel as pn
from bokeh.document import Document
from tornado.ioloop import IOLoop

from ..background_job import BackgroundJob, Report

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def in_order(act: Callable[Arguments, None]) -> Callable[Arguments, None]:
    """`act`, for the thread of the page, with all its changes sent in their order."""

    @functools.wraps(act)
    def ordered(*args: Arguments.args, **kwargs: Arguments.kwargs) -> None:
        with pn.io.unlocked():
            act(*args, **kwargs)

    return ordered


class PageThread:
    """Made in the thread of the page that has the `document`; its methods may be called in any thread."""

    def __init__(self, document: Document):
        self._document, self._loop = document, IOLoop.current()
        self._jobs: weakref.WeakSet[BackgroundJob[Any]] = weakref.WeakSet()

    def later(self, act: Callable[[], None]) -> None:
        """Call `act` soon in the thread of the page."""
        self._loop.add_callback(self._if_open, lambda: self._document.add_next_tick_callback(in_order(act)))

    def after(self, milliseconds: int, act: Callable[[], None]) -> None:
        """Call `act` in the thread of the page after some milliseconds."""
        self._loop.add_callback(self._if_open, lambda: self._document.add_timeout_callback(act, milliseconds))

    def start(
        self,
        work: Callable[[Report], Result],
        on_end: Callable[[Result | None, BaseException | None], None],
        on_line: Callable[[str], None] = lambda line: None,
    ) -> BackgroundJob[Result]:
        """Begin `work` in a thread of its own.

        In the thread of the page `on_end` is given the result or the error, and `on_line` each line of progress.
        """
        job = BackgroundJob(
            work,
            lambda line: self.later(lambda: on_line(line)),
            lambda result, error: self.later(lambda: on_end(result, error)),
        )
        self._jobs.add(job)
        return job

    def cancel_jobs(self) -> None:
        """Ask all jobs of the page to stop."""
        for job in list(self._jobs):
            job.cancel()

    def _if_open(self, act: Callable[[], object]) -> None:
        # In the thread of the server, which alone closes documents: here none is closed in between.
        context = self._document.session_context
        if context is not None and not context.destroyed:
            act()
