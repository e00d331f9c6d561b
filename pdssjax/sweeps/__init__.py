"""Many simulations over a set of points, side by side, as one dataset.

Imports `study` and the rooms below it.  Not called `sweep`: that is the function `pdssjax.sweep`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .axes import changes_a_sweep as changes_a_sweep, sweepable as sweepable, sweepable_choices as sweepable_choices
    from .bands import with_bands as with_bands
    from .block_plan import LANES as LANES, BlockPlan as BlockPlan, extended as extended
    from .block_store import (
        AbstractBlockStore as AbstractBlockStore,
        MemoryStore as MemoryStore,
        blank as blank,
        columns_of as columns_of,
    )
    from .border import DEAD as DEAD, find_border as find_border
    from .cluster import cluster_executor as cluster_executor
    from .cycles.base import METRICS as METRICS
    from .cycles.further_metrics import FURTHER as FURTHER, SMOOTH as SMOOTH
    from .dataset import register_plot as register_plot
    from .directions import ALONG as ALONG, compared_directions as compared_directions
    from .job import differences as differences, job_text as job_text
    from .point_status import GRAZING as GRAZING, POINT_FAILURES as POINT_FAILURES
    from .points.base import AbstractPoints as AbstractPoints
    from .points.covariance_draws import CovarianceDraws as CovarianceDraws
    from .points.crossed import Crossed as Crossed
    from .points.given_draws import GivenDraws as GivenDraws
    from .points.grid import Grid as Grid
    from .points.latin_hypercube import LatinHypercube as LatinHypercube
    from .points.listed import Listed as Listed
    from .points.sigma_points import SigmaPoints as SigmaPoints
    from .points.sobol import Sobol as Sobol
    from .sweeping import PlannedSweep as PlannedSweep, plan_sweep as plan_sweep, sweep as sweep
    from .varied_record import driven_record as driven_record
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
