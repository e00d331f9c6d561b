"""Requests to end, from the system or a scheduler, as interrupts that a program can put things in order on."""

import contextlib
import signal
import threading
from collections.abc import Iterator


class Terminated(KeyboardInterrupt):
    """The process was asked to end by the signal `signum`."""

    def __init__(self, signum: int):
        super().__init__(signal.Signals(signum).name)
        self.signum = signum


@contextlib.contextmanager
def requests_to_end() -> Iterator[None]:
    """Within it SIGTERM and SIGHUP raise `Terminated` in the main thread, as SIGINT raises `KeyboardInterrupt`.

    Does nothing outside the main thread, nor for a signal that has a handler or is ignored (`nohup`).
    """

    def end(signum: int, frame: object) -> None:
        raise Terminated(signum)

    signals = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    main = threading.current_thread() is threading.main_thread()
    ours = [s for s in signals if signal.getsignal(s) is signal.SIG_DFL] if main else []
    try:
        for one in ours:
            signal.signal(one, end)
        yield
    finally:
        for one in ours:
            signal.signal(one, signal.SIG_DFL)


def exit_status(interrupt: BaseException) -> int:
    """128 and the number of the signal behind `interrupt`, as shells count: 130 for Ctrl-C, 143 for SIGTERM."""
    cause = interrupt
    while cause.__cause__ is not None:
        cause = cause.__cause__
    return 128 + (cause.signum if isinstance(cause, Terminated) else signal.SIGINT)
