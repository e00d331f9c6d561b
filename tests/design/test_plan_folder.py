"""The folder of a plan reads back as a study of the same records; what a study and options say of the next records."""

import dataclasses
import json

import numpy as np
import pytest
from fabricated_plan import SOURCE, plan

import pdssjax
from pdssjax import InputError, Limits
from pdssjax.cli.main import main
from pdssjax.design import with_law
from pdssjax.design.experiments import completed_limits, possible_experiments
from pdssjax.files import plan_folder, read_design, write_plan
from pdssjax.report.text import format_design

pytestmark = pytest.mark.usefixtures("undrawn")
DESIGN = """
[design]
voltage = ["20 V", "100 V"]
interval = "50 us"
noise = { effector = "10 nm" }
budget = { samples = 600, records = 2 }
"""


@pytest.fixture
def source(tmp_path):
    """A study with a [design] table."""
    file = tmp_path / "rig.toml"
    file.write_text(SOURCE + DESIGN)
    return file


@pytest.fixture
def folder(source, tmp_path):
    """Where a plan was written."""
    made = plan(source)
    write_plan(made, source, read_design(source).document, tmp_path / "plan")
    return made, tmp_path / "plan"


def test_the_plan_reads_back_as_a_study(folder):
    made, place = folder
    study = pdssjax.load_study(place / "plan.toml", virtual=True)
    assert len(study.records) == len(made.records)
    for record, planned in zip(study.records, made.records, strict=True):
        assert record.name == planned.name and record.measures == planned.experiment.kind
        assert record.time == pytest.approx(planned.times, abs=1e-9)
        assert record.noise == pytest.approx(planned.noise.deviation)
        if planned.experiment.drive is not None:
            assert float(record.drive.peak()) == pytest.approx(float(planned.experiment.drive.peak()))
            assert record.drive.direction == planned.experiment.drive.direction
    assert study.values() == pytest.approx(made.with_rig.values())


def test_what_is_set_for_a_record_holds_in_it_alone(folder):
    _, place = folder
    study = pdssjax.load_study(place / "plan.toml", virtual=True)
    tilts = [study.for_record(record).values()["effector.tilt"] for record in study.records]
    assert tilts == pytest.approx([0.0, 0.05, 0.0])


def test_the_limits_go_on_with_the_plan(folder, source):
    _, place = folder
    again = read_design(place / "plan.toml")
    assert again.limits == read_design(source).limits and again.budget.samples == 600
    assert plan_folder(place) == (place / "plan.toml", None)


def test_templates_and_drives_are_there_for_each_record(folder):
    made, place = folder
    for file, planned in zip(sorted((place / "templates").iterdir()), made.records, strict=True):
        lines = file.read_text().splitlines()
        assert len(lines) == planned.schedule.count + 1 and lines[0].startswith("time_s,")
        assert float(lines[1].split(",")[0]) == pytest.approx(planned.times[0], abs=1e-9)
    for file, planned in zip(sorted((place / "drives").iterdir()), made.records, strict=True):
        time, level = np.loadtxt(file, delimiter=",", skiprows=1, unpack=True)
        assert time[-1] >= planned.times[-1] - 1e-6 and np.all(np.diff(time) > 0)
        if planned.experiment.drive is not None:
            assert level.max() == pytest.approx(float(planned.experiment.drive.peak()), rel=1e-3)


def test_the_plan_is_there_in_words_and_numbers(folder):
    made, place = folder
    document = json.loads((place / "plan.json").read_text())
    assert document["format"] == "pdssjax-plan/1" and document["samples"] == made.samples
    assert document["standard_errors"]["friction.sigma1"]["after"] == made.after["friction.sigma1"]
    assert (place / "plan.txt").read_text() == format_design(made)
    assert "friction.sigma1" in format_design(made) and "10 %" in format_design(made)
    assert (place / "plan.html").stat().st_size > 10_000 and (place / "plan.png").exists()
    assert "friction.sigma1" in made._repr_html_() and made.plot().axes


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("voltag = [1, 2]", r'design: found the unknown key "voltag"; did you mean "voltage"\?'),
        ("voltage = [1]", r'key "voltage": found \[1\], expected the least and the greatest'),
        ('interval = "50 um"', r'key "interval": found the unit "um"'),
        ("kinds = []", r'key "kinds": found \[\], expected a list of names'),
        ("interval = ", r"option --limit: found 'interval = ', expected a line of TOML"),
        ("budget = { samples = 0 }", r'key "samples": found 0, expected a whole number above 0'),
    ],
)
def test_a_limit_that_is_wrong_is_named(source, line, message):
    with pytest.raises(InputError, match=message):
        read_design(source, [line])


def test_options_go_before_the_table(source):
    read = read_design(source, ['voltage = ["30 V", "40 V"]'], {"records": "3"})
    assert read.limits.voltage == (30.0, 40.0)
    assert (read.budget.records, read.budget.samples) == (3, 600)


