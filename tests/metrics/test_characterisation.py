"""`pdssjax characterise` finds the cycles of a record by itself and says how the actuator moves or pushes."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import pdssjax
from pdssjax import InputError, InputWarning, characterise
from pdssjax.cli import main as cli
from pdssjax.files import write_characterisations
from pdssjax.report.figures import cycle_figure

pytestmark = pytest.mark.usefixtures("undrawn")
EXAMPLE = Path(pdssjax.__file__).parent / "example"
MEASURED = Path(__file__).parents[2] / "experiments" / "liu2015" / "endeffector_3to5s_500Hz.csv"
PER_CYCLE = 160


def stick_slip(cycles, frequency, phase=0.0, stroke=6.5, back=3.2):
    """Times [s] and an ideal stick-slip motion [um] that begins `phase` of a cycle after a slip."""
    turn = phase + (np.arange(round(cycles * PER_CYCLE)) + 0.5) / PER_CYCLE
    cycle, part = np.divmod(turn, 1.0)
    return 7.0 + (turn - phase) / frequency, cycle * (stroke - back) + stroke * part


def noisy(values, noise=0.01, resolution=0.01):
    return np.round((values + np.random.default_rng(7).normal(0.0, noise, len(values))) / resolution) * resolution


def written(path: Path, time, values, header="time_s,displacement_um") -> Path:
    np.savetxt(path, np.column_stack([time, values]), delimiter=",", header=header, comments="", fmt="%.9g")
    return path


@pytest.mark.parametrize(
    ("frequency", "phase", "sign", "complete"),
    [(5.13, 0.0, 1, 11), (0.37, 0.6, -1, 11), (83.0, 0.93, 1, 11)],
)
def test_cycles_are_found_wherever_the_record_begins_and_whichever_way_it_walks(
    tmp_path, frequency, phase, sign, complete
):
    time, motion = stick_slip(12.3, frequency, phase)
    found = characterise(written(tmp_path / "motion.csv", time, sign * noisy(motion)))
    assert found.cycles.falls == (sign < 0)
    assert found.cycles.count == complete
    assert found.cycles.start == pytest.approx(time[0] + (phase > 0.1) * (1 - phase) / frequency, abs=0.03 / frequency)
    assert abs(found.cycles.slip_frequency - frequency) < 4 * found.cycles.slip_frequency_error
    for name, truth in [("stroke", 6.5e-6), ("back_slip", 3.2e-6), ("net_step", 3.3e-6), ("efficiency", 3.3 / 6.5)]:
        summary = found.summary[name]
        assert abs(summary.mean - truth) < 4 * summary.standard_error
        assert summary.standard_error < 2e-3 * summary.mean
    assert found.summary["speed"].mean == pytest.approx(3.3e-6 * frequency, rel=2e-3)


def test_a_slow_drift_larger_than_the_slip_does_not_hide_it(tmp_path):
    time, motion = stick_slip(20, 5.0, back=0.65)
    drift = 1.5 * np.sin(4.0 * (time - time[0]) / (time[-1] - time[0]))
    found = characterise(written(tmp_path / "motion.csv", time, noisy(motion + drift)))
    assert found.cycles.slip_frequency == pytest.approx(5.0, rel=1e-3)
    assert found.summary["back_slip"].mean == pytest.approx(0.65e-6, rel=0.05)


def test_rest_before_and_after_the_drive_is_left_out(tmp_path):
    time, motion = stick_slip(14, 5.0)
    motion = np.concatenate([np.zeros(3 * PER_CYCLE), motion[: 8 * PER_CYCLE], np.full(3 * PER_CYCLE, 26.4)])
    found = characterise(written(tmp_path / "motion.csv", time, noisy(motion)))
    assert found.cycles.count == 7
    assert found.cycles.start == pytest.approx(time[0] + 0.6, abs=2e-3)
    assert found.summary["net_step"].mean == pytest.approx(3.3e-6, rel=2e-3)


def test_the_found_frequency_costs_precision_and_a_given_one_does_not(tmp_path):
    time, motion = stick_slip(12.3, 5.0)
    file = written(tmp_path / "motion.csv", time, noisy(motion))
    found, given = characterise(file), characterise(file, frequency=5.0)
    assert found.summary["net_step"].standard_error > given.summary["net_step"].standard_error
    assert given.cycles.frequency == 5.0
    for result in (found, given):
        assert abs(result.summary["net_step"].mean - 3.3e-6) < 4 * result.summary["net_step"].standard_error


def test_the_packaged_records_walk_by_the_stroke_of_their_platform():
    forward, backward = (characterise(EXAMPLE / f"sawtooth_5Hz_{way}.csv") for way in "AB")
    for found in (forward, backward):
        stroke = found.summary["stroke"]
        assert found.cycles.count == 7
        assert abs(stroke.mean - 1.007e-7 * 64.2) < 3 * stroke.standard_error
    assert forward.cycles.falls < backward.cycles.falls
    # The first and the last sample both stand at a peak, 8 cycles apart.
    speed = (forward.values[-1] - forward.values[0]) / (forward.time[-1] - forward.time[0])
    assert forward.summary["speed"].mean == pytest.approx(speed, rel=1e-3)
    assert backward.summary["efficiency"].mean < forward.summary["efficiency"].mean


def test_a_measured_record_gives_what_was_read_off_its_plot():
    found = characterise(MEASURED, frequency=5.0)
    assert found.column == "end_effector_displacement_um"
    assert found.cycles.count == 9
    # The flanks are bent by hysteresis: their slope is 12.6 um/s at first and 14.7 um/s at last.
    assert found.summary["stroke"].mean == pytest.approx(2.75e-6, rel=0.02)
    assert found.summary["back_slip"].mean == pytest.approx(2.67e-6, rel=0.02)
    net = found.summary["net_step"]
    assert abs(net.mean - 0.079e-6) < net.standard_error


def test_a_window_keeps_part_of_the_record(tmp_path):
    time, motion = stick_slip(12, 5.0)
    found = characterise(written(tmp_path / "motion.csv", time, motion), window=(7.5, 8.7))
    assert found.time[0] >= 7.5
    assert found.cycles.count == 4


def test_a_slip_that_takes_time_shortens_the_stroke(tmp_path):
    time, motion = stick_slip(12.3, 5.0)
    file = written(tmp_path / "motion.csv", time, noisy(motion))
    whole, part = characterise(file, frequency=5.0), characterise(file, frequency=5.0, slip_duration=0.02)
    assert part.summary["stroke"].mean == pytest.approx(0.9 * whole.summary["stroke"].mean, rel=2e-3)
    assert part.summary["net_step"].mean == pytest.approx(whole.summary["net_step"].mean, rel=1e-3)


def test_a_blocked_actuator_is_characterised_by_its_output_force(tmp_path):
    phase = np.mod(np.arange(8 * PER_CYCLE) / PER_CYCLE + 0.3, 1.0)
    time = 0.2 / PER_CYCLE * np.arange(len(phase))
    force = 0.1 + 0.3 * phase + np.random.default_rng(4).normal(0.0, 2e-3, len(phase))
    found = characterise(written(tmp_path / "push.csv", time, force, "time_s,load_cell_force_N"))
    output = found.summary["output"]
    assert found.measures == "force"
    assert abs(output.mean - 0.4) < 4 * output.standard_error
    assert output.standard_error < 1e-3
    assert found.summary["minimum"].mean == pytest.approx(0.1, abs=0.01)


def test_a_sine_is_no_stick_and_slip(tmp_path):
    time = np.arange(1600) / 800
    file = written(tmp_path / "sine.csv", time, noisy(3 * np.sin(2 * np.pi * 5 * time)))
    with pytest.warns(InputWarning, match="no fast flank"):
        characterise(file)


@pytest.mark.parametrize(("cycles", "given"), [(9.5, 4.98), (3.5, 4.97)])  # 17 and 4.7 standard errors off
def test_a_frequency_beside_the_slips_own_is_mentioned(tmp_path, cycles, given):
    time, motion = stick_slip(cycles, 5.0)
    file = written(tmp_path / "motion.csv", time, noisy(motion))
    with pytest.warns(InputWarning, match=rf"the slips come at (5|4\.999|5\.000).* Hz, while {given} Hz was given"):
        characterise(file, frequency=given)


def test_one_cycle_has_no_scatter_and_says_so(tmp_path):
    time, motion = stick_slip(1.9, 5.0)
    with pytest.warns(InputWarning, match="one complete cycle only"):
        found = characterise(written(tmp_path / "motion.csv", time, noisy(motion)), frequency=5.0)
    assert np.isnan(found.summary["stroke"].standard_error)
    assert found.summary["stroke"].mean == pytest.approx(6.5e-6, rel=0.01)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_figure_marks_the_turning_points_beside_their_slips(sign, tmp_path):
    time, motion = stick_slip(6.5, 5.0, back=0.7)
    found = characterise(written(tmp_path / "motion.csv", time, sign * noisy(motion)))
    slips = found.cycles.start + np.arange(found.cycles.count + 1) / 5.0
    figure = cycle_figure(found)
    figure.draw_without_rendering()
    before, after = (line for line in figure.axes[0].lines if "a slip" in str(line.get_label()))
    assert len(np.asarray(after.get_xdata())) == len(slips)
    np.testing.assert_allclose(np.asarray(after.get_xdata()), slips, atol=4e-3)
    np.testing.assert_allclose(np.asarray(before.get_xdata()), slips[-len(np.asarray(before.get_xdata())) :], atol=4e-3)
    np.testing.assert_allclose(np.asarray(before.get_ydata()), 1e6 * sign * found.before[np.isfinite(found.before)])


TIME, MOTION = stick_slip(6, 5.0)
STEP = np.where(TIME > 7.3, 5.0, 0.0)
HEADER = "time_s,displacement_um"

# name: (options, what the message must contain, the header and the columns beside the time where they are others)
FAULTS = {
    "wrong column": ({"displacement": "displacment_um"}, ['"displacment_um"', '"displacement_um"']),
    "constant": ({}, ['"displacement_um"', "same displacement", "moves"], HEADER, 0 * MOTION),
    "nothing to choose": ({}, ["no column", '"voltage_V"', "--displacement"], "time_s,voltage_V"),
    "too much to choose": (
        {},
        ["2 columns", '"measured_um"', '"predicted_um"', "--displacement"],
        "time_s,measured_um,predicted_um",
        MOTION,
        MOTION,
    ),
    "no time": (
        {"displacement": "displacement_um"},
        ["no column", '"lap_mm"', "--time"],
        "lap_mm,displacement_um",
    ),
    "no unit": ({}, ['"time"', "no unit", '"time=s"'], "time,displacement_um"),
    "unit of another dimension": ({"force": "x_um"}, ['"x_um"', '"um"', "N"], "time_s,x_um"),
    "a single step": ({}, ["found", "expected", "cycles"], HEADER, STEP),
    "too short": ({"window": (7.0, 7.05)}, ["expected", "cycle"]),
    "window beside the record": ({"window": (1.0, 2.0)}, ["no sample", "1 s to 2"]),
    "slip longer than half the cycle": ({"slip_duration": 0.15}, ["0.15 s", "0.1 s"]),
}


@pytest.mark.parametrize("fault", FAULTS.values(), ids=FAULTS)
def test_input_at_fault_is_refused_by_name(fault, tmp_path):
    options, expected, *header = fault
    header, *columns = header or [HEADER]
    file = written(tmp_path / "motion.csv", TIME, np.column_stack(columns or [MOTION]), header)
    with pytest.raises(InputError) as caught:
        characterise(file, **options)
    message = str(caught.value)
    assert message.startswith(str(file))
    assert message.count("\n") <= 1
    for text in expected:
        assert text in message


def test_time_that_goes_back_is_refused_with_its_line(tmp_path):
    time = TIME.copy()
    time[10] = time[8]
    with pytest.raises(InputError, match=r'line 12, column "time_s".*expected times that increase'):
        characterise(written(tmp_path / "motion.csv", time, MOTION))


def test_a_single_slip_tells_no_frequency(tmp_path):
    time, motion = stick_slip(1.6, 5.0, phase=0.2)
    with pytest.raises(InputError, match="found"):
        characterise(written(tmp_path / "motion.csv", time, noisy(motion)))


def test_noise_alone_has_no_cycles(tmp_path):
    with pytest.raises(InputError, match="found"):
        characterise(written(tmp_path / "noise.csv", TIME, np.random.default_rng(1).normal(size=len(TIME))))


def test_the_command_prints_a_table_and_writes_json_cycles_and_figures(tmp_path, capsys):
    time, motion = stick_slip(5, 5.0)
    walking = written(tmp_path / "motion.csv", 1e3 * time, motion, "Time_ms,position")
    out = tmp_path / "out"
    arguments = ["characterise", str(walking), str(EXAMPLE / "sawtooth_5Hz_B.csv"), "--unit", "displacement=um"]
    assert cli.main([*arguments[:2], *arguments[3:], "--displacement", "position", "--frequency", "5 Hz"]) == 0
    printed = capsys.readouterr().out
    assert "step efficiency (3.1)" in printed
    assert "4 complete" in printed
    assert not out.exists()

    assert cli.main(["characterise", arguments[2], str(EXAMPLE / "sawtooth_5Hz_A.csv"), "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {"characterise.json", "cycles.csv", "plots"}
    assert {path.name for path in (out / "plots").iterdir()} == {"sawtooth_5Hz_A.png", "sawtooth_5Hz_B.png"}
    document = json.loads((out / "characterise.json").read_text(), parse_constant=pytest.fail)
    assert document["format"] == "pdssjax-characterisation/1"
    assert [record["direction"] for record in document["records"]] == ["backward", "forward"]
    with (out / "cycles.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == sum(record["cycles"]["complete"] for record in document["records"])
    mean = np.mean([float(row["net_step_um"]) for row in rows if row["record"] == "sawtooth_5Hz_A"])
    assert 1e-6 * mean == pytest.approx(document["records"][1]["figures"]["net_step"]["mean"], rel=1e-5)
    assert cli.main(["characterise", arguments[2], "--out", str(out)]) == 2
    assert "found results already" in capsys.readouterr().err


def test_cycles_on_a_clock_that_began_long_ago_begin_where_they_do(tmp_path):
    time, motion = stick_slip(5, 5.0)
    np.savetxt(tmp_path / "x.csv", np.column_stack([1.7e9 + time, motion]), "%.6f", ",", header="time_s,x_um")
    write_characterisations([characterise(tmp_path / "x.csv")], tmp_path / "out")
    with (tmp_path / "out" / "cycles.csv").open() as stream:
        starts = np.array([float(row["start_s"]) for row in csv.DictReader(stream)])
    np.testing.assert_allclose(np.diff(starts), 0.2, rtol=1e-3)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["nowhere.csv"], "nowhere.csv: there is no such file"),
        ([], "FILE"),
        (["motion.csv", "--frequency", "5 um"], "--frequency"),
        (["motion.csv", "--window", "2 s", "1 s"], "2 s to 1 s"),
        (["motion.csv", "--unit", "um"], "--unit"),
        (["motion.csv", "--displacement", "a", "--force", "b"], "not allowed with"),
    ],
)
def test_a_wrong_command_line_gives_status_2_and_one_line(options, expected, capsys):
    assert cli.main(["characterise", *options]) == 2
    error = capsys.readouterr().err
    assert expected in error
    assert error.count("\n") == 1
