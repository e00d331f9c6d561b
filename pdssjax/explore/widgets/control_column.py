"""The left column: sliders with fields for exact numbers, a fit from these numbers, and saving them."""

import html
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import panel as pn

from ...core import InputError
from ...study import Study
from ..background_job import BackgroundJob
from ..settings import POSITIONS, Choice, Knob, Settings, group_of
from ..workbench import FitResult, fit_from_here
from .page_thread import PageThread
from .style import COMPACT, LEFT, MESSAGE, Widget, button

OnChange = Callable[[str, float], None]
"""Takes the path of a changed number, and the number [SI]."""

OnMessage = Callable[[str], None]
"""Takes a line for the user; "" removes the last line."""

_HEADINGS = {"drive": "drive of all records", "effector": "end-effector"}
"""Headings of groups that differ from the group's name in a study."""


class ControlRow:
    """A slider and a field for one number."""

    def __init__(self, knob: Knob, number: float, on_change: OnChange, on_message: OnMessage):
        self.knob = knob._replace(range=knob.range.widened(number, knob.quantity))
        self._on_change, self._on_message, self._quiet = on_change, on_message, False
        name = knob.path.partition(".")[2] or knob.path
        tag = "" if knob.free or not knob.parameter else ' <span style="color:#888">fixed</span>'
        label = f'<span title="{html.escape(knob.path)}">{html.escape(name)}{tag}</span>'
        marked = knob.path.replace(".", "-").replace("_", "-").replace("@", "-")
        self._slider = pn.widgets.IntSlider(
            start=0,
            end=POSITIONS,
            value=self.knob.range.position(number),
            show_value=False,
            tooltips=False,
            width=118,
            margin=(3, 6, 0, 0),
            css_classes=["slider", f"slider-{marked}"],
        )
        self._field = pn.widgets.TextInput(
            value=knob.text(number), width=82, margin=0, stylesheets=[COMPACT], css_classes=["field", f"field-{marked}"]
        )
        self._slider.param.watch(self._slid, "value")
        self._field.param.watch(self._typed, "value")
        self.view = pn.Row(
            pn.pane.HTML(label, width=112, margin=(3, 2, 0, 0), styles={"font-size": "12px"}),
            self._slider,
            self._field,
            pn.pane.HTML(html.escape(knob.unit), width=44, margin=(3, 0, 0, 4), styles={"font-size": "12px"}),
            margin=0,
            height=26,
        )

    def show(self, number: float) -> None:
        """Move slider and field to `number` [SI] without reporting a change."""
        self.knob = self.knob._replace(range=self.knob.range.widened(number, self.knob.quantity))
        self._set(self._slider, self.knob.range.position(number))
        self._set(self._field, self.knob.text(number))

    def _set(self, widget: Widget, value: object) -> None:
        """Set the value of a widget without reporting a change."""
        self._quiet = True
        try:
            widget.value = value
        finally:
            self._quiet = False

    def _slid(self, event: object) -> None:
        if not self._quiet:
            number = self.knob.range.number(self._slider.value)
            self._set(self._field, self.knob.text(number))
            self._on_message("")
            self._on_change(self.knob.path, number)

    def _typed(self, event: object) -> None:
        if self._quiet:
            return
        try:
            number = self.knob.read(self._field.value)
        except InputError as error:
            self._on_message(str(error))
            return
        self._on_message("")
        self.show(number)
        self._on_change(self.knob.path, number)


class ControlGroup:
    """Rows of numbers under the headings of their models, and rows of words."""

    def __init__(
        self,
        knobs: Sequence[Knob],
        words: Sequence[Choice],
        numbers: Mapping[str, float],
        on_change: OnChange,
        on_message: OnMessage,
        title: str = "",
    ):
        """A `title` takes the place of the names of the models."""
        self.rows = {knob.path: ControlRow(knob, numbers[knob.path], on_change, on_message) for knob in knobs}
        parts: list[Widget] = []
        for group in dict.fromkeys(group_of(path) for path in self.rows):
            parts.append(heading(title or _HEADINGS.get(group, group)))
            parts += [row.view for path, row in self.rows.items() if group_of(path) == group]
        parts += [_words(choice, numbers[choice.path], on_change) for choice in words]
        self.view = pn.Column(*parts, margin=0)

    def show(self, numbers: Mapping[str, float]) -> None:
        """Move all sliders to the `numbers` [SI]."""
        for path, row in self.rows.items():
            if path in numbers:
                row.show(numbers[path])


