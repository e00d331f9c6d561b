"""A sweep is of the record whose drive it varies: what holds under its conditions holds at all points."""

import numpy as np
import pytest
from study_files import write_estimate
from walking_study import write_walking

import pdssjax
from pdssjax import load_study
from pdssjax.cli.main import main
from pdssjax.sweeps import driven_record, plan_sweep

FALL = '"drive.fall_time" = { value = 0 }\n'
LOCAL = '"drive.fall_time@slow" = { start = "0.4 ms" }\n"piezo.gain@other" = { start = "0.2 um/V" }\n'


@pytest.fixture
def written(tmp_path):
    """The walking rig, with a fall time of its own in the record that walks, and a gain in the one that steps."""
    file = write_walking(tmp_path)
    head, step, walk = file.read_text().replace(FALL, FALL + LOCAL).split("[[record]]")
    file.write_text("[[record]]".join([head, step + 'conditions = ["other"]\n', walk + 'conditions = ["slow"]\n']))
    return file


def test_numbers_are_those_of_the_record(written):
    planned = plan_sweep(load_study(written), {"drive.voltage": np.array([50.0, 64.0])})
    assert not any("@" in path for path in planned.used)
    assert planned.used["drive.fall_time"]["value"] == pytest.approx(4e-4)
    assert planned.used["piezo.gain"]["value"] == pytest.approx(1e-7)


def test_a_voltage_is_the_peak_however_the_record_tells_it(written):
    """By the slope of slow flanks 64 V would be 63.5 V with a flank of 0.4 ms at 20 Hz."""
    text = written.read_text()
    (line,) = [line for line in text.splitlines() if line.startswith("drive = ") and "sawtooth" in line]
    written.write_text(text.replace(line, line.replace("{ ", '{ told_by = "slope", ', 1)))
    drive = driven_record(load_study(written), None).drive
    assert (drive.told_by, drive.fall_time) == (0.0, pytest.approx(4e-4))
    assert drive.voltage == pytest.approx(64.0 * (1.0 - 4e-4 * 20.0))


class Asked(Exception):
    """What a sweep was asked for."""


@pytest.fixture
def asked(monkeypatch):
    def sweep(study, points, **options):
        raise Asked(study, points, options)

    monkeypatch.setattr(pdssjax, "sweep", sweep)


@pytest.fixture
def estimate(written, tmp_path):
    """An estimate.json that knows the numbers of the study to 1 %."""
    values = load_study(written).values()
    names = ["piezo.gain", "piezo.gain@other", "drive.fall_time", "drive.fall_time@slow", "drive.rise_time"]
    matrix = np.diag([(0.01 * values.get(name, 1.0)) ** 2 for name in names]).tolist()
    return write_estimate(tmp_path, values, covariance={"names": names, "matrix": matrix})


@pytest.mark.parametrize("option", ["--bands", "--derivatives"])
def test_bands_and_derivatives_are_by_what_holds_there(written, estimate, tmp_path, asked, option):
    command = ["sweep", str(written), "--voltage", "20,40", "--frequency", "20", "--estimate", str(estimate), option]
    with pytest.raises(Asked) as caught:
        main([*command, "--out", str(tmp_path / "swept")])
    study, points, options = caught.value.args
    plan_sweep(study, points, **{name: options[name] for name in ("record", "cycles", "metrics", "derivatives")})
    if option == "--derivatives":
        assert set(options["derivatives"]) == set(study.for_record(study.records[1]).parameters)
        return
    assert set(points.paths) == {"drive.voltage", "drive.frequency", "piezo.gain", "drive.fall_time"}
    falls = points.values()[:, points.paths.index("drive.fall_time")]
    assert np.median(falls) == pytest.approx(4e-4) and np.ptp(falls) > 1e-6
