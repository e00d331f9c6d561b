"""`pdssjax`, which writes down what Bokeh sends by itself, past what Panel keeps in order."""

import sys
from pathlib import Path

import panel
from bokeh.server.session import ServerSession

from pdssjax.cli.main import main

LOG = "sent-by-bokeh.txt"
"""In the working folder."""


def _written(self, event):
    # What the browser changed is not sent back to it, and before it has the page all goes this way.
    if event.setter is not self and panel.state.loaded:
        with Path(LOG).open("a") as file:
            file.write(f"{type(event).__name__}: {event.model}.{event.attr}\n")
    at_once(self, event)


if __name__ == "__main__":
    at_once = ServerSession._document_patched
    ServerSession._document_patched = _written
    sys.exit(main())
