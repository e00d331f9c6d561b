"""What the samples of a record suggest, where the motion misleads."""

import numpy as np
import pytest

from pdssjax.metrics import guess_record


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("direction", ["forward", "backward"])
def test_an_end_effector_that_fast_flanks_throw_on_is_not_turned(direction: str, sign: float) -> None:
    """It rides 9 um up with the voltage, then a platform that rings throws it 7 um further, or as far with its fall."""
    time = np.arange(-0.01, 1.0, 1e-3)
    cycle, part = np.divmod(time / 0.1, 1.0)
    volts = np.where(time < 0, 0.0, 60.0 * (part if direction == "forward" else 1.0 - part))
    way = 1.0 if direction == "forward" else -1.0
    motion = np.where(time < 0, 0.0, way * (9e-6 * part + 16e-6 * cycle))
    noise = np.random.default_rng(0).normal(0.0, 5e-9, time.size)
    guess = guess_record(time, sign * motion + noise, volts, measures="effector")
    assert guess.waveform.direction == direction
    assert guess.turned == (sign < 0)
    np.testing.assert_allclose(guess.motion, motion + sign * noise, atol=1e-12)
