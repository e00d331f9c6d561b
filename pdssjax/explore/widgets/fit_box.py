"""Where a fit is begun from the sliders' numbers, watched, and cancelled."""

import html
from collections.abc import Callable

import panel as pn

from ...core import InputError
from ...study import Study
from ..background_job import BackgroundJob
from ..fit_from_here import FitResult, fit_from_here
from ..settings import Settings
from .page_thread import PageThread
from .style import Widget


class FitBox:
    """Two buttons and a line."""

    def __init__(
        self, study: Study, here: Callable[[], Settings], fitted: Callable[[FitResult], None], thread: PageThread
    ):
        self._study, self._here, self._fitted, self._thread = study, here, fitted, thread
        self._job: BackgroundJob[FitResult] | None = None
        self._fit = pn.widgets.Button(
            label="Fit from here", color="primary", height=28, margin=(2, 6, 2, 0), css_classes=["fit"]
        )
        self._cancel = pn.widgets.Button(
            label="Cancel", height=28, margin=(2, 0), disabled=True, css_classes=["cancel"]
        )
        self._fit.on_click(lambda event: self._begin())
        self._cancel.on_click(lambda event: self._stop())
        self._line = pn.pane.HTML(
            "", margin=0, width=372, styles={"font-size": "12px", "min-height": "30px"}, css_classes=["fit-said"]
        )
        self.view: Widget = pn.Column(pn.Row(self._fit, self._cancel, margin=0), self._line, margin=0)

    def _begin(self) -> None:
        settings = self._here()
        self._fit.disabled, self._cancel.disabled = True, False
        self._say("The fit compiles; the page can be used meanwhile.")
        self._job = self._thread.start(
            lambda report: fit_from_here(self._study, settings, report), self._ended, self._told
        )

    def _stop(self) -> None:
        if self._job is not None:
            self._cancel.disabled = True
            self._job.cancel()
            self._say("Cancelling: the step in progress is finished first.")

    def _told(self, line: str) -> None:
        if not self._cancel.disabled:
            self._say(line)

    def _ended(self, result: FitResult | None, error: BaseException | None) -> None:
        self._fit.disabled, self._cancel.disabled = False, True
        if result is None:
            what = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            self._say(f"The fit failed: {what}")
            return
        self._fitted(result)
        self._say(result.words)

    def _say(self, line: str) -> None:
        self._line.object = html.escape(line)
