"""From an instrument's files to parameters in two commands, where the voltage tells the drive's flanks badly."""

import numpy as np
import pytest
from walk_files import guessed, study_of, text_of

from experiments.from_files import TRUTH, Rig, told, true_flanks, write_files
from pdssjax import identify, load_study
from pdssjax.cli import main as cli
from pdssjax.study import make_recordings

RIGS = {
    "a step and falls between two samples": Rig(4e-5, 3e-5, 0.02),
    "a fall on one or two samples, with noise": Rig(2e-4, 8e-5, 0.06),
    "flanks that samples show": Rig(3e-4, 3e-4, 0.01),
    "a voltage between -20 and 40 V": Rig(4e-5, 3e-5, 0.02, bias=-20.0),
    "cycloids": Rig(3e-4, 2e-4, 0.02, waveform="cycloidal"),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*at least one period:pdssjax.core.errors.InputWarning")
@pytest.mark.parametrize("name", RIGS)
def test_two_commands_lead_to_parameters_within_their_errors(tmp_path, name):
    files = write_files(tmp_path, RIGS[name])
    assert cli.main(["new", str(tmp_path / "rig"), "--files", *map(str, files), "--mass", "45 g"]) == 0
    study, out = tmp_path / "rig" / "study.toml", tmp_path / "out"
    assert cli.main(["identify", str(study), "--out", str(out)]) == 0
    found = told(out / "estimate.json", TRUTH | true_flanks(RIGS[name], study))
    assert set(found["parameters"]) >= set(TRUTH)
    off = {path: (value - truth) / error for path, (truth, value, error, _) in found["parameters"].items()}
    assert all(abs(sigmas) < 4.0 for sigmas in off.values()), off
    # Chi-square of nine numbers that are right: above 27.9 once in a thousand times.
    assert found["distance"] < 27.9, off
    assert f'waveform = "{RIGS[name].waveform}"' in study.read_text()
    assert "contradict" not in (out / "report.txt").read_text()


NOISY_STEP = """
format = "pdssjax-study/1"
actuator = { piezo = "second-order" }
[parameters]
"piezo.gain" = { value = "0.152 um/V" }
"piezo.natural_frequency" = { value = "1450 Hz" }
"piezo.damping_ratio" = { value = 0.05 }
[[record]]
name = "step"
file = "step.csv"
columns = { time = "time_s", displacement = "displacement_um" }
measures = "platform"
noise = "5 nm"
drive = { waveform = "step", voltage = "23 V", rise_time = "40 us" }
sampling = { start = "-100.0613 ms", end = "100 ms", interval = "50 us" }
"""


@pytest.mark.slow
def test_a_noisy_voltage_is_in_the_error_of_the_gain(tmp_path):
    """Root mean square of 60 normal numbers: 0.82 to 1.18 in 95 % of cases; without the voltage's error it is 1.7."""
    (tmp_path / "plan.toml").write_text(NOISY_STEP)
    (made,) = make_recordings(load_study(tmp_path / "plan.toml", virtual=True), 1)
    time = made.record.time
    volts, off = np.asarray(made.record.drive.at(time)), []
    for number in range(60):
        random = np.random.default_rng([7, number])
        noisy = volts + random.normal(0.0, 0.052, time.size), made.true + random.normal(0.0, 5e-9, time.size)
        text = text_of("t_s,u_V,x_um", time + 1.000061, noisy[0], 1e6 * noisy[1], form=".18e")
        _, study = study_of(tmp_path, guessed(tmp_path, text))
        gain = identify(study).parameters["piezo.gain"]
        off.append((gain.value - 0.152e-6) / gain.standard_error)
    assert 0.82 < np.sqrt(np.mean(np.square(off))) < 1.18
    assert np.count_nonzero(np.abs(off) < 1.96) >= 53


def test_the_flanks_that_a_study_leaves_open_are_those_of_the_rig(tmp_path):
    starts = zip(("step", "forward", "backward"), ("0.99995", "1.00003", "1"), strict=True)
    records = [f'[[record]]\nname = "{name}"\nstart = "{start} s"\n' for name, start in starts]
    (tmp_path / "study.toml").write_text("".join(records))
    found = true_flanks(Rig(4e-5, 3e-5, 0.02), tmp_path / "study.toml")
    assert found["sensor.delay@step"] == pytest.approx(50e-6 + 61e-6)
    assert found["sensor.delay@forward"] == pytest.approx(3e-6) and found["sensor.delay@backward"] == pytest.approx(
        3.7e-6
    )
    assert (found["drive.rise_time@step"], found["drive.fall_time@backward"]) == (4e-5, 3e-5)
