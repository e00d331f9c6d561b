"""The server answers the page whose address was told, and nobody else."""

import logging
from types import SimpleNamespace

import pytest
from walking_study import write_walking

from pdssjax import InputError, load_study

pn = pytest.importorskip("panel")
from tornado.httpclient import AsyncHTTPClient, HTTPClientError, HTTPRequest  # noqa: E402  (needs Panel)
from tornado.websocket import WebSocketClosedError, websocket_connect  # noqa: E402  (needs Panel)

from pdssjax.explore import Workbench, settings_of  # noqa: E402  (needs Panel)
from pdssjax.explore.widgets import server as serving  # noqa: E402  (needs Panel)
from pdssjax.explore.widgets.server import Site, page_server  # noqa: E402  (needs Panel)

SITE = Site(5006, "5ec7e7")
HERE = {"Host": "127.0.0.1:5006"}
NEEDED = ("/5ec7e7", "/5ec7e7/ws", "/static/js/bokeh.min.js")


def test_the_page_and_what_it_needs_are_answered_and_nothing_else():
    for path in (*NEEDED, "/favicon.ico"):
        assert SITE.admits(path, HERE) and SITE.admits(path, HERE | {"Origin": "http://127.0.0.1:5006"})
    others = "/ /ws /5ec7e8 /5ec7e8/ws /5ec7e7/ /5ec7e7/metadata /5ec7e7/autoload.js /5ec7e7/static/x.js /é"
    for path in (*others.split(), "/components/antigravity/a/_css/b"):
        assert not SITE.admits(path, HERE), path


@pytest.mark.parametrize(
    "headers",
    [
        {},
        *({"Host": host} for host in ("evil.example:5006", "127.0.0.1", "127.0.0.1:5007", "127.0.0.1:5006.evil.org")),
        *(HERE | {"Origin": f"http://{origin}"} for origin in ("evil.example", "127.0.0.1:5007")),
        HERE | {"Origin": "https://127.0.0.1:5006"},
        HERE | {"Origin": "null"},
    ],
)
def test_other_hosts_and_origins_are_refused_even_with_the_secret(headers):
    assert not any(SITE.admits(path, headers) for path in NEEDED)


def test_a_foreign_page_may_link_to_the_page_but_not_load_its_code():
    foreign = HERE | {"Sec-Fetch-Site": "cross-site"}
    assert SITE.admits("/5ec7e7", foreign)
    assert not SITE.admits("/static/js/bokeh.min.js", foreign)


def test_browsers_leave_the_port_of_http_out_of_the_host():
    site = Site(80, "5ec7e7")
    assert site.address == "http://127.0.0.1:80/5ec7e7"
    assert site.admits("/5ec7e7", {"Host": "127.0.0.1", "Origin": "http://127.0.0.1"})


@pytest.fixture
def served(tmp_path, monkeypatch):
    """A server whose pages are one line, its site, and how many pages were made."""
    made = []
    monkeypatch.setattr(
        serving, "Page", lambda bench, thread: made.append(bench) or SimpleNamespace(view=pn.pane.HTML("one line"))
    )
    study = load_study(write_walking(tmp_path))
    server, site = page_server(Workbench(study, settings_of(study)), 0)
    server.start()
    yield server, site, made
    server.stop()


def answer(server, address, **asked):
    """What an HTTP request is answered."""
    fetch = lambda: AsyncHTTPClient().fetch(address, raise_error=False, follow_redirects=False, **asked)
    return server.io_loop.run_sync(fetch, timeout=60)


def test_the_address_that_is_told_has_the_page(served):
    server, site, made = served
    assert site.address == f"http://127.0.0.1:{server.port}/{site.secret}"
    assert len(site.secret) == 32
    found = answer(server, site.address)
    assert (found.code, len(made)) == (200, 1)
    assert b"pdssjax: Walking rig" in found.body


@pytest.mark.parametrize(
    ("path", "asked"),
    [
        ("/", {}),
        ("/", {"method": "POST", "body": "x"}),
        ("/", {"method": "OPTIONS"}),
        ("/components/antigravity/a/_css/b", {}),
        ("/SECRET", {"headers": {"Host": "evil.example"}}),
        ("/SECRET", {"headers": {"Origin": "http://evil.example"}}),
        ("/SECRET/autoload.js?bokeh-autoload-element=1", {}),
    ],
)
def test_a_stranger_is_refused_before_a_page_is_made(served, path, asked, capfd):
    server, site, made = served
    root = site.address.removesuffix(site.path)
    found = answer(server, root + path.replace("SECRET", site.secret), **asked)
    assert found.code == 403
    assert found.body == b"Refused. Open the whole address that pdssjax explore has printed.\n"
    assert site.secret not in str(found.headers)
    assert made == []
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("/SECRET/ws", {"Origin": "http://evil.example"}),
        ("/SECRET/ws", {"Host": "evil.example"}),
        ("/ws", {}),
        ("/0123456789abcdef0123456789abcdef/ws", {}),
    ],
)
def test_a_stranger_gets_no_websocket(served, path, headers):
    server, site, made = served
    address = site.address.replace("http", "ws").removesuffix(site.path) + path.replace("SECRET", site.secret)
    asked = HTTPRequest(address, headers={"Origin": f"http://{site.host}"} | headers)
    with pytest.raises(HTTPClientError, match="403"):
        server.io_loop.run_sync(lambda: websocket_connect(asked), timeout=60)
    assert made == []


def test_a_port_in_use_is_refused_in_a_line(served):
    server, _, _ = served
    with pytest.raises(InputError, match=f"option --port: found {server.port}, which cannot be used"):
        serving.serve(SimpleNamespace(study=SimpleNamespace(title="")), server.port, False, print)


def test_a_page_that_is_closed_while_it_is_sent_something_is_no_failure(served, caplog):
    loop = served[0].io_loop.asyncio_loop
    with caplog.at_level(logging.ERROR):
        loop.call_exception_handler({"message": "never retrieved", "exception": WebSocketClosedError()})
        assert caplog.records == []
        loop.call_exception_handler({"message": "never retrieved", "exception": ValueError("of another kind")})
        assert "of another kind" in caplog.text
