"""Many simulations over a set of points, side by side, as one dataset.

Imports `study` and the rooms below it.  Not called `sweep`: that is the function `pdssjax.sweep`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .blocks import (
        GRAZING as GRAZING,
        LANES as LANES,
        POINT_FAILURES as POINT_FAILURES,
        AbstractBlockStore as AbstractBlockStore,
        BlockPlan as BlockPlan,
        MemoryStore as MemoryStore,
        count_columns as count_columns,
        empty_results as empty_results,
        extend_plan as extend_plan,
    )
    from .border import DEAD as DEAD, find_border as find_border
    from .cycles import METRICS as METRICS
    from .dataset import (
        ALONG as ALONG,
        compared_directions as compared_directions,
        register_plot as register_plot,
        with_bands as with_bands,
    )
    from .execution import cluster_executor as cluster_executor, differences as differences, job_text as job_text
    from .further_metrics import FURTHER as FURTHER, SMOOTH as SMOOTH
    from .points import (
        AbstractPoints as AbstractPoints,
        CovarianceDraws as CovarianceDraws,
        Crossed as Crossed,
        GivenDraws as GivenDraws,
        Grid as Grid,
        LatinHypercube as LatinHypercube,
        Listed as Listed,
        SigmaPoints as SigmaPoints,
        Sobol as Sobol,
    )
    from .request_check import (
        changes_a_sweep as changes_a_sweep,
        driven_record as driven_record,
        sweepable as sweepable,
        sweepable_choices as sweepable_choices,
    )
    from .sweeping import PlannedSweep as PlannedSweep, plan_sweep as plan_sweep, sweep as sweep
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
