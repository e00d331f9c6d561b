"""Which model the records support: candidates fitted to the same records, judged by what no fit has seen.

Imports `inference` and the rooms below it.
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .candidate_fits import CandidateStore as CandidateStore
    from .candidates import Candidate as Candidate, candidates_of as candidates_of, starting_near as starting_near
    from .comparing import EFFORT as EFFORT, compare_models as compare_models
    from .comparison import (
        Comparison as Comparison,
        Difference as Difference,
        DiscriminatingRecord as DiscriminatingRecord,
        FittedCandidate as FittedCandidate,
        Misfit as Misfit,
        RecordNoise as RecordNoise,
        Result as Result,
    )
else:
    from ..core.lazy import lazy_exports

    __getattr__, __dir__, __all__ = lazy_exports(__name__)
