"""One page in one browser: numbers on the left, plots on the right."""

import html
import time

import panel as pn

from ...core import InputError
from ..background_job import BackgroundJob, Report
from ..live_record import Redraw, Score, clipped_stretch, cycle_of, initial_stretch, instants_of
from ..settings import Settings, drive_choices, drive_knobs, parameter_knobs
from ..workbench import FitResult, Workbench
from .control_column import ControlGroup, FitBox, SaveBox
from .estimate_tab import EstimateTab
from .page_thread import PageThread, in_order
from .record_tabs import ContactTab, RecordTab, ScoreTable, keyboard_buttons
from .style import COLUMN_WIDTH, CUT, LEFT, MESSAGE, Widget, button
from .sweep_tab import SweepPage

_IDLE_MS = 250
"""Pause [ms] without changes before the other records are predicted."""

_HEADLINE = {"align-self": "center", "min-width": "0", "max-height": "38px", "overflow-y": "auto"}
"""Style of the text above the plots, of up to two lines."""

_PLACE = {"min-height": "0", "flex": "1 1 0"}
"""Style of the place for the plots of a record."""


class Page:
    """The widgets of one page, and its numbers."""

    def __init__(self, workbench: Workbench, thread: PageThread):
        self._bench, self._thread = workbench, thread
        self._settings, self._study = workbench.initial, workbench.study
        self._record = workbench.first()
        self._window = initial_stretch(self._record)
        self._redraw_asked = self._scores_asked = False
        self._job: BackgroundJob[Redraw] | None = None
        self._scoring: BackgroundJob[dict[str, Score]] | None = None
        self._scores: dict[str, Score] = {}
        self._build()
        self._show_record(self._record.name)

    # Layout

    def _build(self) -> None:
        names = [record.name for record in self._study.records]
        self._select = pn.widgets.Select(
            options=names, value=self._record.name, width=190, height=28, margin=(4, 4), stylesheets=[LEFT],
            css_classes=["record"],
        )  # fmt: skip
        self._select.param.watch(lambda event: self._choose(str(event.new)), "value")
        self._headline = pn.pane.HTML(
            "", margin=(0, 8), sizing_mode="stretch_width", styles=_HEADLINE, css_classes=["headline"]
        )
        self._message = pn.pane.HTML(
            "", margin=(2, 0), width=372, styles=MESSAGE | {"color": "#b03a00"}, css_classes=["said"]
        )
        knobs = parameter_knobs(self._study)
        change = lambda path, number: self._change(self._settings.with_values({path: number}))
        self._parameters = ControlGroup(knobs, [], self._settings.values, change, self._say)
        self._drive_place = pn.Column(margin=0)
        self._estimate = EstimateTab()
        self._scores_table = ScoreTable(self._study.records)
        self._fit = FitBox(self._study, lambda: self._settings, self._fitted, self._thread)
        self._sweep = SweepPage(self._bench, lambda: self._settings, lambda: self._record.name, self._thread)
        save = lambda target, overwrite: self._bench.save(self._settings, target, overwrite)
        self._save = SaveBox(self._bench.free_path(), save)
        self._record_place, self._contact_place = _place(), _place()
        if self._bench.estimate is not None:
            self._estimate.show(self._bench.estimate)
        table = pn.Column(
            self._scores_table.view,
            sizing_mode="stretch_width",
            margin=0,
            styles={"max-height": "176px", "overflow-y": "auto", "flex": "0 0 auto"},
        )
        self._tabs = pn.Tabs(
            ("Record", pn.Column(self._record_place, table, sizing_mode="stretch_both", margin=0)),
            ("Contact and phase", self._contact_place),
            ("Estimate", self._estimate.view),
            ("Sweep", self._sweep.view),
            sizing_mode="stretch_both",
            margin=0,
            # With dynamic tabs, Panel loads style sheets from the network when hidden contents change.
            dynamic=False,
            css_classes=["tabs"],
        )
        self._tabs.param.watch(lambda event: self._ask_redraw(), "active")
        top = pn.Row(
            pn.pane.HTML("record", margin=(9, 4, 0, 4)),
            self._select,
            keyboard_buttons(self._move, self._widen),
            self._headline,
            margin=0,
            height=38,
        )
        right = {"margin": (0, 0, 0, 6), "styles": {"min-width": "0"}}
        self.view: Widget = pn.Row(
            self._column(),
            pn.Column(top, self._tabs, sizing_mode="stretch_both", **right),
            sizing_mode="stretch_both",
            margin=0,
            styles={"height": "100vh", "min-height": "560px", "overflow": "hidden"},
        )

    def _column(self) -> Widget:
        title = html.escape(self._study.title)
        reset = button("Reset", lambda: self._move_to(self._bench.initial), "reset", height=26, margin=(2, 0))
        sliders = pn.Column(
            self._drive_place,
            self._parameters.view,
            margin=0,
            styles={"overflow-y": "auto", "overflow-x": "hidden", "flex": "1 1 0", "min-height": "0"},
            sizing_mode="stretch_width",
        )
        return pn.Column(
            pn.Row(
                pn.pane.HTML(
                    f'<b class="cut" title="{title}">{title}</b>', margin=(6, 8, 0, 0), width=300, stylesheets=[CUT]
                ),
                reset,
                margin=0,
                height=32,
            ),
            sliders,
            self._message,
            self._fit.view,
            self._save.view,
            width=COLUMN_WIDTH,
            margin=(0, 0, 6, 8),
            styles={"height": "calc(100vh - 8px)", "min-height": "550px", "flex": f"0 0 {COLUMN_WIDTH}px"},
        )

    # Changes of numbers

    def _change(self, settings: Settings) -> None:
        self._settings = settings
        self._ask_redraw()

    def _move_to(self, settings: Settings) -> None:
        """Move all sliders to the numbers of `settings`."""
        self._settings = settings
        self._say("")
        self._parameters.show(settings.values)
        self._show_drive()
        self._ask_redraw()

    def _show_drive(self) -> None:
        record = self._record
        knobs, words = drive_knobs(self._study, record), drive_choices(record)
        numbers = self._settings.drives[record.name]
        change = lambda path, number: self._change(self._settings.with_drive(record.name, path, number))
        group = ControlGroup(knobs, words, numbers, change, self._say, "drive of this record")
        self._drive_place.objects = [group.view]

    @in_order
    def _choose(self, name: str) -> None:
        """Show another record; the headline announces it first, since its plots take a second or more."""
        self._dim(True)
        self._say("")
        self._headline.object = f"drawing {html.escape(name)}; the pale plots are of {html.escape(self._record.name)}"
        # Of records chosen quickly one after the other only the last is drawn.
        self._thread.later(lambda: self._show_record(name) if name == self._select.value else None)

    def _show_record(self, name: str) -> None:
        self._record = record = self._bench.record(name)
        self._window = initial_stretch(record)
        self._show_drive()
        self._record_tab = RecordTab(record, self._window, self._enlarge)
        self._contact_tab = ContactTab(record)
        # Draw before showing, since plots without data have no ranges.
        self._redraw(every_tab=True)
        self._record_place.objects = [self._record_tab.view]
        self._contact_place.objects = [self._contact_tab.view]

    @in_order
    def _enlarge(self, begin: float, end: float) -> None:
        self._window = clipped_stretch(self._record, begin, end)
        self._record_tab.enlarge(self._window)
        self._ask_redraw()

    def _move(self, cycles: float) -> None:
        shift = cycles * cycle_of(self._record)
        self._enlarge(self._window[0] + shift, self._window[1] + shift)

    def _widen(self, factor: float) -> None:
        begin, end = self._window
        middle, half = 0.5 * (begin + end), 0.5 * factor * (end - begin)
        self._enlarge(middle - half, middle + half)

    # Drawing

    def _ask_redraw(self) -> None:
        """Schedule one drawing for all requests until then."""
        if not self._redraw_asked:
            self._redraw_asked = True
            self._thread.later(self._redraw)

    def _redraw(self, every_tab: bool = False) -> None:
        self._redraw_asked = False
        start = time.perf_counter()
        name, settings, instants = self._record.name, self._settings, instants_of(self._record, *self._window)
        try:
            found = self._bench.records.redraw_at_once(name, settings, instants)
        except InputError as error:
            self._cannot_show(error)
            return
        if found is None:
            self._compile()
            return
        self._draw(found, start, every_tab)
        self._ask_scores()

    def _draw(self, found: Redraw, start: float, every_tab: bool) -> None:
        self._dim(False)
        if every_tab or self._tabs.active == 0:
            self._record_tab.draw(found)
        if every_tab or self._tabs.active == 1:
            self._contact_tab.draw(found, self._window, self._record)
        self._scores[self._record.name] = found.score
        self._scores_table.show(self._scores, self._record.name, stale=True)
        took = 1e3 * (time.perf_counter() - start)
        result = f"chi-square / n <b>{found.score.chi2:.4g}</b>"
        if found.message:
            result = "the simulation fails"
            self._say(found.message)
        self._headline.object = f'{result} <span style="color:#777" class="took">redrawn in {took:.0f} ms</span>'

    def _compile(self) -> None:
        """Compile in a thread, and draw the current numbers at its end."""
        self._dim(True)
        if self._job is not None and self._job.is_running:
            return
        self._headline.object = "compiling for this record: some seconds, once"
        if self._bench.records.is_ready(self._record.name):
            self._headline.object = "compiling for these numbers: some seconds; the pale plots are of earlier ones"
        name, settings, instants = self._record.name, self._settings, instants_of(self._record, *self._window)
        work = lambda report: self._bench.records.redraw(name, settings, instants)
        self._job = self._thread.start(work, lambda result, error: self._compiled(error, name, settings))

    def _dim(self, earlier: bool) -> None:
        """Make the plots pale if they are of `earlier` numbers than those of the sliders."""
        for place in (self._record_place, self._contact_place):
            place.styles = _PLACE | {"opacity": "0.3" if earlier else "1"}

    def _compiled(self, error: BaseException | None, name: str, settings: Settings) -> None:
        self._job = None
        if error is None or (name, settings) != (self._record.name, self._settings):
            self._ask_redraw()
        else:
            self._cannot_show(error)

    def _cannot_show(self, error: BaseException) -> None:
        self._dim(True)
        self._headline.object = "cannot be shown; the pale plots are of earlier numbers"
        self._say(str(error))

    # Scores of all records, after a pause without changes

    def _ask_scores(self) -> None:
        if not self._scores_asked:
            self._scores_asked = True
            self._thread.after(_IDLE_MS, self._score)

    def _score(self) -> None:
        self._scores_asked = False
        if self._scoring is not None and self._scoring.is_running:
            self._ask_scores()
            return
        settings = self._settings

        def all_scores(report: Report) -> dict[str, Score]:
            scores = {}
            for record in self._study.records:
                report(record.name)  # raises where the job was cancelled
                instants = instants_of(record, *initial_stretch(record))
                scores[record.name] = self._bench.records.redraw(record.name, settings, instants).score
            return scores

        self._scoring = self._thread.start(all_scores, lambda scores, error: self._scored(scores, error, settings))

    def _scored(self, scores: dict[str, Score] | None, error: BaseException | None, settings: Settings) -> None:
        self._scoring = None
        if scores is None:
            self._say(str(error))
            return
        self._scores = scores
        self._scores_table.show(scores, self._record.name, stale=settings != self._settings)
        if settings != self._settings:
            self._ask_scores()

    # Messages, and the result of a fit

    def _say(self, line: str) -> None:
        self._message.object = html.escape(line)

    def _fitted(self, result: FitResult) -> None:
        if result.estimate is None:
            return
        self._estimate.show(result.estimate)
        values = {path: parameter.value for path, parameter in result.estimate.parameters.items()}
        self._move_to(self._settings.with_values(values))


def _place() -> Widget:
    """A place for the plots of a record."""
    return pn.Column(sizing_mode="stretch_both", margin=0, styles=_PLACE, css_classes=["plots"])
