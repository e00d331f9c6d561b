"""The page of `pdssjax explore`, on which the user changes the numbers of a study and sees the effect at once.

This room computes the contents without a browser: the numbers and their sliders (`settings`), the record predicted at
these numbers (`live_record`), fits and sweeps in threads.  `widgets` has the page itself, the only home of Panel and
Bokeh.  Imports `files` and the rooms below it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .live_record import initial_stretch as initial_stretch, instants_of as instants_of
    from .settings import settings_of as settings_of
    from .widgets.server import serve as serve
    from .workbench import Workbench as Workbench
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
