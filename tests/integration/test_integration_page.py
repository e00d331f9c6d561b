"""The code of docs/integration.md, run from top to bottom, gives what the page says."""

import re
from pathlib import Path

import numpy as np
import pytest

import pdssjax

PAGE = Path(__file__).parents[2] / "docs/integration.md"


@pytest.mark.slow
def test_the_page_gives_what_it_says():
    given = {}
    for block in re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.S):
        exec(block, given)
        if "Room(" in block:
            assert set(np.asarray(given["solution"].modes).tolist()) == {0, 1}
            assert np.asarray(given["solution"].ys).max() <= 22.0 + 1e-9
        elif "Ball(" in block:
            np.testing.assert_allclose(given["solution"].events.ts[:3], [0.404, 0.969, 1.365], atol=5e-4)
    np.testing.assert_allclose(given["slopes"], [0.14, -126.0, -12.7, -3.5], rtol=0.02)
    motion, times = given["motion"], np.linspace(0.0, 0.02, 21)
    system = given["system"]
    usual = pdssjax.simulate(system.actuator, system.drive, times)
    np.testing.assert_allclose(motion.ys.d, usual.platform - usual.effector, rtol=0.0, atol=1e-12)
    assert int(motion.events.count) > 2
