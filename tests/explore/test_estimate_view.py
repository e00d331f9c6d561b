"""What the page shows of an estimate."""

import dataclasses
import json

import fabricated
import numpy as np

from pdssjax.explore.estimate_view import estimate_view, values_of
from pdssjax.files import estimate_text


def document(**changes) -> dict:
    """A made-up estimate as estimate.json holds it."""
    return json.loads(estimate_text(dataclasses.replace(fabricated.estimate(), **changes)))


def test_values_stand_in_the_unit_shown_with_digits_that_their_errors_allow():
    rows = {row.path: row for row in estimate_view(document()).rows}
    gain = rows["piezo.gain"]
    assert (gain.unit, gain.value, gain.error) == ("µm/V", "0.1007020", "0.0000070 (0.00695 %)")
    assert gain.interval == "0.1006880 to 0.1007160"
    assert rows["effector.mass"][1:] == ("g", "86", "", "", "", "fixed")
    assert rows["effector.load"].note == "no information"
    assert rows["drive.fall_time"].note == "at a bound"


def test_numbers_are_taken_in_si():
    assert values_of(document())["piezo.gain"] == 1.00702e-7


def test_the_headline_says_whether_it_converged():
    assert "converged; chi-square a degree of freedom 0.9987" in estimate_view(document()).headline
    assert "NOT CONVERGED" in estimate_view(document(converged=False)).headline
    assert "BUT DOES NOT EXPLAIN ITS RECORDS" in estimate_view({**document(), "explained": False}).headline


def test_correlations_profiles_and_advice_are_shown_where_there_are_any():
    plain = estimate_view(document())
    assert (plain.profiles, plain.advice) == ([], "")
    made = fabricated.estimate()
    assert np.array_equal(plain.correlation, made.correlation, equal_nan=True)
    assert plain.names == list(made.names)
    full = estimate_view(document(profiles=fabricated.profiles(made.parameters)))
    curve = full.profiles[0]
    assert (curve.path, curve.unit, curve.verdict) == ("piezo.gain", "µm/V", "bounded")
    assert abs(curve.estimate - 0.100702) < 1e-12
    assert curve.excess.shape == curve.value.shape == (25,)
    advised = json.loads(estimate_text(fabricated.with_errors(made)))
    assert estimate_view(advised).advice.startswith("Errors to believe: with-misfit. Believe")
