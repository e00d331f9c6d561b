"""Where sliders stand and what they reach, what can be turned, and the study with their numbers."""

import platform_study
import pytest
import study_files

from pdssjax import InputError, load_study
from pdssjax.core import Quantity
from pdssjax.explore.settings import (
    POSITIONS,
    changed_drives,
    drive_choices,
    drive_knobs,
    parameter_knobs,
    settings_of,
    slider_range,
    study_at,
    study_to_fit,
)

TEXT = study_files.changed('"piezo.natural_frequency" = {}', '"piezo.natural_frequency" = { start = "1 kHz" }')


for _name, _number in {"sigma0": 1e6, "sigma1": 45, "f_ss": 0.65}.items():
    TEXT = TEXT.replace(f'"friction.{_name}" = {{}}', f'"friction.{_name}" = {{ start = {_number} }}')


@pytest.fixture
def study(tmp_path):
    return load_study(study_files.write_study(tmp_path, TEXT))


def test_every_parameter_has_a_knob_in_the_unit_shown(study):
    knobs = {knob.path: knob for knob in parameter_knobs(study)}
    assert list(knobs) == list(study.parameters)
    gain = knobs["piezo.gain"]
    assert (gain.unit, gain.free, gain.range.low, gain.range.high) == ("µm/V", True, pytest.approx(5e-8), 2e-7)
    assert not knobs["effector.mass"].free
    assert knobs["effector.mass"].text(0.086) == "86"


def test_a_field_takes_numbers_with_and_without_a_unit(study):
    knobs = {knob.path: knob for knob in parameter_knobs(study)}
    assert knobs["effector.mass"].read("90") == pytest.approx(0.090)
    assert knobs["effector.mass"].read(" 0.09 kg ") == pytest.approx(0.090)
    assert knobs["piezo.gain"].read("0.12 µm/V") == pytest.approx(0.12e-6)
    assert knobs["piezo.natural_frequency"].read("1 kHz") == pytest.approx(6283.185, rel=1e-6)


@pytest.mark.parametrize("text", ["inf", "-inf", "nan", "1e999", "1e308", "-1e308", "5e-324", "1e-300 V"])
def test_a_number_of_a_size_that_nothing_has_is_refused(study, text):
    voltage = next(knob for knob in drive_knobs(study, study.records[0]) if knob.path == "drive.voltage")
    with pytest.raises(InputError, match=r"^drive\.voltage: found .*, expected "):
        voltage.read(text)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("heavy", 'effector.mass: found "heavy", expected a number [g] or a text such as "1 g".'),
        ("86,5", 'effector.mass: found "86,5", expected a decimal point: "86.5".'),
        ("-3", "effector.mass: found -3 g, expected a value above 0 g"),
        ("3 um", 'effector.mass: found the unit "um", expected a unit that converts to kg'),
    ],
)
def test_a_text_that_is_no_legal_number_is_refused(study, text, said):
    mass = next(knob for knob in parameter_knobs(study) if knob.path == "effector.mass")
    with pytest.raises(InputError, match="mass") as error:
        mass.read(text)
    assert said in str(error.value)


def test_what_a_drive_shares_with_the_study_is_turned_there(study):
    step, walk = study.records
    assert [knob.path for knob in drive_knobs(study, walk)] == ["drive.voltage", "drive.frequency", "drive.duty"]
    assert [choice.path for choice in drive_choices(walk)] == ["drive.direction", "drive.told_by"]
    assert "drive.voltage" in [knob.path for knob in drive_knobs(study, step)]


def test_the_study_at_the_sliders_numbers(study):
    begun = settings_of(study)
    assert changed_drives(study, begun) == {}
    turned = begun.with_values({"piezo.gain": 1.2e-7, "effector.mass": 0.1})
    turned = turned.with_drive("walk", "drive.frequency", 8.0).with_drive("walk", "drive.direction", 1.0)
    there = study_at(study, turned)
    assert (there.parameters["piezo.gain"].start, there.parameters["piezo.gain"].free) == (1.2e-7, True)
    assert (there.parameters["effector.mass"].value, there.parameters["effector.mass"].free) == (0.1, False)
    step, walk = there.records
    assert (walk.drive.frequency, walk.drive.direction, walk.drive.voltage) == (8.0, 1.0, 64.2)
    assert {"frequency"} <= walk.overrides
    assert step is study.records[0]
    assert changed_drives(study, turned) == {"walk": {"drive.frequency": 8.0, "drive.direction": 1.0}}
    assert begun == settings_of(study), "settings are never changed"


