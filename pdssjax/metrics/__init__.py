"""What arrays of samples say: cycles, strokes, efficiencies, and how well a prediction matches.

Works on arrays, never on files.  Imports only `core`.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .channel_summary import ChannelSummary as ChannelSummary
    from .characterisation import SI_UNITS as SI_UNITS
    from .characterisation import Characterisation as Characterisation
    from .characterisation import Summary as Summary
    from .characterisation import characterisation_of as characterisation_of
    from .decimation import decimated as decimated
    from .goodness_of_fit import error_index as error_index
    from .goodness_of_fit import r_squared as r_squared
    from .goodness_of_fit import rmse as rmse
    from .per_cycle import FLANK as FLANK
    from .per_cycle import cycle_metrics as cycle_metrics
    from .per_cycle import turning_points as turning_points
    from .pure_error import LackOfFit as LackOfFit
    from .pure_error import lack_of_fit as lack_of_fit
    from .record_guess import RecordGuess as RecordGuess
    from .record_guess import guess_record as guess_record
    from .scatter import resolution_of as resolution_of
    from .scatter import scatter_floor as scatter_floor
    from .waveform_detection import Waveform as Waveform
    from .waveform_detection import detect_waveform as detect_waveform
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "channel_summary": ["ChannelSummary"],
            "characterisation": ["Characterisation", "SI_UNITS", "Summary", "characterisation_of"],
            "decimation": ["decimated"],
            "goodness_of_fit": ["error_index", "r_squared", "rmse"],
            "pure_error": ["LackOfFit", "lack_of_fit"],
            "record_guess": ["RecordGuess", "guess_record"],
            "scatter": ["resolution_of", "scatter_floor"],
            "waveform_detection": ["Waveform", "detect_waveform"],
            "per_cycle": ["FLANK", "cycle_metrics", "turning_points"],
        },
    )
