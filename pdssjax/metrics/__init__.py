"""What arrays of samples say: cycles, strokes, efficiencies, and how well a prediction matches.

Works on arrays, never on files.  Imports only `core`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .autocovariance import (
        StationaryNoise as StationaryNoise,
        grid_positions as grid_positions,
        sample_autocovariance as sample_autocovariance,
        stationary_noise as stationary_noise,
        stationary_times as stationary_times,
    )
    from .chain_convergence import (
        effective_size as effective_size,
        effective_size_of_tails as effective_size_of_tails,
        rhat as rhat,
    )
    from .channel_summary import ChannelSummary as ChannelSummary
    from .characterisation import (
        SI_UNITS as SI_UNITS,
        Characterisation as Characterisation,
        Summary as Summary,
        characterisation_of as characterisation_of,
    )
    from .clipped_samples import clipped as clipped
    from .cycle_drift import CycleDrift as CycleDrift, drift_per_cycle as drift_per_cycle
    from .decimation import decimated as decimated
    from .flank_rounding import rounding_of as rounding_of
    from .flank_timing import Timing as Timing
    from .goodness_of_fit import error_index as error_index, r_squared as r_squared, rmse as rmse
    from .held_output import fresh_samples as fresh_samples, held_for as held_for, held_in_words as held_in_words
    from .integrated_velocity import integrated as integrated, rest_of as rest_of
    from .motion_against_voltage import goes_against as goes_against, rides_against as rides_against
    from .noise_at_times import NoiseInTime as NoiseInTime, noise_at as noise_at, noise_in_time as noise_in_time
    from .outlying_samples import outliers as outliers
    from .per_cycle import (
        FLANK as FLANK,
        CycleMetrics as CycleMetrics,
        cycle_metrics as cycle_metrics,
        force_metrics as force_metrics,
        turning_points as turning_points,
    )
    from .pure_error import (
        CycleSplit as CycleSplit,
        LackOfFit as LackOfFit,
        lack_of_fit as lack_of_fit,
        split_by_phase as split_by_phase,
    )
    from .record_guess import (
        RUNNING as RUNNING,
        RecordGuess as RecordGuess,
        gain_of as gain_of,
        guess_record as guess_record,
    )
    from .residual_split import ResidualSplit as ResidualSplit, split_residuals as split_residuals
    from .sample_noise import (
        flicker_of as flicker_of,
        neighbour_scatter as neighbour_scatter,
        scatter_floor as scatter_floor,
    )
    from .sensor_resolution import (
        counts_without_noise as counts_without_noise,
        resolution_of as resolution_of,
        rounding_of_counts as rounding_of_counts,
    )
    from .slip_timing import SlipDelay as SlipDelay, slip_delay as slip_delay
    from .smoothing import smoothed as smoothed
    from .waveform import Waveform as Waveform
    from .waveform_detection import detect_waveform as detect_waveform
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
