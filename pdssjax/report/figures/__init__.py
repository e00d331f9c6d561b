"""Results as figures, one kind of result a file.  The one home of matplotlib.

Imports results from the rooms below, never files.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._style import save_figure as save_figure
    from .estimate import (
        amplification_figure as amplification_figure,
        comparison_figure as comparison_figure,
        correlation_figure as correlation_figure,
        error_figure as error_figure,
        parameter_figures as parameter_figures,
    )
    from .intervals import (
        draws_figure as draws_figure,
        multistart_figure as multistart_figure,
        profile_figure as profile_figure,
    )
    from .plan import design_figure as design_figure
    from .recordings import (
        cycle_figure as cycle_figure,
        friction_figure as friction_figure,
        guess_figure as guess_figure,
        trajectory_figure as trajectory_figure,
    )
    from .records import (
        estimate_figure as estimate_figure,
        has_loops as has_loops,
        loop_figure as loop_figure,
        record_figure as record_figure,
        residual_split_figure as residual_split_figure,
        study_figure as study_figure,
    )
    from .selection import residual_strips_figure as residual_strips_figure, selection_figure as selection_figure
    from .sweep import (
        border_figure as border_figure,
        directions_figure as directions_figure,
        sweep_figure as sweep_figure,
    )
else:
    from ...core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
