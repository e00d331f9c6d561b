"""The table and the figure of the map of rightness: what is counted, and what is named."""

import numpy as np

from experiments import map_of_rightness
from experiments.common import BLUE, ORANGE, VERMILION
from experiments.derivative_judge import Verdict
from experiments.random_actuators import STRUCTURES

RIGHT = Verdict("piezo.gain", 2e-6, 0.5, None, None, 0, 1e-13, 1e-12, "")
WRONG = RIGHT._replace(error=3e-3, discontinuity=1e-5, tight=2e-6, above=1)
CLIFF = RIGHT._replace(error=0.5, discontinuity=0.4, tight=0.5, value=1e-7)
FAILED = RIGHT._replace(error=np.nan, value=np.nan, reverse=np.nan, failure="usual")
FOUND = {"lugre": [RIGHT] * 3, "stop": [RIGHT, WRONG, CLIFF, FAILED, RIGHT._replace(reverse=1e-6, value=1e-3)]}


def test_rows_count_what_is_wrong_and_leave_out_what_a_cliff_explains():
    assert map_of_rightness.row("lugre", FOUND["lugre"])[1:] == ["3", "0", "0", "0", "2e-06", "1e-13 m", "1e-12"]
    assert map_of_rightness.row("stop", FOUND["stop"])[1:] == ["5", "1", "1", "1", "3e-03", "1e-03 N", "1e-06"]
    assert map_of_rightness.row("lugre", [FAILED])[1:6] == ["1", "0", "0", "1", "nan"]


def test_every_actuator_that_is_not_as_asked_is_named():
    text = map_of_rightness.table(FOUND)
    assert text.startswith("## 8 random actuators of 2 structures")
    named = [line for line in text.splitlines() if line.startswith("- ")]
    assert [line.split(":")[0] for line in named] == [f"- stop {number}" for number in (1, 2, 3, 4)]
    assert "1 above" in named[0] and "at a cliff" in named[1] and "value" not in named[1]
    assert "did not finish" in named[2] and "value off by 1.0e-03; forward less reverse 1.0e-06" in named[3]


def test_the_figure_has_every_actuator_that_finished():
    (axes,) = map_of_rightness.draw(FOUND).axes
    places = {colour: [] for colour in (BLUE, ORANGE, VERMILION)}
    for line in axes.lines:
        if line.get_color() in places:
            places[line.get_color()] += list(line.get_xdata())
    assert [len(places[colour]) for colour in (BLUE, ORANGE, VERMILION)] == [5, 1, 1]
    assert places[VERMILION] == [3e-3] and places[ORANGE] == [0.5]


def test_verdicts_are_kept_and_read_again(tmp_path, monkeypatch):
    monkeypatch.setattr(map_of_rightness, "OUT", tmp_path)
    seen = []

    def drawn(judge, number):
        seen.append((judge.structure, number))
        return RIGHT._replace(error=1e-6 * number)._asdict()

    monkeypatch.setattr(map_of_rightness, "drawn", drawn)
    monkeypatch.setattr(map_of_rightness.jax, "clear_caches", lambda: None)
    first = map_of_rightness.verdicts("under a sampled, held", 3)
    again = map_of_rightness.verdicts("under a sampled, held", 4)
    assert again[:3] == first and [number for _, number in sorted(seen, key=lambda each: each[1])] == [0, 1, 2, 3]
    assert all(structure is STRUCTURES["under a sampled, held"] for structure, _ in seen)