def heading(text: str) -> Widget:
    """The heading of a group of rows."""
    return pn.pane.HTML(f"<b>{html.escape(text)}</b>", margin=(4, 0, 0, 0), styles={"font-size": "12px"})


def _words(choice: Choice, number: float, on_change: OnChange) -> Widget:
    """A row with a list of words."""
    name = choice.path.partition(".")[2]
    word = next(word for word, stands_for in choice.words.items() if stands_for == number)
    select = pn.widgets.Select(
        options=dict(choice.words),
        value=choice.words[word],
        width=118,
        height=24,
        margin=0,
        stylesheets=[LEFT.replace("28px", "24px")],
        css_classes=[f"choice-{name.replace('_', '-')}"],
    )
    select.param.watch(lambda event: on_change(choice.path, float(event.new)), "value")
    label = pn.pane.HTML(html.escape(name), width=112, margin=(3, 2, 0, 0), styles={"font-size": "12px"})
    return pn.Row(label, select, margin=0, height=26)


class FitBox:
    """Buttons that begin and cancel a fit, and a line with its progress."""

    def __init__(
        self, study: Study, here: Callable[[], Settings], fitted: Callable[[FitResult], None], thread: PageThread
    ):
        self._study, self._here, self._fitted, self._thread = study, here, fitted, thread
        self._job: BackgroundJob[FitResult] | None = None
        self._fit = button("Fit from here", self._begin, "fit", color="primary", margin=(2, 6, 2, 0))
        self._cancel = button("Cancel", self._stop, "cancel", margin=(2, 0), disabled=True)
        self._line = pn.pane.HTML(
            "", margin=0, width=372, styles={"font-size": "12px", "min-height": "30px"}, css_classes=["fit-said"]
        )
        self.view: Widget = pn.Column(pn.Row(self._fit, self._cancel, margin=0), self._line, margin=0)

    def _begin(self) -> None:
        settings = self._here()
        self._fit.disabled, self._cancel.disabled = True, False
        self._say("The fit compiles; the page can be used meanwhile.")
        self._job = self._thread.start(
            lambda report: fit_from_here(self._study, settings, report), self._end, self._show_progress
        )

    def _stop(self) -> None:
        if self._job is not None:
            self._cancel.disabled = True
            self._job.cancel()
            self._say("Cancelling: the step in progress is finished first.")

    def _show_progress(self, line: str) -> None:
        if not self._cancel.disabled:
            self._say(line)

    def _end(self, result: FitResult | None, error: BaseException | None) -> None:
        self._fit.disabled, self._cancel.disabled = False, True
        if result is None:
            reason = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            self._say(f"The fit failed: {reason}")
            return
        self._fitted(result)
        self._say(result.message)

    def _say(self, line: str) -> None:
        self._line.object = html.escape(line)


class SaveBox:
    """A field for the path, a button, and a line with the result."""

    def __init__(self, suggested: Path, save: Callable[[Path, bool], Path]):
        """`save` writes a study to a path, over another study if True, and returns the absolute path."""
        self._save, self._folder = save, suggested.parent
        self._path = pn.widgets.TextInput(
            value=suggested.name, width=182, margin=(2, 6, 2, 0), stylesheets=[LEFT], css_classes=["save-path"]
        )
        self._replace = pn.widgets.Checkbox(
            label="replace", margin=(8, 0, 0, 0), width=68, css_classes=["save-replace"]
        )
        self._line = pn.pane.HTML(
            f"in {html.escape(str(self._folder))}", margin=0, width=372, styles=MESSAGE, css_classes=["save-said"]
        )
        save_button = button("Save as study", self._press, "save", margin=(2, 6))
        self.view: Widget = pn.Column(pn.Row(self._path, save_button, self._replace, margin=0), self._line, margin=0)

    def _press(self) -> None:
        # A name without a folder is a file beside the study.
        target = self._folder / os.path.expanduser(self._path.value.strip())
        try:
            saved = self._save(target, bool(self._replace.value))
        except InputError as error:
            line = f"Not saved: {error}"
        except OSError as error:
            line = f"Not saved: {target} cannot be written ({error.strerror or error})."
        else:
            line = f"Saved: {saved}"
            self._replace.value = False
        self._line.object = html.escape(line)
