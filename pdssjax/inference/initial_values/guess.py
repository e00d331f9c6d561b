"""A guess of a study's parameters from its records, for what has no number yet."""

import numpy as np

from ...core import InputError, check_kind, require_float64
from ...study import Study
from .search import rank_starts


def initial_guess(study: Study) -> dict[str, float]:
    """A number [SI] for every listed parameter: its value, its start, or else a guess from the records.

    The piezo's come from its step responses (thesis, appendix 1) or slow flanks; what then is
    unknown is searched for by trying plausible points against the records, which takes some
    seconds.  A guess is where a fit may begin, not an estimate: expect factors, not percents.

    **Raises:** `InputError` where a guess is needed from records that are still to be made, and where JAX works in
    single precision.
    """
    require_float64("initial_guess")
    check_kind("study", study, Study, "load_study")
    missing = study.missing()
    unmade = [record.name for record in study.records if not np.any(record.measured)]
    if missing and unmade:
        raise InputError(
            f"{study.path or study.title}: parameters: found no number for {', '.join(missing)}; expected one for "
            f'each, since the record "{unmade[0]}" is still to be made and has no data to guess from.'
        )
    return rank_starts(study.models, study.parameters, study.records)[0]
