"""Many simulations over a set of points, side by side, as one dataset.

Imports `study` and the rooms below it.  Not called `sweep`: that is the function `pdssjax.sweep`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .axes import changes_a_sweep as changes_a_sweep
    from .axes import sweepable as sweepable
    from .axes import sweepable_choices as sweepable_choices
    from .bands import with_bands as with_bands
    from .block_plan import LANES as LANES
    from .block_plan import BlockPlan as BlockPlan
    from .block_plan import extended as extended
    from .block_store import AbstractBlockStore as AbstractBlockStore
    from .block_store import MemoryStore as MemoryStore
    from .block_store import blank as blank
    from .block_store import columns_of as columns_of
    from .border import DEAD as DEAD
    from .border import find_border as find_border
    from .cluster import cluster_executor as cluster_executor
    from .cycles.base import METRICS as METRICS
    from .cycles.further_metrics import FURTHER as FURTHER
    from .cycles.further_metrics import SMOOTH as SMOOTH
    from .dataset import register_plot as register_plot
    from .directions import ALONG as ALONG
    from .directions import compared_directions as compared_directions
    from .job import differences as differences
    from .job import job_text as job_text
    from .point_status import GRAZING as GRAZING
    from .point_status import POINT_FAILURES as POINT_FAILURES
    from .points.base import AbstractPoints as AbstractPoints
    from .points.covariance_draws import CovarianceDraws as CovarianceDraws
    from .points.crossed import Crossed as Crossed
    from .points.given_draws import GivenDraws as GivenDraws
    from .points.grid import Grid as Grid
    from .points.latin_hypercube import LatinHypercube as LatinHypercube
    from .points.listed import Listed as Listed
    from .points.sigma_points import SigmaPoints as SigmaPoints
    from .points.sobol import Sobol as Sobol
    from .sweeping import PlannedSweep as PlannedSweep
    from .sweeping import plan_sweep as plan_sweep
    from .sweeping import sweep as sweep
    from .varied_record import driven_record as driven_record
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "axes": ["changes_a_sweep", "sweepable", "sweepable_choices"],
            "bands": ["with_bands"],
            "block_plan": ["BlockPlan", "LANES", "extended"],
            "block_store": ["AbstractBlockStore", "MemoryStore", "blank", "columns_of"],
            "border": ["DEAD", "find_border"],
            "cluster": ["cluster_executor"],
            "varied_record": ["driven_record"],
            "cycles.base": ["METRICS"],
            "directions": ["ALONG", "compared_directions"],
            "cycles.further_metrics": ["FURTHER", "SMOOTH"],
            "dataset": ["register_plot"],
            "job": ["differences", "job_text"],
            "point_status": ["GRAZING", "POINT_FAILURES"],
            "points.base": ["AbstractPoints"],
            "points.covariance_draws": ["CovarianceDraws"],
            "points.crossed": ["Crossed"],
            "points.given_draws": ["GivenDraws"],
            "points.grid": ["Grid"],
            "points.latin_hypercube": ["LatinHypercube"],
            "points.listed": ["Listed"],
            "points.sigma_points": ["SigmaPoints"],
            "points.sobol": ["Sobol"],
            "sweeping": ["PlannedSweep", "plan_sweep", "sweep"],
        },
    )
