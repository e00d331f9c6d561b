"""Derivatives are right: with feedback, load, fall time, stuck intervals, by any parameter, in both modes."""

import numpy as np
import pytest
from marks import slow
from rigs import NAMES, SAMPLES, jacobian, trajectory, values, varied

from pdssjax import Accuracy
from pdssjax.integration import TIGHT
from tests.reference.independent import Rig

TIMES = 0.00031 + np.arange(SAMPLES) * 0.005
PARAMETERS = NAMES[:-1]  # all but the direction
SIZES = dict(zip(NAMES, values(Rig(load=0.1, fall=1e-3)), strict=True))
"""What counts as a change of size 1 of each parameter."""

RIGS = {
    "forward": Rig(),
    "backward, fall time": Rig(forward=False, fall=9e-4),
    "downhill, sticks, fall time": Rig(load=-0.07, fall=9e-4),
    "downhill, backward, sticks": Rig(load=-0.1, forward=False),
    "force, feedback": Rig(reading="force", feedback=True, fall=9e-4),
    "force, feedback, uphill, backward": Rig(reading="force", feedback=True, load=0.1, forward=False, fall=1e-3),
}


QUICK = "forward", "downhill, sticks, fall time"


def differences(rig: Rig, name: str, step: float = 3e-5) -> np.ndarray:
    """d(platform, effector)/d(name) by central differences of the tight integrator, to fourth order."""

    def motion(change):
        run = trajectory(varied(rig, name, change * SIZES[name]), TIMES, TIGHT)
        assert int(run.failure) == 0
        return np.stack([run.platform, run.effector])

    def slope(step):
        if name == "fall" and rig.fall == 0.0:  # at the end of its range: forwards only, to second order
            return (-3.0 * motion(0.0) + 4.0 * motion(step) - motion(2.0 * step)) / (2.0 * step)
        return (motion(step) - motion(-step)) / (2.0 * step)

    return (4.0 * slope(step) - slope(2.0 * step)) / 3.0


@pytest.mark.parametrize("name", [name if name in QUICK else slow(name) for name in RIGS])
def test_every_parameter_against_differences(name):
    rig = RIGS[name]
    default, tight = jacobian(rig, TIMES, Accuracy()), jacobian(rig, TIMES, TIGHT)
    for column, parameter in enumerate(PARAMETERS):
        if parameter == "stack" and not rig.feedback:
            assert not default[:, :, column].any()
            continue
        if parameter == "load" and rig.load == 0.0 and rig.reading == "deflection":
            continue  # none there: on one side the contact comes to rest stuck, on the other on a limit cycle
        expected = differences(rig, parameter)
        size = np.linalg.norm(expected)
        assert np.linalg.norm(tight[:, :, column] * SIZES[parameter] - expected) < 1e-4 * size, parameter
        assert np.linalg.norm(default[:, :, column] * SIZES[parameter] - expected) < 2e-3 * size, parameter