def test_a_slider_does_not_turn_what_was_measured_apart(tmp_path):
    apart = TEXT.replace(
        '"effector.mass" = { value = "86 g" }', '"effector.mass" = { value = "86 g", standard_error = "1 g" }'
    )
    study = load_study(study_files.write_study(tmp_path, apart))
    turned = settings_of(study).with_values({"effector.mass": 0.1, "piezo.gain": 1.2e-7})
    assert study_at(study, turned).values()["effector.mass"] == 0.1
    there = study_to_fit(study, turned).parameters
    assert there["effector.mass"].measured_apart == (0.086, 0.001)
    assert there["piezo.gain"].start == 1.2e-7


def test_a_start_beyond_a_bound_is_put_on_it(study):
    there = study_at(study, settings_of(study).with_values({"piezo.gain": 9e-7}))
    assert there.parameters["piezo.gain"].start == 2e-7


def test_parameters_without_a_number_are_asked_for_by_name(tmp_path):
    study = load_study(platform_study.write_platform(tmp_path))
    with pytest.raises(InputError, match=r"found no number for piezo\.gain, .*--guess"):
        settings_of(study)


POSITIVE = Quantity(1.0, "N/m", True, 0.0, float("inf"), False)
SIGNED = Quantity(0.0, "N", False, -float("inf"), float("inf"), True)
FROM_ZERO = Quantity(0.0, "s", False, 0.0, float("inf"), True)
SHARE = Quantity(1.0, "", True, 0.0, 1.0, True)


def test_a_positive_number_has_a_decade_either_way_by_equal_ratios():
    found = slider_range(POSITIVE, 2e6)
    assert (found.low, found.high, found.logarithmic) == (pytest.approx(2e5), pytest.approx(2e7), True)
    assert found.position(2e6) == POSITIONS // 2
    assert found.number(POSITIONS // 2) == 2e6
    assert found.number(POSITIONS) / found.number(POSITIONS - 1) == pytest.approx(10 ** (2 / POSITIONS), rel=1e-3)


def test_the_bounds_of_a_study_are_the_ends():
    found = slider_range(POSITIVE, 2e6, 1e6, 5e6)
    assert (found.low, found.high) == (1e6, 5e6)
    assert slider_range(POSITIVE, 2e6, 0.0, 5e6).low > 0


@pytest.mark.parametrize(
    ("quantity", "number", "ends"),
    [
        (SIGNED, 0.0, (-1.0, 1.0)),
        (SIGNED, 0.3, (0.0, 0.6)),
        (SIGNED, -0.3, (-0.6, 0.0)),
        (FROM_ZERO, 0.0, (0.0, 2e-3)),
        (FROM_ZERO, 5e-3, (0.0, 1e-2)),
    ],
)
def test_others_go_linearly(quantity, number, ends):
    found = slider_range(quantity, number)
    assert (found.low, found.high) == pytest.approx(ends)
    assert not found.logarithmic
    assert found.number(found.position(number)) == pytest.approx(number)


def test_a_slider_stays_below_an_end_that_is_not_legal():
    found = slider_range(SHARE, 0.5)
    assert 0.5 < found.number(POSITIONS) < 1.0
    assert found.widened(0.01, SHARE).high < 1.0


@pytest.mark.parametrize("quantity", [POSITIVE, SIGNED])
def test_positions_and_numbers_belong_together(quantity):
    found = slider_range(quantity, 0.7)
    assert all(found.position(found.number(position)) == position for position in range(POSITIONS + 1))


def test_a_number_typed_outside_widens_the_range():
    found = slider_range(POSITIVE, 1.0).widened(500.0, POSITIVE)
    assert found.low == 0.1
    assert found.high > 500.0
    assert slider_range(SIGNED, 0.3).widened(-2.0, SIGNED).low < -2.0
    assert slider_range(POSITIVE, 1.0).widened(3.0, POSITIVE) == slider_range(POSITIVE, 1.0)
