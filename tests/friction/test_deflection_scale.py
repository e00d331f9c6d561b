"""A deflection counts for more where the contact yields at next to nothing."""

import pytest

from pdssjax.core import member, members, quantities
from pdssjax.friction.base import deflection_scale

WITHOUT = {"coulomb", "stribeck"}
"""Nothing of them deflects."""
LAWS = sorted(set(members("friction")) - WITHOUT)
_FORCES = ("f_", "strength", "epsilon")
"""What the fields begin with to which the deflection at which a law yields is proportional."""


def weakened(law, by):
    kind = member("friction", law)
    return kind(**{f: by * q.nominal for f, q in quantities(kind).items() if f.startswith(_FORCES)})


def test_what_yields_at_a_tenth_of_a_micrometre_or_more_counts_as_it_is():
    assert [float(deflection_scale(yielding)) for yielding in (1e-6, 1e-7, 1e-9)] == [1.0, 1.0, pytest.approx(100.0)]


@pytest.mark.parametrize("law", LAWS)
def test_every_deflection_of_every_law_counts_by_where_it_yields(law):
    usual, weak, weaker = ([float(x) for x in weakened(law, by).error_scale()] for by in (10.0, 1e-3, 1e-4))
    deflections = [i for i, (a, b) in enumerate(zip(weak, weaker, strict=True)) if a != b]
    assert deflections and usual == [1.0] * len(usual)
    assert all(weaker[i] == pytest.approx(10.0 * weak[i]) and weak[i] > 10.0 for i in deflections)


@pytest.mark.parametrize("law", sorted(WITHOUT))
def test_a_law_without_deflection_has_nothing_to_count(law):
    assert all(float(x) == 1.0 for x in weakened(law, 1e-6).error_scale())
