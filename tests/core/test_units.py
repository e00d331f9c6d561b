"""Numbers are SI; texts carry a unit, and only one of the right dimension passes."""

import math

import pytest

from pdssjax import InputError
from pdssjax.core import LENGTH, column_unit, factor, to_si, unit_named, units


@pytest.mark.parametrize(
    ("given", "unit", "expected"),
    [
        (3, "kg", 3.0),
        (1.007e-7, "m/V", 1.007e-7),
        ("0.1007 um/V", "m/V", 1.007e-7),
        ("86 g", "kg", 0.086),
        ("86g", "kg", 0.086),
        ("1148.4 N/mm", "N/m", 1.1484e6),
        ("54.4 N s/m", "N s/m", 54.4),
        ("54.4 N*s/m", "N s/m", 54.4),
        ("-2.5e-1 mN", "N", -2.5e-4),
        (" 50 us ", "s", 5e-5),
        ("3 µm", "m", 3e-6),
        ("0.1772", "", 0.1772),
        ("17.72 %", "", 0.1772),
        ("180 deg", "rad", math.pi),
        ("6736 rad/s", "rad/s", 6736.0),
        ("0.02 kHz", "Hz", 20.0),
    ],
)
def test_text_with_a_unit_becomes_the_si_number(given, unit, expected):
    assert to_si(given, unit, "here") == pytest.approx(expected, rel=1e-15)


def test_decimal_text_becomes_the_nearest_float():
    assert to_si("86 g", "kg", "here") == 0.086


@pytest.mark.parametrize(
    ("given", "unit", "found", "expected"),
    [
        ("86 grm", "kg", '"grm"', "kg"),
        ("86 m/", "kg", '"m/"', "kg"),
        ("86 (", "kg", '"("', "kg"),
        ("86 V", "kg", '"V"', "kg"),
        ("86", "kg", "no unit", "kg"),
        ("0.2 m", "", '"m"', "a pure number"),
        ("heavy", "kg", '"heavy"', "1 kg"),
        ("", "kg", '""', "1 kg"),
        ("kg", "kg", '"kg"', "1 kg"),
        ("0,5 kg", "kg", '"0,5 kg"', 'a decimal point: "0.5 kg"'),
        ("-1,25e-3", "", '"-1,25e-3"', 'a decimal point: "-1.25e-3"'),
        (True, "kg", "True", "1 kg"),
        ([1], "kg", "[1]", "1 kg"),
        ("nan kg", "kg", '"nan kg"', "finite"),
        ("-inf", "kg", '"-inf"', "finite"),
        (math.nan, "kg", "nan", "finite"),
        (math.inf, "kg", "inf", "finite"),
        ("1e999 kg", "kg", "1e999", "finite"),
    ],
)
def test_error_names_the_place_the_text_and_the_unit_expected(given, unit, found, expected):
    with pytest.raises(InputError) as caught:
        to_si(given, unit, "study.toml: here")
    message = str(caught.value)
    assert message.startswith("study.toml: here: found ")
    assert found in message
    assert expected in message.partition("expected")[2]


def test_hertz_and_radians_are_not_mixed_up():
    with pytest.raises(InputError, match="expected a unit that converts to Hz"):
        to_si("31.4 rad/s", "Hz", "here")
    with pytest.raises(InputError, match="expected a unit that converts to rad/s"):
        to_si("200 1/s", "rad/s", "here")
    with pytest.raises(InputError, match="expected a unit that converts to rad/s"):
        factor("Hz", "rad/s", "here")


@pytest.mark.parametrize(("given", "hertz"), [("1072 Hz", 1072.0), ("1.072 kHz", 1072.0), ("200 hertz", 200.0)])
def test_an_angular_frequency_may_be_told_in_hertz(given, hertz):
    assert to_si(given, "rad/s", "here") == pytest.approx(2 * math.pi * hertz, rel=1e-14)


def test_a_gram_is_told_from_the_standard_gravity():
    with pytest.raises(InputError, match=r'found the unit "g", a gram \(standard gravity is written "g_0"'):
        factor("g", "m/s^2", "here")
    assert factor("g_0", "m/s^2", "here") == pytest.approx(9.80665)


def test_column_name_ends_in_its_unit():
    assert [column_unit(name) for name in ("time_s", "end_effector_um", "voltage_V", "time")] == ["s", "um", "V", ""]
    assert factor("um", "m", "here") == 1e-6


def test_small_errors_are_shown_with_two_digits_and_usual_ones_with_four_places():
    assert LENGTH.decimals(1.04e-8, 1e-9) == 4
    assert LENGTH.decimals(1.04e-8, 5.2e-11) == 6
    assert LENGTH.decimals(0.0, math.nan) == 4


@pytest.mark.parametrize(
    "name",
    [
        "m**9**9**9",
        "um/V^(9**9**9)",
        "((9**99)**99)**99*m",
        "9**(99*99*99*99)",
        "9**22**11 m",
        "((9⁹⁹)⁹⁹)⁹⁹",
        "m**123456789",
        "m**(1+1)",
        pytest.param("m" * 100_000, id="long"),
        pytest.param("s*(" * 5000 + "m" + ")" * 5000, id="nested"),
    ],
)
def test_powers_that_would_not_end_are_unknown_units(name):
    with pytest.raises(InputError, match="found the unknown unit") as caught:
        factor(name, "m", "here")
    assert len(str(caught.value)) < 200
    assert unit_named(name) == ""


@pytest.mark.parametrize(
    ("name", "unit", "expected"),
    [
        ("mm**2/s**2", "m^2/s^2", 1e-6),
        ("kg*m²*s**-3", "W", 1.0),
        ("N s**(1/2)/mm**(1/2)", "N*s^0.5/m^0.5", 1000**0.5),
        ("mN^2.5", "N^2.5", 1e-3**2.5),
        ("(mm/s) ** 2", "m^2/s^2", 1e-6),
    ],
)
def test_powers_of_units_are_units(name, unit, expected):
    assert factor(name, unit, "here") == pytest.approx(expected, rel=1e-12)


GIVEN = {
    "digits": "1" * 5000,
    "blanks": "1 " + " " * 5000 + "m",
    "integer": 16**5000,
    "line": "9 m" + " " * 9999 + "\n x",
}


@pytest.mark.parametrize("kind", GIVEN)
def test_numbers_beyond_reading_are_quoted_briefly(kind):
    with pytest.raises(InputError) as caught:
        to_si(GIVEN[kind], "m", "here")
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("name", units._COMMON)
def test_common_units_are_those_of_pint(name, monkeypatch):
    unit, size = units._COMMON[name]
    monkeypatch.setattr(units, "_COMMON", {})
    assert factor(name, unit, "here") == size
