"""Where the numbers of the sliders are saved as a study of their own."""

import html
import os
from collections.abc import Callable
from pathlib import Path

import panel as pn

from ...core import InputError
from .style import LEFT, Widget

Save = Callable[[Path, bool], Path]
"""Writes a study to a path, over another if so told; gives its whole path.  Raises `InputError` or `OSError`."""


class SaveBox:
    """A path, a button, and what came of it."""

    def __init__(self, suggested: Path, save: Save):
        self._save, self._folder = save, suggested.parent
        self._path = pn.widgets.TextInput(
            value=suggested.name,
            width=190,
            margin=(2, 6, 2, 0),
            stylesheets=[LEFT],
            css_classes=["save-path"],
        )
        self._button = pn.widgets.Button(label="Save as study", height=28, margin=(2, 6, 2, 0), css_classes=["save"])
        self._replace = pn.widgets.Checkbox(
            label="replace", margin=(8, 0, 0, 0), width=68, css_classes=["save-replace"]
        )
        self._line = pn.pane.HTML(
            f"in {html.escape(str(self._folder))}",
            margin=0,
            width=372,
            styles={"font-size": "12px", "overflow-wrap": "anywhere"},
            css_classes=["save-said"],
        )
        self._button.on_click(lambda event: self._press())
        self.view: Widget = pn.Column(pn.Row(self._path, self._button, self._replace, margin=0), self._line, margin=0)

    def _press(self) -> None:
        # A path alone is a file beside the study; one with folders is taken as it is.
        target = self._folder / os.path.expanduser(self._path.value.strip())
        try:
            saved = self._save(target, bool(self._replace.value))
        except InputError as error:
            said = f"Not saved: {error}"
        except OSError as error:
            said = f"Not saved: {target} cannot be written ({error.strerror or error})."
        else:
            said = f"Saved: {saved}"
            self._replace.value = False
        self._line.object = html.escape(said)
