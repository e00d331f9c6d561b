"""The bounds of a fit's parameters are legal numbers themselves."""

import math

import pytest

from pdssjax.core import check_range, member, members, quantities
from pdssjax.study import Parameter

DECLARED = {
    f"{family}/{name}.{field}": declared
    for family in ("drive", "friction", "piezo")
    for name in members(family)
    for field, declared in quantities(member(family, name)).items()
    if math.isfinite(declared.high)
}


@pytest.mark.parametrize("path", DECLARED)
@pytest.mark.parametrize("started", [False, True])
def test_a_fit_that_ends_at_its_upper_bound_can_be_predicted(path, started):
    declared = DECLARED[path]
    start = declared.nominal if started else None
    check_range(Parameter(path, declared.unit, declared).bounds(start)[1], declared, path)
