"""What the tab of a sweep shows when, and the jobs behind it."""

import html
from collections.abc import Callable
from typing import TYPE_CHECKING

from ...core import InputError
from ..background_job import BackgroundJob
from ..settings import Settings
from ..sweep_map import SweepMap, sweep_map
from ..sweep_walk import Walk, Walker, small_map
from ..workbench import Workbench
from .page_thread import PageThread
from .style import Widget
from .sweep_tab import SweepTab

if TYPE_CHECKING:
    import xarray


class SweepPage:
    """The tab, its map, and the walks in it."""

    def __init__(self, bench: Workbench, here: Callable[[], Settings], chosen: Callable[[], str], thread: PageThread):
        """`chosen` tells the name of the record that the page shows."""
        self._bench, self._here, self._chosen, self._thread = bench, here, chosen, thread
        self._tab = SweepTab(self._choose, self._make, self._cancel)
        self._map: SweepMap | None = None
        self._walker: Walker | None = None
        self._job: BackgroundJob[xarray.Dataset] | None = None
        self._walk_job: BackgroundJob[Walk] | None = None
        self._wanted: int | None = None
        if bench.sweep is not None:
            self._show(bench.sweep)

    @property
    def view(self) -> Widget:
        """The tab."""
        return self._tab.view

    def _show(self, data: "xarray.Dataset") -> None:
        try:
            self._map = sweep_map(data)
            self._walker = Walker(self._bench.study, self._map.record)
            if not self._map.axes:
                raise InputError("the sweep has no axis, expected one at least.")
        except (InputError, KeyError) as error:
            self._say(f"The sweep cannot be shown: {error}")
            return
        self._tab.show(self._map)

    def _choose(self, point: int) -> None:
        """Walks the point chosen; of points chosen meanwhile the last."""
        self._wanted = point
        if self._walk_job is None or not self._walk_job.runs:
            self._walk_wanted()

    def _walk_wanted(self) -> None:
        point, found, walker = self._wanted, self._map, self._walker
        if point is None or found is None or walker is None:
            return
        self._wanted = None
        numbers = found.numbers(point)
        self._walk_job = self._thread.start(
            lambda report: walker.motion(numbers), lambda motion, error: self._walked(numbers, motion, error)
        )

    def _walked(self, numbers: dict[str, float], motion: Walk | None, error: BaseException | None) -> None:
        self._walk_job = None
        if motion is None:
            self._say(f"The point cannot be simulated: {error}")
        else:
            self._tab.show_walk(numbers, motion)
        self._walk_wanted()

    def _make(self) -> None:
        settings, chosen = self._here(), self._chosen()
        self._tab.make.disabled, self._tab.stop.disabled = True, False
        work = lambda report: small_map(self._bench.study, settings, report, chosen)
        self._job = self._thread.start(work, self._made, self._say)

    def _cancel(self) -> None:
        if self._job is not None:
            self._job.cancel()

    def _made(self, data: "xarray.Dataset | None", error: BaseException | None) -> None:
        self._tab.make.disabled, self._tab.stop.disabled = False, True
        if data is not None:
            self._say("")
            self._show(data)
        else:
            self._say("cancelled" if isinstance(error, KeyboardInterrupt) else f"No map: {error}")

    def _say(self, line: str) -> None:
        self._tab.said.object = html.escape(line)
