"""A fit of a record whose sensor holds its output says so, and with what is new of it finds the truth."""

import numpy as np
import platform_study
import pytest
from record_tables import write_columns

import pdssjax

PARAMETERS = ("piezo.gain", "piezo.natural_frequency", "piezo.damping_ratio")


def test_held_samples_are_named_and_the_key_that_thins_them_mends_the_fit(tmp_path):
    text = platform_study.PLATFORM.replace('"friction.sigma0" = {}', '"friction.sigma0" = { value = 1e6 }')
    place = platform_study.write_platform(tmp_path, text)
    time, seen = np.loadtxt(tmp_path / "step.csv", delimiter=",", skiprows=1).T
    seen = seen[np.maximum((np.arange(seen.size) - 1) // 2 * 2 + 1, 0)]
    write_columns(tmp_path / "step.csv", "time_s,displacement_um", time, seen)
    held = pdssjax.identify(pdssjax.load_study(place))
    assert any(
        'in "step" a new sensor value only every 2 samples' in n and "write held = 2 in its" in n for n in held.notes
    )
    assert held.parameters["piezo.natural_frequency"].value < 0.98 * platform_study.RATE and not held.success
    place.write_text(text.replace('file = "step.csv"', 'file = "step.csv"\nheld = 2'))
    study = pdssjax.load_study(place)
    found = pdssjax.identify(study)
    assert study.records[0].time.size == time.size // 2 and found.success
    assert not any("a new sensor value only every" in note for note in found.notes)
    truths = platform_study.GAIN, platform_study.RATE, platform_study.DAMPING
    for path, truth in zip(PARAMETERS, truths, strict=True):
        told = found.parameters[path]
        assert told.value == pytest.approx(truth, abs=3.0 * told.standard_error)
