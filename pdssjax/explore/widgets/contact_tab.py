"""The tab of the contact: phase portrait, force against displacement, and the force and the speed over time."""

from ...core import MICROMETRES
from ...study import Record
from ..redraw import Redraw
from .style import BLUE, GREY, MILLISECONDS, PURPLE, VERMILION, Model, column, models, pane, plain_figure, row

MILLIMETRES = 1e3
"""Millimetres in a metre, for speeds."""


class ContactTab:
    """Four plots: of the contact, or where there is none of the platform alone."""

    def __init__(self, record: Record):
        # Without an end-effector that moves the portrait is that of the platform.
        self._contact = "friction" in record.measurement.parts()
        self._driven = record.measurement.driven
        names = "displacement velocity force time".split()
        self._whole = models.ColumnDataSource({name: [] for name in names})
        self._near = models.ColumnDataSource({name: [] for name in names})
        self._measured = models.ColumnDataSource({"displacement": [], "force": []})
        what = "end-effector relative to platform" if self._driven else "prescribed motion"
        if not self._contact:
            what = "platform"
        place, speed = f"{what} (µm)", "relative velocity (mm/s)" if self._contact else "velocity (mm/s)"
        portrait = self._loops("Phase portrait", place, speed, "velocity")
        over_time = self._over_time(speed, "velocity", BLUE)
        if not self._contact:
            self.view = column(row(pane(portrait, 1.2), pane(over_time, 1)))
            return
        loop = self._loops("Friction force against displacement", place, "friction force (N)", "force")
        if not self._driven:
            loop.line(
                "displacement", "force", source=self._measured, color=GREY, line_width=3, alpha=0.6, level="underlay"
            )
        force = self._over_time("friction force (N)", "force", PURPLE)
        self.view = column(row(pane(portrait), pane(loop), flex=1.5), row(pane(over_time), pane(force)))

    def draw(self, found: Redraw, window: tuple[float, float], record: Record) -> None:
        """Shows the record at other numbers; the stretch enlarged, in s, stands out."""
        inside, sign = found.inside, -1.0 if self._driven else 1.0
        place, speed = (sign * inside.relative, sign * inside.relative_velocity)
        if not self._contact:
            place, speed = inside.platform, inside.platform_velocity
        data = {
            "displacement": MICROMETRES * place,
            "velocity": MILLIMETRES * speed,
            "force": inside.friction,
            "time": MILLISECONDS * found.instants,
        }
        near = (found.instants >= window[0]) & (found.instants <= window[1])
        self._whole.data = data
        self._near.data = {name: values[near] for name, values in data.items()}
        if record.motion is not None:
            self._measured.data = {
                "displacement": MICROMETRES * record.motion,
                "force": record.measured - found.score.offset,
            }

    def _loops(self, title: str, x: str, y: str, name: str) -> Model:
        made = plain_figure(x, y, title=f"{title}, within the stretch enlarged")
        if not self._driven:
            made.line("displacement", name, source=self._whole, color="#c4c4c4", line_width=1)
        made.line("displacement", name, source=self._near, color=VERMILION, line_width=1.4)
        return made

    def _over_time(self, label: str, name: str, color: str) -> Model:
        made = plain_figure("time (ms), the stretch enlarged", label)
        made.line("time", name, source=self._near, color=color, line_width=1.3)
        return made
