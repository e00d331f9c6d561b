"""Work in a thread of its own, that tells how it goes and can be asked to stop."""

import threading
import time
import weakref
from collections.abc import Callable
from typing import Any, Generic, TypeVar

Result = TypeVar("Result")

Report = Callable[[str], None]
"""Told what is being done.  Raises `KeyboardInterrupt` once where the work is asked to stop."""


_STARTED: "weakref.WeakSet[BackgroundJob[Any]]" = weakref.WeakSet()


def end_jobs(seconds: float) -> bool:
    """Asks all jobs to stop and waits for them, so long at most; whether all have ended.

    One that compiles cannot be stopped, and where it meets the end of Python it aborts it.
    """
    until = time.monotonic() + seconds
    for job in list(_STARTED):
        job.cancel()
    for job in list(_STARTED):
        job.join(max(until - time.monotonic(), 0.0))
    return not any(job.runs for job in list(_STARTED))


class BackgroundJob(Generic[Result]):
    """Runs `work` at once; in its thread `told` gets each of its lines, and `ended` its result or error."""

    def __init__(
        self,
        work: Callable[[Report], Result],
        told: Callable[[str], None],
        ended: Callable[[Result | None, BaseException | None], None],
    ):
        self._work, self._told, self._ended = work, told, ended
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        _STARTED.add(self)
        self._thread.start()

    def cancel(self) -> None:
        """Asks the work to stop: it does when it next reports."""
        self._stop.set()

    @property
    def runs(self) -> bool:
        """Whether the thread is at work."""
        return self._thread.is_alive()

    def join(self, seconds: float) -> None:
        """Waits for the end, so long at most."""
        self._thread.join(seconds)

    def _run(self) -> None:
        try:
            result = self._work(self._report)
        except BaseException as error:
            self._ended(None, error)
        else:
            self._ended(result, None)

    def _report(self, line: str) -> None:
        if self._stop.is_set():
            # Once: what then puts things in order may go on reporting.
            self._stop.clear()
            raise KeyboardInterrupt
        self._told(line)
