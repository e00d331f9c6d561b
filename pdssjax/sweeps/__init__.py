"""Many simulations over a grid, side by side, as one dataset.

Imports `study` and the rooms below it.  Not called `sweep`: that is the function `pdssjax.sweep`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .grid import LANES as LANES
    from .grid import sweep as sweep
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "grid": ["LANES", "sweep"],
        },
    )
