"""A record that would be stepped until the memory is full is questioned; one that needs no steps is not."""

import warnings

import numpy as np
import pytest
from record_tables import loaded, write_columns

import pdssjax
from pdssjax import InputWarning, pose_problem
from pdssjax.inference.search.multistart import warn_of_memory_use

STUDY = """\
format = "pdssjax-study/1"
title = "Loops"

[actuator]
piezo = {{ dynamics = "first-order", hysteresis = {{ law = "{law}" }}, creep = {{ elements = 2 }} }}

[parameters]
{parameters}

[[record]]
name = "sine"
file = "sine.csv"
columns = {{ time = "time_s", displacement = "y_um" }}
measures = "platform"
noise = "1 nm"
drive = {{ waveform = "sine", voltage = "80 V", frequency = "1 Hz" }}
"""


LAWS = {"play": ["play_*", "play_range"], "bouc-wen": ["hysteresis", "beta", "gamma"]}


def questioned(folder, law, seconds):
    times = np.arange(0.0, seconds, 0.1)
    write_columns(folder / "sine.csv", "time_s,y_um", times, 4.0 - 4.0 * np.cos(2 * np.pi * times), digits="%.4f")
    names = ["gain", "time_constant", "creep_*", "creep_time", *LAWS[law]]
    parameters = "\n".join(f'"piezo.{name}" = {{}}' for name in names)
    study = loaded(folder, STUDY.format(law=law, parameters=parameters))
    warn_of_memory_use(pose_problem(study)[0], pdssjax.initial_guess(study))


def test_a_long_record_that_is_stepped_is_questioned(tmp_path):
    told = r'record "sine": integrating its 99.9 s \(up to 6\d{5} steps\) with derivatives takes about 7\.\d GB'
    with pytest.warns(InputWarning, match=told):
        questioned(tmp_path, "bouc-wen", 100.0)


@pytest.mark.parametrize(("law", "seconds"), [("bouc-wen", 10.0), ("play", 100.0)])
def test_short_ones_and_those_in_closed_form_are_not(tmp_path, law, seconds):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        questioned(tmp_path, law, seconds)
