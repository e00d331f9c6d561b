"""Work in a thread of its own, which reports its progress and can be asked to stop."""

import threading
import time
import weakref
from collections.abc import Callable
from typing import Any, Generic, TypeVar

Result = TypeVar("Result")

Report = Callable[[str], None]
"""Takes a line of progress.  Raises `KeyboardInterrupt`, once, where the work was asked to stop."""

_STARTED: "weakref.WeakSet[BackgroundJob[Any]]" = weakref.WeakSet()


def end_jobs(seconds: float) -> bool:
    """Ask all jobs to stop, wait at most so many `seconds`, and return whether all have ended.

    A job that compiles cannot be stopped; a job that still compiles at the end of Python aborts the process.
    """
    until, jobs = time.monotonic() + seconds, list(_STARTED)
    for job in jobs:
        job.cancel()
    for job in jobs:
        job.join(max(until - time.monotonic(), 0.0))
    return not any(job.is_running for job in jobs)


class BackgroundJob(Generic[Result]):
    """Runs `work` at once in a thread, which calls `on_line` with each line of progress and `on_end` with the end.

    The end is the result and None, or None and the error.
    """

    def __init__(
        self,
        work: Callable[[Report], Result],
        on_line: Callable[[str], None],
        on_end: Callable[[Result | None, BaseException | None], None],
    ):
        self._work, self._on_line, self._on_end = work, on_line, on_end
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        _STARTED.add(self)
        self._thread.start()

    def cancel(self) -> None:
        """Ask the work to stop at its next report of progress."""
        self._stop.set()

    @property
    def is_running(self) -> bool:
        """Whether the work has not ended yet."""
        return self._thread.is_alive()

    def join(self, seconds: float) -> None:
        """Wait for the end, at most so many `seconds`."""
        self._thread.join(seconds)

    def _run(self) -> None:
        try:
            result = self._work(self._report)
        except BaseException as error:
            self._on_end(None, error)
        else:
            self._on_end(result, None)

    def _report(self, line: str) -> None:
        if self._stop.is_set():
            # Only once, since the handling of the interrupt may report progress, too.
            self._stop.clear()
            raise KeyboardInterrupt
        self._on_line(line)
