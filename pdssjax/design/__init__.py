"""Optimal design of experiments: the next records, drives and samples, within the limits of rig and recorder.

Imports `selection` and the rooms below it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .criteria import CRITERIA as CRITERIA
    from .experiments import Experiment as Experiment, Limits as Limits, Resources as Resources
    from .information import Noise as Noise, record_information as record_information
    from .plan import (
        FORMAT as FORMAT,
        Knowledge as Knowledge,
        Plan as Plan,
        PlannedRecord as PlannedRecord,
        knowledge_of as knowledge_of,
        misfit_by_kind as misfit_by_kind,
    )
    from .planning import Aim as Aim, design_experiment as design_experiment
    from .rehearsal import Rehearsal as Rehearsal, rehearse as rehearse
    from .rival import fitted_rival as fitted_rival, with_law as with_law
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
