"""The server of Bokeh with one page for each browser that asks."""

import asyncio
import socket
from typing import Any

import panel as pn
from bokeh.server.server import Server
from panel.io.resources import LOCAL_DIST
from tornado.websocket import WebSocketClosedError

from ..workbench import Workbench
from .page import Page
from .style import PAGE, Widget


def page_server(bench: Workbench, address: str, port: int) -> Server:
    """A server of pages of `bench`, bound but not yet started; `port` 0 takes a free one.

    **Raises:** `OSError` where the port is taken.
    """
    pn.extension(raw_css=[PAGE], notifications=False)
    port = port or _free_port(address)
    # A page of another origin may not talk to this one.
    origins = [f"{address}:{port}", f"localhost:{port}"]
    made: Widget = pn.serve(
        {"/": lambda: _view(bench)},
        title=f"pdssjax: {bench.study.title}",
        address=address,
        port=port,
        websocket_origin=origins,
        start=False,
        show=False,
        threaded=False,
        verbose=False,
    )
    loop: asyncio.AbstractEventLoop = made.io_loop.asyncio_loop
    loop.set_exception_handler(_failed)
    return made


def _failed(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Tells of what failed behind the pages, but not that one was closed while it was being sent something."""
    if not isinstance(context.get("exception"), WebSocketClosedError):
        loop.default_exception_handler(context)


def _view(bench: Workbench) -> Widget:
    document = pn.state.curdoc
    assert document is not None
    # Or Panel would take the style sheets of whatever is added later from the network.
    document.template_variables["dist_url"] = LOCAL_DIST
    return Page(bench, document).view


def _free_port(address: str) -> int:
    with socket.socket() as tried:
        tried.bind((address, 0))
        return int(tried.getsockname()[1])
