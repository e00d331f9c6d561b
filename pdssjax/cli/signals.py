"""Requests to end, from the system or a scheduler, as exceptions on which a program can clean up."""

import contextlib
import signal
from collections.abc import Iterator, Sequence


class Terminated(KeyboardInterrupt):
    """The process was asked to end."""


@contextlib.contextmanager
def requests_to_end() -> Iterator[list[int]]:
    """Let SIGTERM and SIGHUP raise `Terminated` in the main thread, as SIGINT raises `KeyboardInterrupt`.

    Does nothing outside the main thread, nor for a signal that has a handler or is ignored (`nohup`).

    **Returns:** the numbers of the signals that came, a list that grows with them.
    """
    received: list[int] = []

    def end(signum: int, frame: object) -> None:
        received.append(signum)
        raise Terminated(signal.Signals(signum).name)

    signals = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
    ours: list[int] = []
    try:
        with contextlib.suppress(ValueError):  # outside the main thread; to ask whether it is loads `threading`
            for number in signals:
                if signal.getsignal(number) is signal.SIG_DFL:
                    signal.signal(number, end)
                    ours.append(number)
        yield received
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


def exit_status(received: Sequence[int]) -> int:
    """128 and the number of the first signal `received`, as shells count: 143 for SIGTERM, 130 for none but Ctrl-C."""
    return 128 + (received[0] if received else signal.SIGINT)
