"""What a legal study file means."""

import dataclasses
from pathlib import Path

import equinox as eqx
import numpy as np
import pytest
from study_files import STUDY, changed, csv, write_study

from pdssjax import InputWarning, load_study
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.drive.step import Step
from pdssjax.files import EXAMPLE
from pdssjax.friction.simplified_lugre import SimplifiedLuGre
from pdssjax.piezo.second_order import SecondOrder

LIU = Path(__file__).parents[2] / "experiments" / "liu2015" / "study.toml"


def test_models_are_members_of_their_families(tmp_path):
    study = load_study(write_study(tmp_path))
    assert (study.title, study.piezo, study.friction) == ("Small rig", SecondOrder, SimplifiedLuGre)
    assert (study.feedback, study.friction_state, study.rests_under_load) == (False, "deflection", False)


def test_a_rig_that_rests_under_its_load_is_an_actuator_that_does(tmp_path):
    study = load_study(write_study(tmp_path, changed("feedback = false", "rests_under_load = true")))
    actuator = study.models.actuator({"effector.load": 0.1})
    assert study.rests_under_load and actuator.rests_under_load and not actuator.feedback
    assert "at rest under its load" in study._repr_html_()


def test_parameter_is_free_unless_it_has_a_value(tmp_path):
    parameters = load_study(write_study(tmp_path)).parameters
    assert list(parameters)[:3] == ["effector.mass", "piezo.gain", "piezo.natural_frequency"]  # as in the file
    assert [path for path, p in parameters.items() if not p.free] == ["effector.mass", "drive.fall_time"]
    assert parameters["effector.mass"].value == 0.086
    gain, frequency = parameters["piezo.gain"], parameters["piezo.natural_frequency"]
    assert (gain.start, gain.low, gain.high, gain.unit) == (1e-7, 5e-8, 2e-7, "m/V")
    assert frequency.free and (frequency.start, frequency.low, frequency.high) == (None, None, None)


def test_bound_at_the_end_of_the_legal_range_says_nothing(tmp_path):
    text = changed('{ start = "20 %" }', "{ start = 0.2, min = 0, max = 1 }", STUDY)
    damping = load_study(write_study(tmp_path, text)).parameters["piezo.damping_ratio"]
    assert (damping.low, damping.high) == (None, None)


def test_record_holds_si_numbers(tmp_path):
    step, walk = load_study(write_study(tmp_path)).records
    assert (step.name, step.role, step.measures, step.noise, step.offset) == ("step", "fit", "platform", 1e-8, None)
    assert (walk.name, walk.role, walk.measures, walk.noise) == ("walk", "validate", "effector", None)
    assert walk.offset == pytest.approx(2e-6)
    np.testing.assert_allclose(step.time, np.arange(40) * 5e-5)
    np.testing.assert_allclose(step.measured[1], 0.8415e-6)


@pytest.mark.parametrize(
    ("parameters", "volts"),
    [
        pytest.param('"drive.voltage" = { value = "50 V", standard_error = "3 mV" }', 50.0, marks=pytest.mark.slow),
        ('"drive.voltage" = { value = "40 V" }\n"drive.voltage@hot" = { start = "51 V" }', 51.0),
    ],
)
def test_a_voltage_that_a_drive_leaves_out_is_a_parameter(tmp_path, parameters, volts):
    text = changed('"drive.fall_time"', f'{parameters}\n"drive.fall_time"', changed(', voltage = "48.2 V"', ""))
    text = changed('name = "step"', 'name = "step"\nconditions = ["hot"]', text)
    study = load_study(write_study(tmp_path, text))
    step, walk = study.records
    assert float(step.drive.voltage) == volts and "voltage" not in step.overrides
    assert float(walk.drive.voltage) == 64.2 and "voltage" in walk.overrides
    path = max(path for path in study.parameters if path.startswith("drive.voltage"))
    numbers = {"friction.sigma0": 1e6, "friction.sigma1": 30.0, "friction.f_ss": 0.4, "piezo.natural_frequency": 6e3}
    study = dataclasses.replace(study, records=(step,))
    (usual,), (twice,) = (study.with_values(numbers | {path: factor * volts}).predict() for factor in (1.0, 2.0))
    np.testing.assert_allclose(twice, 2.0 * np.asarray(usual), rtol=1e-12)


def test_drive_is_the_waveform_with_its_fields(tmp_path):
    step, walk = load_study(write_study(tmp_path)).records
    assert eqx.tree_equal(step.drive, Step(voltage=48.2, rise_time=0.0))
    assert eqx.tree_equal(walk.drive, Sawtooth(voltage=64.2, frequency=5.0, fall_time=0.0, direction=-1.0))


