"""Which model the records support: candidates fitted to the same records, judged by what no fit has seen.

Imports `inference` and the rooms below it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .candidates import Candidate as Candidate, candidates_of as candidates_of
    from .comparing import EFFORT as EFFORT, CandidateStore as CandidateStore, compare_models as compare_models
    from .comparison import (
        Comparison as Comparison,
        FittedCandidate as FittedCandidate,
        Misfit as Misfit,
        RecordNoise as RecordNoise,
        Result as Result,
        TellingRecord as TellingRecord,
    )
    from .scores import Difference as Difference
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
