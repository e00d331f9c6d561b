"""Samples that a study would fit twice: a file under two names, a record listed twice, windows that overlap.

Counted twice, the same errors pass for two measurements, and standard errors come out too small, by up to the root of
two.  Samples are compared, not names; two runs that only resemble each other differ in their noise.
"""

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ..core import InputError
from ..study import Record

_FEWEST = 16
"""Equal samples, all that two records have in common, from which they are the same and not so by chance."""


def check_measured_once(records: Sequence[Record], where: object) -> None:
    """**Raises** `InputError`, which begins with `where`, for the first two of the `records` that share samples.

    Only what is fitted counts, and only records of the same quantity are compared.
    """
    fitted = [record for record in records if record.role == "fit"]
    for earlier, later in itertools.combinations(fitted, 2):
        if earlier.measurement == later.measurement and (shared := _shared(earlier, later)):
            raise InputError(
                f'{where}: record "{later.name}" ({later.file}): found {shared} of its {later.time.size} samples in '
                f'record "{earlier.name}" ({earlier.file}), too, expected every sample once. Fitted twice they would '
                "pass for new measurements, and the errors be too small: leave one record out, or give it role = "
                '"validate" or another window.'
            )


def _shared(earlier: Record, later: Record) -> int:
    """How many samples two records have in common; 0 where they differ in any that could be."""
    if earlier.time.size == later.time.size and np.array_equal(earlier.measured, later.measured):
        # Also where the clock of a copy was set anew.
        return _informative(earlier.measured)
    # On the clocks of the files, each up to a rounding.
    interval = float(np.median(np.diff(earlier.time))) if earlier.time.size > 1 else 1.0
    first, second = (np.round((r.time + r.start) / (1e-3 * interval)) for r in (earlier, later))
    _, here, there = np.intersect1d(first, second, return_indices=True)
    same = here.size and np.array_equal(earlier.measured[here], later.measured[there])
    return _informative(earlier.measured[here]) if same else 0


def _informative(values: Float[np.ndarray, " n"]) -> int:
    """How many samples there are; 0 of few, and of those that show nothing but rest."""
    return values.size if values.size >= _FEWEST and np.ptp(values) > 0 else 0
