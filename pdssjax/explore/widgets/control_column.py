"""The sliders: one a number, with a field beside it that takes the exact number."""

import html
from collections.abc import Callable, Mapping, Sequence

import panel as pn

from ...core import InputError
from ..knobs import Choice, Knob, group_of
from ..slider_range import POSITIONS
from .style import COMPACT, LEFT, Widget

Turned = Callable[[str, float], None]
"""Told the path of what was turned, and its number [SI]."""

Said = Callable[[str], None]
"""Told a line for the user."""


_HEADINGS = {"drive": "drive of all records", "effector": "end-effector"}
"""Of groups of parameters that are not called as in a study."""


class ControlRow:
    """A slider, and the field beside it."""

    def __init__(self, knob: Knob, number: float, turned: Turned, said: Said):
        self.knob, self._turned, self._said = (
            knob._replace(range=knob.range.widened(number, knob.quantity)),
            turned,
            said,
        )
        self._quiet = False
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
            value=knob.text(number),
            width=82,
            margin=0,
            stylesheets=[COMPACT],
            css_classes=["field", f"field-{marked}"],
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
        """Moves slider and field to `number` [SI] without telling anybody."""
        self.knob = self.knob._replace(range=self.knob.range.widened(number, self.knob.quantity))
        self._quiet = True
        try:
            self._slider.value = self.knob.range.position(number)
            self._field.value = self.knob.text(number)
        finally:
            self._quiet = False

    def _slid(self, event: object) -> None:
        if not self._quiet:
            number = self.knob.range.number(self._slider.value)
            self._quiet = True
            try:
                self._field.value = self.knob.text(number)
            finally:
                self._quiet = False
            self._said("")
            self._turned(self.knob.path, number)

    def _typed(self, event: object) -> None:
        if self._quiet:
            return
        try:
            number = self.knob.read(self._field.value)
        except InputError as error:
            self._said(str(error))
            return
        self._said("")
        self.show(number)
        self._turned(self.knob.path, number)


class ControlGroup:
    """The rows of some numbers under headings, and of the words among them."""

    def __init__(
        self,
        knobs: Sequence[Knob],
        words: Sequence[Choice],
        numbers: Mapping[str, float],
        turned: Turned,
        said: Said,
        title: str = "",
    ):
        """With a `title` that stands in place of the names of the models."""
        self.rows = {knob.path: ControlRow(knob, numbers[knob.path], turned, said) for knob in knobs}
        parts: list[Widget] = []
        for group in dict.fromkeys(group_of(path) for path in self.rows):
            parts.append(heading(title or _HEADINGS.get(group, group)))
            parts += [row.view for path, row in self.rows.items() if group_of(path) == group]
        parts += [_words(choice, numbers[choice.path], turned) for choice in words]
        self.view = pn.Column(*parts, margin=0)

    def show(self, numbers: Mapping[str, float]) -> None:
        """Moves all sliders to the `numbers` [SI]."""
        for path, row in self.rows.items():
            if path in numbers:
                row.show(numbers[path])


def heading(text: str) -> Widget:
    """Above the rows of a model."""
    return pn.pane.HTML(f"<b>{html.escape(text)}</b>", margin=(4, 0, 0, 0), styles={"font-size": "12px"})


def _words(choice: Choice, number: float, turned: Turned) -> Widget:
    """A row of buttons, one a word."""
    name = choice.path.partition(".")[2]
    word = next(word for word, stands_for in choice.words.items() if stands_for == number)
    buttons = pn.widgets.Select(
        options=dict(choice.words),
        value=choice.words[word],
        width=118,
        height=24,
        margin=0,
        stylesheets=[LEFT.replace("28px", "24px")],
        css_classes=[f"choice-{name.replace('_', '-')}"],
    )
    buttons.param.watch(lambda event: turned(choice.path, float(event.new)), "value")
    label = pn.pane.HTML(html.escape(name), width=112, margin=(3, 2, 0, 0), styles={"font-size": "12px"})
    return pn.Row(label, buttons, margin=0, height=26)
