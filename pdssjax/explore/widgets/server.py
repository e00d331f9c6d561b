"""The server of the page, on the loopback address, for users who know the secret in the page's address.

Pages of other sites in the same browser can send requests to the loopback address, and by DNS rebinding (a name of
their own that resolves to 127.0.0.1) also read the answers.  So the address of the page has a secret in it.  A request
that does not name this address, or asks for a path that the page does not need, is refused before any other work.
"""

import asyncio
import hmac
import logging
import os
import secrets
import socket
import webbrowser
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import panel as pn
from bokeh.server.server import Server
from panel.io.resources import LOCAL_DIST
from tornado.httputil import HTTPServerRequest
from tornado.routing import Matcher, Rule
from tornado.web import RequestHandler
from tornado.websocket import WebSocketClosedError

from ...core import InputError
from ..background_job import end_jobs
from ..workbench import Workbench
from .page import Page
from .page_thread import PageThread
from .style import PAGE, Widget

ADDRESS = "127.0.0.1"

END_TIMEOUT = 20.0
"""Longest wait [s] at the end for work that cannot be stopped, such as compiling."""

_SHARED_PATHS = "/static/", "/favicon.ico"
"""Beginnings of paths without the secret: the code of Bokeh and Panel, which is public."""


def serve(bench: Workbench, port: int, show: bool, report: Callable[[str], None]) -> bool:
    """Serve pages of `bench` until Ctrl-C ends it.

    **Arguments:**

    - `port`: the port to listen on; 0 takes a free port.
    - `show`: whether to open the page in a browser.
    - `report`: takes a line with the address of the page.

    **Returns:** whether all jobs of the pages have ended, too.

    **Raises:** `InputError` where the port is taken.
    """
    try:
        server, site = page_server(bench, port)
    except OSError as error:
        raise InputError(
            f"option --port: found {port}, which cannot be used ({error.strerror}); expected another."
        ) from None
    report(f"The page is at {site.address} on this machine; Ctrl-C ends it.")
    if show:
        webbrowser.open(site.address)
    try:
        server.start()
        server.io_loop.start()
    finally:
        server.stop()
        ended = end_jobs(END_TIMEOUT)
    return ended


class Site(NamedTuple):
    """The address of the page, and the check of requests."""

    port: int
    secret: str

    @property
    def host(self) -> str:
        """The host in the requests of a browser on this page."""
        # Browsers leave out the default port.
        return ADDRESS if self.port == 80 else f"{ADDRESS}:{self.port}"

    @property
    def path(self) -> str:
        """The path of the page."""
        return f"/{self.secret}"

    @property
    def address(self) -> str:
        """The whole address of the page."""
        return f"http://{ADDRESS}:{self.port}{self.path}"

    def admits(self, path: str, headers: Mapping[str, str]) -> bool:
        """Whether a request for `path` comes from the page itself, or from a user who knows its address."""
        if headers.get("Host") != self.host or headers.get("Origin", f"http://{self.host}") != f"http://{self.host}":
            return False
        secret = any(hmac.compare_digest(path.encode(), known.encode()) for known in (self.path, f"{self.path}/ws"))
        foreign = headers.get("Sec-Fetch-Site", "none") not in ("none", "same-origin")
        return secret or (path.startswith(_SHARED_PATHS) and not foreign)


def page_server(bench: Workbench, port: int) -> tuple[Server, Site]:
    """A server of pages of `bench`, bound but not started, and its site; `port` 0 takes a free port.

    **Raises:** `OSError` where the port is taken.
    """
    pn.extension(raw_css=[PAGE], notifications=False)
    site = Site(_usable_port(port), secrets.token_hex(16))
    server: Widget = pn.serve(
        {site.path: lambda: _view(bench)},
        title=f"pdssjax: {bench.study.title}",
        address=ADDRESS,
        port=site.port,
        websocket_origin=[site.host],
        http_server_kwargs={"max_body_size": 1 << 16},
        start=False,
        show=False,
        threaded=False,
        verbose=False,
    )
    logging.getLogger("bokeh.server.views.ws").setLevel(logging.ERROR)  # no warnings of closed pages
    server._tornado.default_router.rules.insert(0, Rule(_Foreign(site), _Refusal))
    loop: asyncio.AbstractEventLoop = server.io_loop.asyncio_loop
    loop.set_exception_handler(_log_failure)
    return server, site


class _Foreign(Matcher):
    """Matches requests that a site does not admit."""

    def __init__(self, site: Site):
        self._site = site

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        return None if self._site.admits(request.path, request.headers) else {}


class _Refusal(RequestHandler):
    """Refuses foreign requests of any method, without a line in the log that a foreign page could flood."""

    def prepare(self) -> None:
        self.set_status(403)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish("Refused. Open the whole address that pdssjax explore has printed.\n")

    def _log(self) -> None:
        pass


def _log_failure(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Log an error behind the pages, but not that a page was closed during a transfer."""
    if not isinstance(context.get("exception"), WebSocketClosedError):
        loop.default_exception_handler(context)


def _view(bench: Workbench) -> Widget:
    document = pn.state.curdoc
    assert document is not None
    # Else Panel loads the style sheets of widgets that are added later from the network.
    document.template_variables["dist_url"] = LOCAL_DIST
    thread = PageThread(document)
    document.on_session_destroyed(lambda context: thread.cancel_jobs())
    return Page(bench, thread).view


def _usable_port(port: int) -> int:
    """`port`, or a free port for 0; **raises** `OSError` where it is taken."""
    with socket.socket() as tried:
        if os.name != "nt":  # on Windows this option takes the port of another server
            tried.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        tried.bind((ADDRESS, port))
        return int(tried.getsockname()[1])
