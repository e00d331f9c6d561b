"""Studies: models, parameters, records, the prediction of records, and the estimate of a fit.

Describes and predicts, and never searches.  Imports `metrics`, `simulation` and the rooms below them.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .catalogue import Entry as Entry, catalogue_entries as catalogue_entries, find_entry as find_entry
    from .comparison import (
        FittedRecord as FittedRecord,
        compare as compare,
        cycles_a_second as cycles_a_second,
        repeated_residuals as repeated_residuals,
    )
    from .constraint import (
        Constraint as Constraint,
        Link as Link,
        bounded_by_constraints as bounded_by_constraints,
        chained as chained,
    )
    from .estimate import (
        NEGLIGIBLE_AMPLIFICATION as NEGLIGIBLE_AMPLIFICATION,
        OWN_MINIMISER as OWN_MINIMISER,
        Amplification as Amplification,
        ErrorAdvice as ErrorAdvice,
        Estimate as Estimate,
        FittedParameter as FittedParameter,
        MeasuredApart as MeasuredApart,
        ParameterError as ParameterError,
        Provenance as Provenance,
        Statistics as Statistics,
        Unexplained as Unexplained,
    )
    from .findings import (
        VISIBLE as VISIBLE,
        Agreement as Agreement,
        Combination as Combination,
        Diagnosis as Diagnosis,
        Draws as Draws,
        IntegratorCheck as IntegratorCheck,
        Multistart as Multistart,
        ParameterDraws as ParameterDraws,
        Profile as Profile,
        Remedy as Remedy,
    )
    from .measurement.base import MOVING as MOVING, AbstractMeasurement as AbstractMeasurement, Samples as Samples
    from .models import Models as Models, Values as Values
    from .parameter import (
        MARK as MARK,
        REACH as REACH,
        Parameter as Parameter,
        paths_in as paths_in,
        split_path as split_path,
        under_conditions as under_conditions,
    )
    from .parameter_use import (
        MASS_UNUSED as MASS_UNUSED,
        check_whole_parts as check_whole_parts,
        unused_by as unused_by,
        without_effect as without_effect,
    )
    from .prediction import Predictor as Predictor, failures as failures, predicted as predicted
    from .record import Record as Record, drive_with as drive_with, shared_fields as shared_fields
    from .resonances import SHOWN as SHOWN, Resonance as Resonance, depends_on as depends_on, hidden_from as hidden_from
    from .sample_times import (
        STEP_TIME as STEP_TIME,
        check_begins_early as check_begins_early,
        check_increasing as check_increasing,
        check_meets_drive as check_meets_drive,
    )
    from .setups import AbstractSetup as AbstractSetup, Run as Run, with_room as with_room
    from .simulation_failure import failure_cause as failure_cause
    from .study import Study as Study, UsedNumber as UsedNumber, numbers_used as numbers_used
    from .summaries import entry_summaries as entry_summaries
    from .virtual_rig import Recording as Recording, make_recordings as make_recordings, truth as truth
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
