"""A record's clock has to meet its drive: `start` says when the drive starts on it, and what cannot be is refused."""

import numpy as np
import pytest
from study_files import STUDY, changed, write_study

from pdssjax import InputError, Record, load_study
from pdssjax.files.record_results import write_csv
from pdssjax.study import Recording

UNIX = 1_700_000_000.25


def samples(first: float, interval: float, count: int) -> str:
    """A CSV file of a motion and a voltage of 48.2 V from the middle on."""
    rows = [f"{first + k * interval:.6f},{np.sin(k):.4f},{48.2 * (2 * k >= count)}\n" for k in range(count)]
    return "time_s,displacement_um,voltage_V\n" + "".join(rows)


def starting(start: str, record: str = "step") -> str:
    """The study with `start` in one of its records."""
    return changed(f'name = "{record}"\n', f'name = "{record}"\nstart = {start}\n')


@pytest.mark.parametrize("first", [UNIX, -0.5, -2e-3, 40_000.0])
def test_a_step_whose_clock_cannot_meet_its_drive_is_refused(tmp_path, first):
    with pytest.raises(InputError) as refused:
        load_study(write_study(tmp_path, step=samples(first, 5e-5, 40)))
    told = str(refused.value)
    assert f"found times from {first:.12g} s to {first + 39 * 5e-5:.12g} s" in told
    assert all(part in told for part in ['step.csv: record "step"', "expected", "the record's key start"])


@pytest.mark.parametrize(("first", "refused"), [(UNIX, True), (-0.5, True), (201.0, True), (199.0, False)])
def test_a_walk_may_begin_late_but_not_beyond_reason(tmp_path, first, refused):
    path = write_study(tmp_path, walk=samples(first, 1e-3, 400))
    if not refused:
        assert load_study(path).records[1].time[0] == pytest.approx(first)
        return
    with pytest.raises(InputError, match=r"expected (some after|the first within 1000 periods of the drive, 200 s)"):
        load_study(path)


def test_start_shifts_the_clock(tmp_path):
    text = changed('name = "walk"\n', 'name = "walk"\nstart = "1700000000.25 s"\n', starting('"-3 ms"'))
    path = write_study(tmp_path, text, step=samples(-4e-3, 5e-5, 40), walk=samples(UNIX - 0.1, 1e-3, 400))
    step, walk = load_study(path).records
    np.testing.assert_allclose(step.time, -1e-3 + 5e-5 * np.arange(40), atol=1e-12)
    np.testing.assert_allclose(walk.time, -0.1 + 1e-3 * np.arange(400), atol=1e-6)  # as fine as such a clock


def test_window_and_exclude_stay_on_the_clock_of_the_file(tmp_path):
    text = changed('start = "10 s"\n', 'start = "10 s"\nwindow = ["10.1 s", "10.3 s"]\n', starting('"10 s"', "walk"))
    walk = load_study(write_study(tmp_path, text, walk=samples(9.9, 1e-3, 1000))).records[1]
    assert walk.time[0] == pytest.approx(0.1) and walk.time[-1] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("start", "essential"),
    [('"5 V"', "expected a unit that converts to s"), ("1e9", "found times"), ('"soon"', "expected a number")],
)
def test_a_start_at_fault_is_refused(tmp_path, start, essential):
    with pytest.raises(InputError, match=essential):
        load_study(write_study(tmp_path, starting(start)))


def test_a_friction_record_has_no_start(tmp_path):
    walk = STUDY.index('[[record]]\nname = "walk"')
    text = STUDY[:walk] + (
        '[[record]]\nname = "loops"\nfile = "walk.csv"\nstart = 1\nmeasures = "friction"\nunits = { force = "N" }\n'
        'columns = { time = "time_s", motion = "displacement_um", force = "voltage_V" }\n'
    )
    with pytest.raises(InputError, match="found a start, expected none"):
        load_study(write_study(tmp_path, text, walk=samples(UNIX, 1e-3, 400)))


SAMPLED = 'drive = { waveform = "sampled", column = "voltage_V", interpolation = "held" }'
IDEAL = 'drive = { waveform = "step", voltage = "48.2 V" }'


def test_a_voltage_of_the_same_file_is_shifted_with_the_record(tmp_path):
    text = changed(IDEAL, SAMPLED, starting('"100 s"'))
    record = load_study(write_study(tmp_path, text, step=samples(100.0 - 1e-3, 5e-5, 40))).records[0]
    volts = np.asarray(record.drive.at(record.time))
    np.testing.assert_allclose(volts, 48.2 * (np.arange(40) >= 20))


def test_a_voltage_of_another_file_keeps_its_own_clock(tmp_path):
    (tmp_path / "generator.csv").write_text("time_s,voltage_V\n0,48.2\n0.01,48.2\n")
    elsewhere = SAMPLED.replace("column =", 'file = "generator.csv", column =')
    text = changed(IDEAL, elsewhere, starting('"100 s"'))
    record = load_study(write_study(tmp_path, text, step=samples(100.0 - 1e-3, 5e-5, 40))).records[0]
    np.testing.assert_allclose(np.asarray(record.drive.at(np.array([0.0, 5e-3]))), 48.2)


def test_a_voltage_on_another_clock_is_refused_with_the_remedy(tmp_path):
    text = changed(IDEAL, SAMPLED)
    with pytest.raises(InputError, match="the record's key start"):
        load_study(write_study(tmp_path, text, step=samples(UNIX, 5e-5, 40)))


def test_a_virtual_rig_writes_the_clock_that_the_study_describes(tmp_path):
    text = starting(f"{UNIX}", "walk")
    path = write_study(tmp_path, text, walk=samples(UNIX, 1e-3, 400))
    walk: Record = load_study(path).records[1]
    write_csv(Recording(walk, walk.measured, 0.0), path, tmp_path / "walk.csv")
    again = load_study(path).records[1]
    np.testing.assert_allclose(again.time, walk.time, atol=1e-6)
    np.testing.assert_allclose(again.measured, walk.measured)
