"""A rig that lifts its load is identified from records of an independent simulator that begins at rest under it."""

import dataclasses

import numpy as np
import pytest
from record_tables import COLUMNS, record_table

import pdssjax
from tests.reference.independent import Rig, simulate

NOISE = 0.0105
"""Of the sensor [um]."""
RIG = Rig(reading="force", feedback=True, stack=0.5, load=-0.25, fall=3e-4, cycle=0.1, rests_under_load=True)
TRUTH = {
    "piezo.gain": RIG.gain,
    "piezo.natural_frequency": RIG.frequency,
    "piezo.damping_ratio": RIG.damping,
    "friction.sigma0_a": RIG.s0[0],
    "friction.sigma0_b": RIG.s0[1],
    "friction.sigma1_a": RIG.s1[0],
    "friction.sigma1_b": RIG.s1[1],
    "friction.f_ss_a": RIG.f_ss[0],
    "friction.f_ss_b": RIG.f_ss[1],
}
HEAD = """\
format = "pdssjax-study/1"
title = "A rig that lifts"

[actuator]
piezo = "second-order"
friction = "anisotropic-lugre"
friction_state = "force"
feedback = true
rests_under_load = {rests}

[parameters]
"effector.mass" = {{ value = "86 g" }}
"effector.load" = {{ value = "-0.25 N" }}
"piezo.mass" = {{ value = 0.5 }}
"drive.fall_time" = {{ value = "0.3 ms" }}
"""
DRIVE = 'drive = {{ waveform = "sawtooth", direction = "{}", voltage = "64 V", frequency = "10 Hz" }}'


def study(folder, rests: bool) -> pdssjax.Study:
    random = np.random.default_rng(11)
    text = HEAD.format(rests=str(rests).lower()) + "".join(f'"{path}" = {{}}\n' for path in TRUTH)
    walk, fine = np.arange(1, 1500) * 2e-4, np.arange(1, 2100) * 5e-5
    for name, of, direction, times in (
        ("forward", "effector", "forward", walk),
        ("backward", "effector", "backward", walk),
        ("platform", "platform", "backward", fine),
    ):
        rig = dataclasses.replace(RIG, forward=direction == "forward")
        moved = 1e6 * simulate(rig, times)[:, int(of == "effector")]
        rows = np.stack([times, moved + NOISE * random.normal(size=times.size)], 1)
        header = ",".join(COLUMNS.values())
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header=header, comments="", fmt="%.7f")
        text += record_table(name, of, f'noise = "{NOISE} um"', DRIVE.format(direction))
    (folder / "study.toml").write_text(text)
    return pdssjax.load_study(folder / "study.toml")


@pytest.mark.slow
def test_it_is_identified_without_starts(tmp_path):
    found = pdssjax.identify(study(tmp_path, rests=True))
    assert found.converged and found.statistics.reduced_chi2 == pytest.approx(1.0, abs=0.06)
    for path, number in TRUTH.items():
        parameter = found.parameters[path]
        assert abs(parameter.value - number) < 3.0 * parameter.standard_error, path


@pytest.mark.slow
def test_a_load_that_is_said_to_set_in_at_the_begin_is_no_success(tmp_path):
    found = pdssjax.identify(study(tmp_path, rests=False))
    assert not found.explained and any("does not explain all" in note for note in found.notes)
