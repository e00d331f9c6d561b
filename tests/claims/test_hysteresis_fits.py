"""Stacks with creep or hysteresis are identified from platform records, without starts and without a contact."""

import json

import pytest

import pdssjax
from pdssjax import InputError
from pdssjax.cli.main import main

TRUTH = {
    "creep": {"creep": "0.022", "creep_time": '"80 ms"'},
    "bouc-wen": {"alpha": "0.22", "beta": '"0.05 1/V"', "gamma": '"0.02 1/V"'},
    "maxwell-slip": {
        **{f"share_{i}": share for i, share in enumerate(("0.1", "0.05", "0.06", "0.03"), start=1)},
        **{f"threshold_{i}": f'"{volts} V"' for i, volts in enumerate((3, 12, 20, 32), start=1)},
    },
}
LINEAR = {"gain": '"0.12 um/V"', "natural_frequency": '"5200 rad/s"', "damping_ratio": "0.25"}
RECORD = """
[[record]]
name = "{name}"
file = "{name}.csv"
columns = {{ time = "time_s", displacement = "y_um" }}
measures = "platform"
noise = "10 nm"
sampling = {{ start = "{start}", end = "{end}", interval = "{interval}" }}
drive = {{ waveform = {drive} }}
"""
STEPS = {
    "quick": dict(start="-1 ms", end="30 ms", interval="50 us", drive='"step", voltage = "60 V"'),
    "slow": dict(start="-10 ms", end="3 s", interval="1 ms", drive='"step", voltage = "60 V"'),
}
LOOPS = {
    f"loops_{volts}": dict(
        start="0 s",
        end=f"{2.25 / hertz} s",
        interval=f"{1 / hertz / 400} s",
        drive=f'"triangle", voltage = "{volts} V", frequency = "{hertz} Hz"',
    )
    for volts, hertz in ((80, 2), (40, 5), (20, 2))
}


def study(piezo, known):
    """A study file; with the truth `known` a plan, else without any start."""
    entries = LINEAR | TRUTH[piezo]
    listed = "\n".join(
        f'"piezo.{name}" = {f"{{ start = {value} }}" if known else "{}"}' for name, value in entries.items()
    )
    records = "".join(RECORD.format(name=name, **told) for name, told in (STEPS | LOOPS).items())
    head = 'format = "pdssjax-study/1"\n[actuator]\nfriction = "coulomb"\n'
    return f'{head}piezo = "{piezo}"\n[parameters]\n{listed}\n{records}'


@pytest.mark.slow
@pytest.mark.parametrize("piezo", TRUTH)
def test_a_stack_with_memory_is_identified_from_no_starts(tmp_path, piezo):
    (tmp_path / "study.toml").write_text(study(piezo, known=True))
    assert main(["record", str(tmp_path / "study.toml"), "--out", str(tmp_path / "made"), "--seed", "1"]) == 0
    records = tmp_path / "made" / "records"
    (records / "blind.toml").write_text(study(piezo, known=False))
    assert main(["identify", str(records / "blind.toml"), "--out", str(tmp_path / "found")]) == 0
    found = json.loads((tmp_path / "found" / "estimate.json").read_text())
    truth = json.loads((records / "truth.json").read_text())["parameters"]
    assert found["statistics"]["reduced_chi2"] == pytest.approx(1.0, abs=0.07)
    for path, told in truth.items():
        fitted = found["parameters"][path]
        assert abs(fitted["value"] - told["value"]) < 4.0 * fitted["standard_error"], path
        assert fitted["standard_error"] < 0.1 * abs(told["value"]), path


def test_a_study_of_the_platform_alone_needs_no_parameters_of_the_contact(tmp_path):
    (tmp_path / "study.toml").write_text(study("bouc-wen", known=True))
    loaded = pdssjax.load_study(tmp_path / "study.toml", virtual=True)
    assert {path.partition(".")[0] for path in loaded.parameters} == {"piezo"}
    walks = study("bouc-wen", known=True).replace('measures = "platform"', 'measures = "effector"')
    (tmp_path / "study.toml").write_text(walks)
    with pytest.raises(InputError, match=r"friction\.f_c"):
        pdssjax.load_study(tmp_path / "study.toml", virtual=True)


DRIVEN_BEFORE = """\
format = "pdssjax-study/1"
[actuator]
piezo = {{ dynamics = "static", hysteresis = {{ law = "play", elements = 3 }} }}
[parameters]
"piezo.gain" = {{ {gain} }}
"piezo.play_1" = {{ {play} }}
"piezo.play_2" = {{ {play} }}
"piezo.play_3" = {{ {play} }}
"piezo.play_range" = {{ value = "12 V" }}
"piezo.initial_peak" = {{ {peak} }}
"""


@pytest.mark.slow
@pytest.mark.parametrize(("peak", "told"), [(7.0, True), (15.0, True), (22.0, False)])
def test_how_far_a_stack_had_been_driven_before_its_record_is_found_or_said_not_to_show(tmp_path, peak, told):
    """From 20 V on no element slips in a loop up to 20 V: then it is not in the record."""
    loop = dict(start="0 s", end="0.5 s", interval="1 ms", drive='"triangle", voltage = "20 V", frequency = "4 Hz"')
    known = dict(gain='start = "0.1 um/V"', play='start = "0.008 um/V"', peak=f'start = "{peak} V"')
    (tmp_path / "study.toml").write_text(DRIVEN_BEFORE.format(**known) + RECORD.format(name="loop", **loop))
    assert main(["record", str(tmp_path / "study.toml"), "--out", str(tmp_path / "made"), "--seed", "1"]) == 0
    made = tmp_path / "made" / "records" / "study.toml"
    begin = made.read_text().index("[[record]]")
    made.write_text(DRIVEN_BEFORE.format(gain="", play="", peak="") + made.read_text()[begin:])
    estimate = pdssjax.identify(pdssjax.load_study(made))
    assert estimate.success
    found = estimate.parameters["piezo.initial_peak"]
    assert found.identifiable == told
    if told:
        assert found.standard_error < 0.1 * peak
        assert abs(found.value - peak) < 3.5 * found.standard_error
    else:
        assert any("say nothing about piezo.initial_peak" in note for note in estimate.notes)
