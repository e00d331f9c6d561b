"""Derivatives and values are right for actuators drawn at random, of every structure: a map of rightness.

Required at the default accuracy: values within 1e-4 um (1e-4 N) of the tight solution; every column that the record
shows within 1e-3 of central differences, or a discontinuity that the differences show, too; forward and
reverse mode alike.  The quick version has few seeds and the structures in which something was found wrong.
"""

from functools import cache

import numpy as np
import pytest
from random_rigs import ALL, Judge

QUICK = {"anisotropic, deflection, backward, 5 Hz": 6}
MANY = 40

judge = cache(lambda name: Judge(ALL[name]))


def check(name: str, seeds: range, reverse: int) -> None:
    """The first `reverse` of the seeds in reverse mode, too."""
    structure = ALL[name]
    tolerance = 1e-4 if structure.shows == "friction" or "stop" in structure.parts else 1e-10
    wrong = []
    for seed in seeds:
        verdict = judge(name).verdict(structure.draw(np.random.default_rng(seed)), reverse=seed < reverse)
        off = verdict.error > 1e-3 and verdict.error > 2.0 * verdict.discontinuity
        if off or not verdict.finished or verdict.value > tolerance or verdict.reverse > 1e-8:
            wrong.append((seed, verdict))
    assert not wrong


@pytest.mark.parametrize("name", QUICK)
def test_some_actuators(name):
    # Reverse mode is another compilation; `tests/integration/test_system.py` has it.
    check(name, range(QUICK[name]), reverse=0)


@pytest.mark.slow
@pytest.mark.parametrize("name", ALL)
def test_many_actuators(name):
    check(name, range(MANY), reverse=3)
