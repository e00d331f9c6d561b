"""Requests to end, from the system or a scheduler, as interrupts that a program can put things in order on."""

import contextlib
import signal
import threading
from collections.abc import Iterator, Sequence


class Terminated(KeyboardInterrupt):
    """The process was asked to end."""


@contextlib.contextmanager
def requests_to_end() -> Iterator[list[int]]:
    """Within it SIGTERM and SIGHUP raise `Terminated` in the main thread, as SIGINT raises `KeyboardInterrupt`.

    Does nothing outside the main thread, nor for a signal that has a handler or is ignored (`nohup`).

    **Returns:** the numbers of the signals that came, a list that grows with them.
    """
    received: list[int] = []

    def end(signum: int, frame: object) -> None:
        received.append(signum)
        raise Terminated(signal.Signals(signum).name)

    signals = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    main = threading.current_thread() is threading.main_thread()
    ours = [s for s in signals if signal.getsignal(s) is signal.SIG_DFL] if main else []
    try:
        for number in ours:
            signal.signal(number, end)
        yield received
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def exit_status(received: Sequence[int]) -> int:
    """128 and the number of the first signal `received`, as shells count: 143 for SIGTERM, 130 for none but Ctrl-C."""
    return 128 + (received[0] if received else signal.SIGINT)
