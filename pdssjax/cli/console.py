"""Output of a command while it works: warnings in plain lines, progress, a bar for long counts.

The one home of rich.
"""

import contextlib
import io
import os
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any, TextIO

from ..core import InputWarning

QUIET_S = 2.0
"""Seconds without a word before it is said that something is compiled: what was asked for may be refused meanwhile."""


def announce_warnings(show: Callable[..., None]) -> Callable[..., None]:
    """A substitute for `warnings.showwarning`: plain lines for the user's own warnings, `show` for others."""

    def announce(message: Warning | str, category: type[Warning], *where: object) -> None:
        if issubclass(category, InputWarning):
            note(f"warning: {message}")
        else:
            show(message, category, *where)

    return announce


def say(text: str, end: str = "\n") -> None:
    """Print a result at once.  Where nobody takes it (a closed pipe, a full disk), the command goes on."""
    try:
        print(text, end=end, flush=True)
    except OSError as error:
        _discard(sys.stdout)
        note(f"warning: cannot print any further ({error.strerror})")


def note(text: str) -> None:
    """Print a line for the user beside the results, such as "warning: ...", on standard error."""
    print(f"pdssjax: {text}", file=sys.stderr, flush=True)


def replace_unknown_letters() -> None:
    """Let standard output show "?" for letters that its encoding does not have, as standard error does anyway."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")


class LenientStream:
    """A stream that drops output silently when nobody takes it (a closed pipe, a full disk).

    In place of `sys.stderr` it serves whoever writes there: commands, rich, warnings, libraries.
    """

    def __init__(self, stream: TextIO | None):
        # None where the process began with it closed.
        self._stream = stream or io.StringIO()

    def write(self, text: str) -> int:
        try:
            self._stream.write(text)
        except OSError:
            _discard(self._stream)
        return len(text)

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError:
            _discard(self._stream)

    def __getattr__(self, name: str) -> Any:
        # All else is that of the stream: whether it is a terminal, its encoding.
        return getattr(self._stream, name)


def _discard(stream: TextIO) -> None:
    """Discard whatever is written to `stream` from now on.

    What is still buffered would otherwise fail again at the end of the process.
    """
    with contextlib.suppress(OSError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


@contextlib.contextmanager
def counter(what: str) -> Iterator[Callable[[int, int], None]]:
    """A function of (done, all) that shows a bar on a terminal, else a line now and then.

    Before the first call there is a sign of life after a while, too: what computes the first ones may compile for
    minutes.
    """
    import threading

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if console.is_terminal:
        columns = (TextColumn(what), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
        with Progress(*columns, console=console) as bar:
            task = bar.add_task(what, total=None)
            yield lambda done, count: bar.update(task, completed=done, total=count)
    else:
        tenth, first, begun = 0, None, time.monotonic()
        announce = lambda: print(f"compiling what computes the {what}", file=sys.stderr, flush=True)
        compiling = threading.Timer(QUIET_S, announce)
        compiling.daemon = True

        def line(done: int, count: int) -> None:
            nonlocal tenth, first, begun
            compiling.cancel()
            if first is None:
                # What is counted first may be of an earlier run, or be slow because it compiles: rates begin here.
                first, begun = done, time.monotonic()
            if 10 * done // count > tenth:
                tenth, pace, seconds = 10 * done // count, "", time.monotonic() - begun
                if done > first and seconds > 0:
                    rate = (done - first) / seconds
                    pace = f", {rate:.3g} a second, {(count - done) / rate:.3g} s left"
                print(f"{done} of {count} {what}{pace}", file=sys.stderr, flush=True)

        compiling.start()
        try:
            yield line
        finally:
            compiling.cancel()


@contextlib.contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """A function that shows what is being done: one live line on a terminal, else line by line."""
    from rich.console import Console
    from rich.text import Text

    console = Console(stderr=True)
    if console.is_terminal:
        with console.status("") as status:
            yield lambda message: status.update(Text(message))
    else:
        said = ""

        def line(message: str) -> None:
            nonlocal said
            if message != said:  # a refused step changes nothing
                print(message, file=sys.stderr, flush=True)
            said = message

        yield line
