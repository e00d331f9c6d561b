"""The thread that changes the widgets of a page, and the jobs that the page starts.

Changes on the page reach the browser in their order.  Panel queues the changes of widgets while the connection is busy;
Bokeh sends those of plots and their data at once.  New data would then overtake their plot, which the browser does not
know yet.  Here both are queued by Panel.

A page may be closed while a job runs: the job is asked to stop, and its reports are dropped.
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
    """`act` for the thread of the page, with its changes sent in their order."""

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
        """Call `act` in the thread of the page after so many `milliseconds`."""
        self._loop.add_callback(self._if_open, lambda: self._document.add_timeout_callback(act, milliseconds))

    def start(
        self,
        work: Callable[[Report], Result],
        on_end: Callable[[Result | None, BaseException | None], None],
        on_line: Callable[[str], None] = lambda line: None,
    ) -> BackgroundJob[Result]:
        """Start a `BackgroundJob`, whose `on_end` and `on_line` run in the thread of the page."""
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
        # Runs in the thread of the server, which alone closes documents, so that none closes before `act`.
        context = self._document.session_context
        if context is not None and not context.destroyed:
            act()
