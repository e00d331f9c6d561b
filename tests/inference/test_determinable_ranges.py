"""Times of creep stay between what samples and records tell, unless a study says otherwise, and a note says so."""

import numpy as np
import pytest
from record_tables import loaded, write_columns

import pdssjax
from pdssjax import pose_problem
from pdssjax.inference.notes.of_fit import about_bounds
from pdssjax.inference.problem import determinable_ranges
from pdssjax.piezo.base import Shown
from pdssjax.piezo.composed import Composed

INTERVAL, DURATION = 5e-3, 1.5
STUDY = """\
format = "pdssjax-study/1"
[actuator]
piezo = {{ dynamics = "static", hysteresis = {{ law = "none" }}, creep = {{ elements = {elements} }} }}
[parameters]
"piezo.gain" = {{}}
"piezo.creep_*" = {{}}
"piezo.creep_time" = {{ {given} }}
[[record]]
name = "steps"
file = "steps.csv"
columns = {{ time = "time_s", displacement = "y_um" }}
measures = "platform"
drive = {{ waveform = "sampled", column = "u_V" }}
"""


def study(folder, elements=2, given=""):
    time = INTERVAL * np.arange(301)
    volts = np.where(time > 0.1, 50.0, 0.0)
    write_columns(folder / "steps.csv", "time_s,u_V,y_um", time, volts, 0.1 * volts, digits="%.9f")
    return loaded(folder, STUDY.format(elements=elements, given=given))


@pytest.mark.parametrize("elements", [1, 2, 3, 6])
@pytest.mark.parametrize("interval, duration", [(1e-3, 8.0), (5e-3, 1.5), (1e-5, 400.0), (0.1, 2.0)])
def test_the_fastest_and_the_slowest_element_are_told_by_the_record(elements, interval, duration):
    stack = Composed.variant(f"static+creep-{elements}")
    (told,) = stack.determinable_ranges(Shown(interval=interval, duration=duration)).values()
    assert told.low == pytest.approx(10.0 * interval)
    slowest = told.high * 10.0 ** (elements - 1)
    # Where a record spans fewer decades than the elements do, the fastest may be told all the same.
    assert slowest == pytest.approx(3.0 * duration) or told.high == pytest.approx(3.0 * told.low)
    assert not Composed.variant("static+play-2").determinable_ranges(Shown(interval=interval, duration=duration))
    assert not stack.determinable_ranges(Shown())


@pytest.mark.parametrize("law, path", [("play", "play_range"), ("maxwell-slip", "stop_range")])
def test_elements_of_hysteresis_do_not_slip_within_the_flicker_of_a_voltage(law, path):
    told = Composed.variant(f"static+{law}-4").determinable_ranges(Shown(swing=60.0))
    assert {name: (within.low, within.high) for name, within in told.items()} == {path: (3.0, 240.0)}
    assert not Composed.variant("static+bouc-wen").determinable_ranges(Shown(swing=60.0))


@pytest.mark.parametrize(
    "elements, given, low, high",
    [
        (1, "", 10 * INTERVAL, 3 * DURATION),
        (2, "", 10 * INTERVAL, 0.3 * DURATION),
        (2, 'min = "1 ms"', 1e-3, 0.3 * DURATION),
        (2, 'max = "1000 s"', 10 * INTERVAL, 1e3),
        (2, 'start = "2 s"', 10 * INTERVAL, 2.0),
        (2, 'start = "1 ms"', 1e-3, 0.3 * DURATION),
    ],
)
def test_a_fit_stays_within_unless_the_study_says_otherwise(tmp_path, elements, given, low, high):
    problem, start = pose_problem(study(tmp_path, elements, given))
    place = problem.residual.transform.paths.index("piezo.creep_time")
    np.testing.assert_allclose(np.exp([end[place] for end in problem.bounds]), [low, high])
    assert problem.bounds[0][place] <= start[place] <= problem.bounds[1][place]


def test_what_is_held_has_no_range(tmp_path):
    assert not determinable_ranges(study(tmp_path, given='value = "1000 s"'))
    assert set(determinable_ranges(study(tmp_path))) == {"piezo.creep_time"}


@pytest.mark.parametrize(
    "side, words, key",
    [(0, "10 sample intervals", "min"), (1, "3 times the length of the longest record for element 2", "max")],
)
def test_a_note_says_what_the_records_do_not_tell(tmp_path, side, words, key):
    loaded = study(tmp_path)
    problem, start = pose_problem(loaded)
    scale, free = problem.residual.transform, start.copy()
    place = scale.paths.index("piezo.creep_time")
    free[place] = problem.bounds[side][place]
    values = {path: float(number) for path, number in problem.decode(free).items()}
    found = {
        path: pdssjax.study.FittedParameter(path, v, 0.0, (v, v), "s", True, v, False, True)
        for path, v in values.items()
    }
    (note,) = about_bounds(loaded.parameters, free, scale, found, determinable_ranges(loaded))
    assert words in note and f"{key} in the study" in note and note.startswith("piezo.creep_time is at its")
