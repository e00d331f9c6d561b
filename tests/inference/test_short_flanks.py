"""A flank whose length is free is no shorter than 1 ns where hysteresis or a slew limit stands behind it."""

import numpy as np
import pytest
from record_tables import loaded, write_columns

import pdssjax
from pdssjax import Accuracy, Taylor
from pdssjax.inference.problem import SHORTEST

STUDY = """\
format = "pdssjax-study/1"
title = "Falls"

[actuator]
piezo = {piezo}

[parameters]
"piezo.gain" = {{ start = 8e-8 }}
{more}
"drive.fall_time" = {{ start = 0 }}

[[record]]
name = "falls"
file = "falls.csv"
columns = {{ time = "time_s", displacement = "y_um" }}
measures = "platform"
noise = "1 nm"
drive = {{ waveform = "sawtooth", voltage = "60 V", frequency = "100 Hz", direction = "forward" }}
"""
HYSTERETIC = '{ dynamics = "static", hysteresis = { law = "play", elements = 1 } }'
LINEAR = '"piezo.natural_frequency" = { value = 6000 }\n"piezo.damping_ratio" = { value = 0.2 }'
PLAY = '"piezo.play_*" = { value = 1e-8 }\n"piezo.play_range" = { value = 25 }'


def posed(folder, piezo, more):
    times = 2.03e-4 * np.arange(1, 120)
    write_columns(folder / "falls.csv", "time_s,y_um", times, np.sin(times))
    return pdssjax.pose_problem(loaded(folder, STUDY.format(piezo=piezo, more=more)), Accuracy(method=Taylor(6)))


def test_a_jump_behind_play_begins_as_a_short_flank_with_the_right_derivative(tmp_path):
    problem, start = posed(tmp_path, HYSTERETIC, PLAY)
    assert float(problem.decode(start)["drive.fall_time"]) == pytest.approx(SHORTEST)
    place = problem.residual.transform.paths.index("drive.fall_time")
    column = np.asarray(problem.jacobian(start))[:, place]
    step = 1e-7 / problem.residual.transform.unit[place] * (np.arange(start.size) == place)
    ends = [np.asarray(problem.whitened(start + k * step)) for k in (0, 1, 2)]
    difference = (-3.0 * ends[0] + 4.0 * ends[1] - ends[2]) / (2.0 * step[place])
    np.testing.assert_allclose(column, difference, rtol=0.0, atol=2e-3 * np.abs(difference).max())


def test_a_jump_in_front_of_what_is_linear_stays_one(tmp_path):
    problem, start = posed(tmp_path, '"second-order"', LINEAR)
    assert float(problem.decode(start)["drive.fall_time"]) == 0.0
