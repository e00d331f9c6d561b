"""Metrics of arrays of samples: cycles, strokes, efficiencies, noise, and the match of a prediction.

Works on arrays, never on files.  Imports only `core`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
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
    from .coloured_noise import (
        NoiseInTime as NoiseInTime,
        StationaryNoise as StationaryNoise,
        fit_noise as fit_noise,
        grid_positions as grid_positions,
        noise_in_time as noise_in_time,
        sample_autocovariance as sample_autocovariance,
        stationary_noise as stationary_noise,
        toeplitz_product as toeplitz_product,
        unevenness as unevenness,
    )
    from .per_cycle import (
        FLANK as FLANK,
        CycleDrift as CycleDrift,
        CycleMetrics as CycleMetrics,
        cycle_metrics as cycle_metrics,
        drift_per_cycle as drift_per_cycle,
        force_metrics as force_metrics,
        turning_points as turning_points,
    )
    from .record_guess import (
        RUNNING as RUNNING,
        RecordGuess as RecordGuess,
        gain_of as gain_of,
        goes_against as goes_against,
        guess_record as guess_record,
        rides_against as rides_against,
    )
    from .residuals import (
        CycleSplit as CycleSplit,
        LackOfFit as LackOfFit,
        ResidualSplit as ResidualSplit,
        SlipDelay as SlipDelay,
        error_index as error_index,
        lack_of_fit as lack_of_fit,
        outliers as outliers,
        r_squared as r_squared,
        rmse as rmse,
        slip_delay as slip_delay,
        split_by_phase as split_by_phase,
        split_residuals as split_residuals,
    )
    from .sample_filters import (
        decimated as decimated,
        integrated as integrated,
        smoothed as smoothed,
        velocity_zero as velocity_zero,
    )
    from .sensor_samples import (
        clipped_counts as clipped_counts,
        counts_without_noise as counts_without_noise,
        describe_hold as describe_hold,
        flicker_of as flicker_of,
        fresh_samples as fresh_samples,
        hold_length as hold_length,
        neighbour_scatter as neighbour_scatter,
        resolution_of as resolution_of,
        rounding_of_counts as rounding_of_counts,
        scatter_floor as scatter_floor,
    )
    from .sharpened_flanks import Timing as Timing
    from .waveform_detection import detect_waveform as detect_waveform, rounding_of as rounding_of
    from .waveform_fits import Waveform as Waveform
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
