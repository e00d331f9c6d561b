"""From records to numbers: starts, residuals, least squares, covariance, and the verdict on a fit.

Imports `study` and the rooms below it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .beyond_noise import leaves_white_noise as leaves_white_noise, repeats as repeats
    from .covariance import least_squares_covariance as least_squares_covariance
    from .draws import Drawing as Drawing, Store as Store
    from .effort import EFFORTS as EFFORTS, Effort as Effort, effort_of as effort_of
    from .evidence import Evidence as Evidence, zero_columns as zero_columns
    from .identification import (
        FitInterrupted as FitInterrupted,
        Intervals as Intervals,
        check_intervals as check_intervals,
        check_method as check_method,
        has_intervals as has_intervals,
        identify as identify,
    )
    from .initial_values.search import guess_starts as guess_starts, initial_guess as initial_guess
    from .kept_fit import fingerprint as fingerprint
    from .least_squares import (
        Fit as Fit,
        Method as Method,
        Progress as Progress,
        evaluated as evaluated,
        fit_phase as fit_phase,
        joint as joint,
        quiet as quiet,
    )
    from .parameter_transform import transform_of as transform_of
    from .problem import Problem as Problem, pose as pose, pose_problem as pose_problem
    from .residual import Residual as Residual, as_weights as as_weights
    from .solver.iterations import iterates as iterates
    from .solver.levenberg_marquardt import BoundedLevenbergMarquardt as BoundedLevenbergMarquardt
    from .solver.lm_state import SUCCESSES as SUCCESSES, Ending as Ending
    from .stack_first.held_stack import sequential as sequential, with_piezo_held as with_piezo_held
    from .stack_first.peak_picking import PickedStack as PickedStack, pick_peaks as pick_peaks
    from .uncertainty.influence import (
        curvature_of as curvature_of,
        influence_of as influence_of,
        principal_directions as principal_directions,
        pseudo_inverse as pseudo_inverse,
    )
    from .uncertainty.linear_intervals import NORMAL_95 as NORMAL_95, half_width_95 as half_width_95
    from .uncertainty.parameter_errors import (
        all_error_models as all_error_models,
        with_error_models as with_error_models,
    )
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
