"""Results as figures, one kind of result a file.  The one home of matplotlib.

Imports results from the rooms below, never files.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .amplification import amplification_figure as amplification_figure
    from .border import border_figure as border_figure
    from .comparison import comparison_figure as comparison_figure
    from .correlations import correlation_figure as correlation_figure
    from .cycles import cycle_figure as cycle_figure
    from .directions import directions_figure as directions_figure
    from .draws import draws_figure as draws_figure
    from .friction_loops import friction_figure as friction_figure
    from .loops import has_loops as has_loops, loop_figure as loop_figure
    from .multistart import multistart_figure as multistart_figure
    from .overview import estimate_figure as estimate_figure, study_figure as study_figure
    from .profiles import profile_figure as profile_figure
    from .record_guess import guess_figure as guess_figure
    from .records import record_figure as record_figure
    from .residual_split import residual_split_figure as residual_split_figure
    from .standard_errors import error_figure as error_figure
    from .sweep import sweep_figure as sweep_figure
    from .trajectory import trajectory_figure as trajectory_figure
else:
    from ...core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
