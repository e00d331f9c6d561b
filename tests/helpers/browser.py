"""A real browser on a page, that of `pdssjax explore` above all, and what its console and its network have to say."""

import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
from urllib.parse import urlsplit

import pytest

BROWSERS = "chromium", "chromium-browser", "google-chrome", "chrome"
PATIENCE = 120_000
"""Milliseconds in which something must have come: what is compiled on a machine that does much else."""


def browser_path():
    """The browser; skips where there is none, but fails in CI, which installs one."""
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None and os.environ.get("CI"):
        pytest.fail(f"found no browser ({', '.join(BROWSERS)}), expected one in CI: apt-get install chromium")
    if found is None:
        pytest.skip(f"found no browser ({', '.join(BROWSERS)})")
    return found


DEEP = """
const deep = (selector, root = document) => {
  const here = root.querySelector(selector);
  if (here) return here;
  for (const e of root.querySelectorAll('*')) {
    if (e.shadowRoot) { const found = deep(selector, e.shadowRoot); if (found) return found; }
  }
  return null;
};
"""
"""Finds an element also within the widgets, each of which has a tree of its own."""
SELDOM = 200
"""Milliseconds between looks at a page: by default it is looked through in every frame, while a server computes."""
CHI2 = "() => {" + DEEP + "const e = deep('.headline'); return e && e.shadowRoot.textContent.includes('chi-square'); }"


@contextlib.contextmanager
def served(folder, *files, program=("-m", "pdssjax")):
    """The command at work in a `folder`, and where its page is; Ctrl-C ends it well, and it has told of no failure."""
    browser_path()
    command = [sys.executable, *program, "explore", *files, "--no-browser"]
    paths = os.pathsep.join(filter(None, [os.getcwd(), os.environ.get("PYTHONPATH")]))
    complaints = folder / "stderr.txt"
    with (
        complaints.open("w") as stderr,
        subprocess.Popen(
            command,
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=stderr,
            text=True,
            env={**os.environ, "PYTHONPATH": paths},
        ) as server,
    ):
        assert server.stdout is not None
        told = re.search(r"http://127\.0\.0\.1:\d+/[0-9a-f]{32}", server.stdout.readline())
        assert told, "the command says where the page is"
        yield told[0]
        server.send_signal(signal.SIGINT)
        assert server.wait(90) == 0
    assert "Traceback" not in complaints.read_text()


FOREIGN = "evil.example"
"""A name of somebody else that the browser resolves to this machine: DNS rebinding."""


@contextlib.contextmanager
def browsed(address, width=1366, height=768):
    """A page on a screen of that size, the errors of its console, and the hosts that it asked."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=browser_path(), args=["--no-sandbox", f"--host-resolver-rules=MAP {FOREIGN} 127.0.0.1"]
        )
        page = browser.new_page(viewport={"width": width, "height": height})
        errors, hosts = [], set()
        page.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: hosts.add(urlsplit(request.url).hostname or "within the page"))
        page.on("websocket", lambda socket: hosts.add(urlsplit(socket.url).hostname))
        page.goto(address, timeout=PATIENCE)
        yield page, errors, hosts
        browser.close()


@contextlib.contextmanager
def opened_page(address):
    """The page of `pdssjax explore` on a small screen, ready, as `browsed` gives it."""
    with browsed(address) as (page, errors, hosts):
        page.wait_for_function(CHI2, timeout=PATIENCE, polling=SELDOM)
        yield page, errors, hosts


def said(page, where, text):
    """Waits until a line says `text`."""
    page.locator(f".{where}", has_text=re.compile(text)).first.wait_for(timeout=PATIENCE)


def shows(box, value):
    """Waits until a field holds `value`, a text or a pattern."""
    from playwright.sync_api import expect

    expect(box).to_have_value(value, timeout=PATIENCE)


def show_tab(page, name):
    page.locator(".bk-tab", has_text=name).click()


def visible_plots(page, within):
    """Where the plots are that one sees, as boxes; each may have several canvases."""
    boxes = [plot.bounding_box() for plot in page.locator(f".{within} canvas").all() if plot.is_visible()]
    return [box for box in boxes if box["width"] > 200 and box["height"] > 150]