def test_record_owns_the_drive_fields_it_sets(tmp_path):
    text = changed('frequency = "5 Hz"', 'frequency = "5 Hz", fall_time = "2 ms"')
    step, walk = load_study(write_study(tmp_path, text)).records
    assert eqx.tree_equal(walk.drive, Sawtooth(voltage=64.2, frequency=5.0, fall_time=0.002, direction=-1.0))
    assert "fall_time" in walk.overrides and "rise_time" not in step.overrides


def test_unit_is_told_by_the_study_or_by_the_column(tmp_path):
    text = changed('time = "time_s"', 'time = "clock"') + 'units = { time = "s" }\n'
    text = changed('"displacement_um" }\nmeasures', '"displacement_um" }\nunits = { time = "ms" }\nmeasures', text)
    data = changed("time_s", "clock", csv(0.05, 40))
    step = load_study(write_study(tmp_path, text, step=data)).records[0]
    np.testing.assert_allclose(step.time[1], 5e-5)


def test_window_and_exclude_choose_the_samples(tmp_path):
    text = STUDY + 'window = ["10 ms", 0.3]\nexclude = [["100 ms", 0.11], [0.2, 0.2005]]\n'
    walk = load_study(write_study(tmp_path, text)).records[1]
    milliseconds = [k for k in range(10, 301) if not (100 <= k <= 110 or k == 200)]
    np.testing.assert_allclose(walk.time, np.array(milliseconds) * 1e-3)


@pytest.mark.parametrize("mark", ["# ", "#", ""])
@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_csv_may_have_remarks_and_any_usual_separator(tmp_path, mark, separator):
    header = ["time_s", "displacement_um (median of Figs 14,21; 25)", "extra"]
    rows = [["0", "1.5", ""], ["5e-5", "2.5", "x"], *([f"{k}e-4", f"{k}", ""] for k in range(1, 30))]
    lines = ["# measured in July, by hand", mark + separator.join(header), *map(separator.join, rows), "", "# end"]
    step = load_study(write_study(tmp_path, step="\ufeff" + "\r\n".join(lines))).records[0]
    np.testing.assert_allclose(step.measured[:3], [1.5e-6, 2.5e-6, 1e-6])
    np.testing.assert_allclose(step.time[:3], [0, 5e-5, 1e-4])


def test_column_may_be_named_with_its_remark(tmp_path):
    data = changed("displacement_um", "d_um (left),d_um (right)", csv(5e-5, 40)).replace(".0000\n", ".0000,0\n")
    data = "\n".join(line if line.count(",") == 2 else line + ",0" for line in data.split("\n") if line)
    text = changed('"displacement_um"', '"d_um (left)"')
    step = load_study(write_study(tmp_path, text, step=data)).records[0]
    np.testing.assert_allclose(step.measured[1], 0.8415e-6)


def test_mass_is_needed_only_where_the_effector_moves_something(tmp_path):
    text = changed('"effector.mass" = { value = "86 g" }\n', "").partition('[[record]]\nname = "walk"')[0]
    assert "effector.mass" not in load_study(write_study(tmp_path, text)).parameters


def test_study_without_records_is_legal(tmp_path):
    assert load_study(write_study(tmp_path, STUDY.partition("[[record]]")[0])).records == ()


@pytest.mark.parametrize(
    ("name", "text"), [("walk", csv(1.0, 5000)), ("walk", csv(0.05, 5000)), ("step", csv(0.05, 800))]
)
def test_times_that_look_like_milliseconds_warn(tmp_path, name, text):
    with pytest.warns(InputWarning, match=rf'{name}\.csv: record "{name}": the times seem to have another unit'):
        load_study(write_study(tmp_path, **{name: text}))


def test_record_shorter_than_a_period_warns(tmp_path):
    with pytest.warns(InputWarning, match=r'record "walk": found 0\.049 s .* at least one period .* 0\.2 s'):
        load_study(write_study(tmp_path, walk=csv(1e-3, 50)))
    load_study(write_study(tmp_path, walk=csv(1e-3, 200)))  # one period exactly


def test_packaged_example_frees_nine_parameters_without_starts():
    study = load_study(EXAMPLE / "study.toml")
    free = [p for p in study.parameters.values() if p.free]
    assert len(free) == 9 and all(p.start is None for p in free)
    assert [r.time.size for r in study.records] == [801, 801, 801, 1601, 1601, 5001, 5001]
    assert [r.role for r in study.records] == ["fit"] * 5 + ["validate"] * 2


@pytest.mark.filterwarnings("ignore:.*at least one period:pdssjax.core.errors.InputWarning")
def test_measured_record_leaves_out_the_points_read_badly():
    record = load_study(LIU).records[0]
    since_slip = np.mod(record.time + 0.1, 0.2) - 0.1
    assert not np.any((since_slip > -1e-4) & (since_slip < 4.1e-3))
    assert record.time[0] == 3.008
