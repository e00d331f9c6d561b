"""What is known and what was measured: models, parameters, records, and the prediction of records.

Describes and predicts, and never searches.  Imports `metrics`, `simulation` and the rooms below them.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .catalogue import Entry as Entry
    from .catalogue import catalogue_entries as catalogue_entries
    from .catalogue import find_entry as find_entry
    from .comparison import FittedRecord as FittedRecord
    from .comparison import compare as compare
    from .comparison import cycles_a_second as cycles_a_second
    from .comparison import repeated_residuals as repeated_residuals
    from .conditions import MARK as MARK
    from .conditions import paths_in as paths_in
    from .conditions import split_path as split_path
    from .conditions import under_conditions as under_conditions
    from .diagnosis import Agreement as Agreement
    from .diagnosis import Combination as Combination
    from .diagnosis import Diagnosis as Diagnosis
    from .diagnosis import Remedy as Remedy
    from .draws import Draws as Draws
    from .draws import ParameterDraws as ParameterDraws
    from .estimate import UNSEEN as UNSEEN
    from .estimate import Amplification as Amplification
    from .estimate import ErrorAdvice as ErrorAdvice
    from .estimate import Estimate as Estimate
    from .estimate import FittedParameter as FittedParameter
    from .estimate import MeasuredApart as MeasuredApart
    from .estimate import ParameterError as ParameterError
    from .estimate import Statistics as Statistics
    from .measurement.base import MOVING as MOVING
    from .measurement.base import AbstractMeasurement as AbstractMeasurement
    from .measurement.base import Samples as Samples
    from .models import Models as Models
    from .models import Values as Values
    from .multistart import Multistart as Multistart
    from .parameter import REACH as REACH
    from .parameter import Parameter as Parameter
    from .parameter_use import MASS_UNUSED as MASS_UNUSED
    from .parameter_use import check_whole_parts as check_whole_parts
    from .parameter_use import unused_by as unused_by
    from .parameter_use import without_effect as without_effect
    from .prediction import AbstractSetup as AbstractSetup
    from .prediction import Lowered as Lowered
    from .prediction import Predictor as Predictor
    from .prediction import failures as failures
    from .prediction import predicted as predicted
    from .prediction import with_room as with_room
    from .profile import Profile as Profile
    from .record import Record as Record
    from .record_groups import Run as Run
    from .resonances import SHOWN as SHOWN
    from .resonances import Resonance as Resonance
    from .resonances import depends_on as depends_on
    from .resonances import hidden_from as hidden_from
    from .sample_times import STEP_TIME as STEP_TIME
    from .sample_times import check_begins_early as check_begins_early
    from .sample_times import check_increasing as check_increasing
    from .sample_times import check_meets_drive as check_meets_drive
    from .shared_drive import drive_with as drive_with
    from .shared_drive import shared_fields as shared_fields
    from .simulation_failure import failure_cause as failure_cause
    from .study import Study as Study
    from .study import legal_quantities as legal_quantities
    from .summaries import entry_summaries as entry_summaries
    from .used_numbers import UsedNumber as UsedNumber
    from .used_numbers import numbers_used as numbers_used
    from .virtual_rig import Recording as Recording
    from .virtual_rig import make_recordings as make_recordings
    from .virtual_rig import truth as truth
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(
        __name__,
        {
            "catalogue": ["Entry", "catalogue_entries", "find_entry"],
            "comparison": ["FittedRecord", "compare", "cycles_a_second", "repeated_residuals"],
            "conditions": ["MARK", "paths_in", "split_path", "under_conditions"],
            "diagnosis": ["Combination", "Diagnosis", "Agreement", "Remedy"],
            "estimate": [
                "UNSEEN",
                "Amplification",
                "ErrorAdvice",
                "Estimate",
                "FittedParameter",
                "MeasuredApart",
                "ParameterError",
                "Statistics",
            ],
            "measurement.base": ["AbstractMeasurement", "MOVING", "Samples"],
            "models": ["Models", "Values"],
            "multistart": ["Multistart"],
            "summaries": ["entry_summaries"],
            "used_numbers": ["UsedNumber", "numbers_used"],
            "parameter": ["Parameter", "REACH"],
            "parameter_use": ["MASS_UNUSED", "check_whole_parts", "unused_by", "without_effect"],
            "prediction": ["AbstractSetup", "Lowered", "Predictor", "failures", "predicted", "with_room"],
            "profile": ["Profile"],
            "record": ["Record"],
            "record_groups": ["Run"],
            "resonances": ["Resonance", "SHOWN", "depends_on", "hidden_from"],
            "sample_times": ["STEP_TIME", "check_begins_early", "check_increasing", "check_meets_drive"],
            "simulation_failure": ["failure_cause"],
            "draws": ["Draws", "ParameterDraws"],
            "shared_drive": ["drive_with", "shared_fields"],
            "study": ["Study", "legal_quantities"],
            "virtual_rig": ["Recording", "make_recordings", "truth"],
        },
    )
