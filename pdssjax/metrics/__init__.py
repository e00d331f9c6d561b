"""What arrays of samples say: cycles, strokes, efficiencies, and how well a prediction matches.

Works on arrays, never on files.  Imports only `core`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .autocovariance import StationaryNoise as StationaryNoise
    from .autocovariance import grid_positions as grid_positions
    from .autocovariance import sample_autocovariance as sample_autocovariance
    from .autocovariance import stationary_noise as stationary_noise
    from .autocovariance import stationary_times as stationary_times
    from .chain_convergence import effective_size as effective_size
    from .chain_convergence import effective_size_of_tails as effective_size_of_tails
    from .chain_convergence import rhat as rhat
    from .channel_summary import ChannelSummary as ChannelSummary
    from .characterisation import SI_UNITS as SI_UNITS
    from .characterisation import Characterisation as Characterisation
    from .characterisation import Summary as Summary
    from .characterisation import characterisation_of as characterisation_of
    from .clipped_samples import clipped as clipped
    from .cycle_drift import CycleDrift as CycleDrift
    from .cycle_drift import drift_per_cycle as drift_per_cycle
    from .decimation import decimated as decimated
    from .flank_rounding import rounding_of as rounding_of
    from .flank_timing import Timing as Timing
    from .goodness_of_fit import error_index as error_index
    from .goodness_of_fit import r_squared as r_squared
    from .goodness_of_fit import rmse as rmse
    from .held_output import fresh_samples as fresh_samples
    from .held_output import held_for as held_for
    from .held_output import held_in_words as held_in_words
    from .integrated_velocity import integrated as integrated
    from .integrated_velocity import rest_of as rest_of
    from .motion_against_voltage import goes_against as goes_against
    from .motion_against_voltage import rides_against as rides_against
    from .noise_at_times import NoiseInTime as NoiseInTime
    from .noise_at_times import noise_at as noise_at
    from .noise_at_times import noise_in_time as noise_in_time
    from .outlying_samples import outliers as outliers
    from .per_cycle import FLANK as FLANK
    from .per_cycle import CycleMetrics as CycleMetrics
    from .per_cycle import cycle_metrics as cycle_metrics
    from .per_cycle import force_metrics as force_metrics
    from .per_cycle import turning_points as turning_points
    from .pure_error import CycleSplit as CycleSplit
    from .pure_error import LackOfFit as LackOfFit
    from .pure_error import lack_of_fit as lack_of_fit
    from .pure_error import split_by_phase as split_by_phase
    from .record_guess import RUNNING as RUNNING
    from .record_guess import RecordGuess as RecordGuess
    from .record_guess import gain_of as gain_of
    from .record_guess import guess_record as guess_record
    from .residual_split import ResidualSplit as ResidualSplit
    from .residual_split import split_residuals as split_residuals
    from .sample_noise import flicker_of as flicker_of
    from .sample_noise import neighbour_scatter as neighbour_scatter
    from .sample_noise import scatter_floor as scatter_floor
    from .sensor_resolution import counts_without_noise as counts_without_noise
    from .sensor_resolution import resolution_of as resolution_of
    from .sensor_resolution import rounding_of_counts as rounding_of_counts
    from .slip_timing import SlipDelay as SlipDelay
    from .slip_timing import slip_delay as slip_delay
    from .smoothing import smoothed as smoothed
    from .waveform import Waveform as Waveform
    from .waveform_detection import detect_waveform as detect_waveform
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "autocovariance": [
                "StationaryNoise",
                "grid_positions",
                "sample_autocovariance",
                "stationary_noise",
                "stationary_times",
            ],
            "channel_summary": ["ChannelSummary"],
            "chain_convergence": ["effective_size", "effective_size_of_tails", "rhat"],
            "characterisation": ["Characterisation", "SI_UNITS", "Summary", "characterisation_of"],
            "cycle_drift": ["CycleDrift", "drift_per_cycle"],
            "decimation": ["decimated"],
            "flank_rounding": ["rounding_of"],
            "flank_timing": ["Timing"],
            "goodness_of_fit": ["error_index", "r_squared", "rmse"],
            "held_output": ["fresh_samples", "held_for", "held_in_words"],
            "integrated_velocity": ["integrated", "rest_of"],
            "motion_against_voltage": ["goes_against", "rides_against"],
            "noise_at_times": ["NoiseInTime", "noise_at", "noise_in_time"],
            "outlying_samples": ["outliers"],
            "pure_error": ["CycleSplit", "LackOfFit", "lack_of_fit", "split_by_phase"],
            "clipped_samples": ["clipped"],
            "record_guess": ["RUNNING", "RecordGuess", "gain_of", "guess_record"],
            "residual_split": ["ResidualSplit", "split_residuals"],
            "sample_noise": ["flicker_of", "neighbour_scatter", "scatter_floor"],
            "sensor_resolution": ["counts_without_noise", "resolution_of", "rounding_of_counts"],
            "slip_timing": ["SlipDelay", "slip_delay"],
            "smoothing": ["smoothed"],
            "waveform_detection": ["detect_waveform"],
            "waveform": ["Waveform"],
            "per_cycle": ["FLANK", "CycleMetrics", "cycle_metrics", "force_metrics", "turning_points"],
        },
    )
