"""Serves the page on the loopback address, to this machine alone; nothing is fetched from elsewhere."""

import webbrowser
from collections.abc import Callable

from ..core import InputError
from .background_job import end_jobs
from .workbench import Workbench

ADDRESS = "127.0.0.1"

_PATIENCE = 20.0
"""Seconds for which what is being compiled is waited for at the end."""


def serve(bench: Workbench, port: int, show: bool, said: Callable[[str], None]) -> bool:
    """Serves pages of `bench` until Ctrl-C ends it; whether all work that was begun on it has ended, too.

    **Arguments:** `port` 0 takes a free one; `show` opens a browser; `said` is told the address, as a line.

    **Raises:** `InputError` where the port is taken.
    """
    from .widgets.serving import page_server

    try:
        server = page_server(bench, ADDRESS, port)
    except OSError as error:
        raise InputError(
            f"option --port: found {port}, which cannot be used ({error.strerror}); expected another."
        ) from None
    address = f"http://{ADDRESS}:{server.port}/"
    said(f"The page is at {address} on this machine; Ctrl-C ends it.")
    if show:
        webbrowser.open(address)
    try:
        server.start()
        server.io_loop.start()
    finally:
        server.stop()
        ended = end_jobs(_PATIENCE)
    return ended