def test_a_budget_that_is_missing_is_asked_for(tmp_path):
    (tmp_path / "rig.toml").write_text(SOURCE)
    with pytest.raises(InputError, match=r'the key "samples" is missing, expected .* --budget samples=2000'):
        read_design(tmp_path / "rig.toml")


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (Limits(kinds=("platfrm",)), 'kinds: found "platfrm"; did you mean "platform"'),
        (Limits(voltage=(50.0, 20.0)), "voltage: found 50 to 20, expected two ascending"),
        (Limits(interval=5.0), "interval: found 5 s in records of"),
        (Limits(kinds=("friction",), noise={"friction": 0.01}), 'the key "amplitude" is missing'),
        (Limits(kinds=("force",)), 'noise: found none of "force"'),
        (Limits(kinds=("force",), noise={"force": 1e-3}), 'found "force" in a study without "stop.stiffness"'),
        (Limits(rig={"effector.mas": (0.1,)}), 'rig: found the unknown parameter "effector.mas"'),
        (Limits(rig={"friction.sigma1": (0.1,)}), 'rig: found "friction.sigma1", which is free'),
        (Limits(waveforms=("sawtoth",)), 'waveforms: found "sawtoth"; did you mean "sawtooth"'),
        (Limits(noise={"effector": -1.0}), "noise: found -1 of"),
    ],
)
def test_limits_out_of_range_are_refused(source, limits, message):
    study = pdssjax.load_study(source, virtual=True)
    with pytest.raises(InputError, match=message):
        completed_limits(study, limits, {})


def test_what_limits_leave_out_the_records_tell(source):
    study = pdssjax.load_study(source, virtual=True)
    limits = completed_limits(study, Limits(), {"effector": 2.0})
    assert limits.voltage == (64.0, 64.0) and limits.frequency == (20.0, 20.0)
    assert limits.interval == 1e-4 and limits.noise["effector"] == pytest.approx(2e-8)
    kinds = {(e.kind, e.words.get("direction")) for e in possible_experiments(study, limits)}
    assert kinds == {("effector", "forward"), ("effector", "backward")}


def test_levels_of_a_rig_and_of_what_is_continuous_are_crossed(source):
    study = pdssjax.load_study(source, virtual=True)
    given = Limits(voltage=(20.0, 80.0), duty=(0.9, 1.0), rig={"effector.tilt": (0.0, 0.1)})
    found = possible_experiments(study, completed_limits(study, given, {}))
    assert len(found) == 4 * 2 * 2 * 2
    assert {e.rig[0][1] for e in found} == {0.0, 0.1}


def test_another_law_has_its_own_parameters(source):
    study = pdssjax.load_study(source, virtual=True)
    rival = with_law(study, "dahl")
    assert "friction.sigma1" not in rival.parameters and rival.parameters["piezo.gain"].number == 1e-7
    for law in ("dal", "simplified-lugre"):
        with pytest.raises(InputError, match=f'against: found "{law}"'):
            with_law(study, law)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--budget", "sample=3"], 'option --budget: found "sample=3", expected samples'),
        (["--budget", "samples=600", "records=2", "--criterion", "d", "--against", "dahl"], "expected one aim"),
        (["--budget", "samples=9", "records=2"], "found 9 samples for 2 records"),
        (["--parameter", "friction.sigma9"], 'parameter: found "friction.sigma9", which is not free'),
        (["--speed-at", "64 V"], "option --speed-at: found"),
        (["--estimate", "nowhere.json"], "there is no such file"),
    ],
)
def test_bad_options_are_one_line(source, capsys, tmp_path, arguments, message):
    assert main(["design", str(source), "--out", str(tmp_path / "out"), *arguments]) == 2
    said = capsys.readouterr().err.strip()
    assert message in said and said.count("\n") == 0
    assert not (tmp_path / "out" / "plan.json").exists()


def test_a_folder_without_a_plan_is_refused(tmp_path, capsys):
    assert main(["design", str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "found no plan.toml" in capsys.readouterr().err


def test_results_lead_to_the_study_that_they_are_of(source, tmp_path):
    estimate = tmp_path / "estimate.json"
    estimate.write_text(json.dumps({"format": "pdssjax-estimate/1", "provenance": {"study": str(source)}}))
    assert plan_folder(tmp_path) == (source, estimate)
    source.unlink()
    with pytest.raises(InputError, match=r"found no study at .*rig\.toml, expected the study file, with --estimate"):
        plan_folder(tmp_path)


def test_windows_are_read_in_their_order(source):
    pairs = (("0 s", "1 ms"), ("0.5 ms", "2 ms"))
    windows = ", ".join(f'{{ start = "{start}", end = "{end}", interval = "0.1 ms" }}' for start, end in pairs)
    text = source.read_text()
    table = text[text.index("sampling = ") :].splitlines()[0]
    source.write_text(text.replace(table, f"sampling = [{windows}]"))
    with pytest.raises(InputError, match=r'key "sampling": found a window from 0\.0005 s on after one up to 0\.001 s'):
        pdssjax.load_study(source, virtual=True)
    source.write_text(text.replace(table, "sampling = []"))
    with pytest.raises(InputError, match=r'key "sampling": found \[\], expected a table such as'):
        pdssjax.load_study(source, virtual=True)


def test_a_plan_with_an_open_record_says_what_it_needs(source):
    made = plan(source)
    needed = dataclasses.replace(made.records[0], contributes=float("inf"))
    assert "needed" in format_design(dataclasses.replace(made, records=(needed,)))
