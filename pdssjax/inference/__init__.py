"""From records to numbers: starts, residuals, least squares, covariance, and the verdict on a fit.

Imports `study` and the rooms below it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .covariance import least_squares_covariance as least_squares_covariance
    from .covariance import propagated as propagated
    from .draws import Drawing as Drawing
    from .draws import Store as Store
    from .identification import FitInterrupted as FitInterrupted
    from .identification import Intervals as Intervals
    from .identification import check_intervals as check_intervals
    from .identification import check_method as check_method
    from .identification import has_intervals as has_intervals
    from .identification import identify as identify
    from .initial_values.guess import initial_guess as initial_guess
    from .initial_values.search import guess_starts as guess_starts
    from .least_squares import Fit as Fit
    from .least_squares import Method as Method
    from .least_squares import fit_phase as fit_phase
    from .least_squares import joint as joint
    from .parameter_transform import transform_of as transform_of
    from .poor_fit import repeats as repeats
    from .problem import Problem as Problem
    from .problem import pose_problem as pose_problem
    from .residual import Residual as Residual
    from .residual import as_weights as as_weights
    from .solver.ending import SUCCESSES as SUCCESSES
    from .solver.ending import Ending as Ending
    from .solver.iterations import iterates as iterates
    from .solver.levenberg_marquardt import BoundedLevenbergMarquardt as BoundedLevenbergMarquardt
    from .stack_first.peak_picking import PickedStack as PickedStack
    from .stack_first.peak_picking import pick_peaks as pick_peaks
    from .stack_first.sequential import sequential as sequential
    from .stack_first.sequential import with_piezo_held as with_piezo_held
    from .uncertainty.influence import curvature_of as curvature_of
    from .uncertainty.influence import influence_of as influence_of
    from .uncertainty.influence import principal_directions as principal_directions
    from .uncertainty.parameter_errors import all_error_models as all_error_models
    from .uncertainty.parameter_errors import with_error_models as with_error_models
    from .uncertainty.students_t import NORMAL_95 as NORMAL_95
    from .uncertainty.students_t import half_width_95 as half_width_95
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "covariance": ["least_squares_covariance", "propagated"],
            "draws": ["Drawing", "Store"],
            "solver.ending": ["Ending", "SUCCESSES"],
            "identification": [
                "FitInterrupted",
                "Intervals",
                "check_intervals",
                "check_method",
                "has_intervals",
                "identify",
            ],
            "uncertainty.influence": ["curvature_of", "influence_of", "principal_directions"],
            "initial_values.guess": ["initial_guess"],
            "initial_values.search": ["guess_starts"],
            "solver.iterations": ["iterates"],
            "least_squares": ["Fit", "Method", "fit_phase", "joint"],
            "solver.levenberg_marquardt": ["BoundedLevenbergMarquardt"],
            "uncertainty.parameter_errors": ["all_error_models", "with_error_models"],
            "parameter_transform": ["transform_of"],
            "stack_first.peak_picking": ["PickedStack", "pick_peaks"],
            "stack_first.sequential": ["sequential", "with_piezo_held"],
            "poor_fit": ["repeats"],
            "problem": ["Problem", "pose_problem"],
            "residual": ["Residual", "as_weights"],
            "uncertainty.students_t": ["NORMAL_95", "half_width_95"],
        },
    )
