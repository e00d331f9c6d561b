"""Trajectories and Jacobians of the thesis's actuator agree with a stored reference in all four cases."""

import json
from pathlib import Path

import numpy as np
import pytest
from rigs import NAMES, jacobian, trajectory, values, varied

from pdssjax import Accuracy
from pdssjax.integration import TIGHT
from tests.reference.independent import Rig, simulate

# By default `test_independent` has both states, `test_sensitivities` derivatives, and `tests/study/test_prediction.py`
# a trajectory of the stored reference.
pytestmark = pytest.mark.slow
REFERENCE = json.loads((Path(__file__).parents[1] / "data" / "sawtooth.json").read_text())
TIMES = np.array(REFERENCE["times_s"])
COLUMNS = [
    NAMES.index(name.split(".")[1].replace("natural_", "").replace("_ratio", "").replace("sigma", "s"))
    for name in REFERENCE["parameters"]
]
label = lambda case: f"{case['state']}-{case['direction']}"
CASES = pytest.mark.parametrize("case", REFERENCE["cases"], ids=label)


def rig(case: dict) -> Rig:
    return Rig(reading=case["state"], forward=case["direction"] == "forward")


# The reference cuts the end of each ring-down at about 3e-6 um; that is all that is left at tight tolerances, where
# the package agrees with `independent.simulate` to 1e-7 um (below), which cuts nothing.
@CASES
@pytest.mark.parametrize(("accuracy", "micrometres"), [(Accuracy(), 1e-3), (TIGHT, 1e-5)], ids=["default", "tight"])
def test_trajectories(case, accuracy, micrometres):
    run = trajectory(rig(case), TIMES, accuracy)
    assert int(run.failure) == 0
    np.testing.assert_allclose(run.effector * 1e6, case["effector_um"], rtol=0.0, atol=micrometres)


@CASES
@pytest.mark.parametrize(("accuracy", "relative"), [(Accuracy(), 1e-3), (TIGHT, 3e-5)], ids=["default", "tight"])
def test_jacobians(case, accuracy, relative):
    expected = np.array(case["jacobian"])
    actual = (jacobian(rig(case), TIMES, accuracy)[1] * values(rig(case)))[:, COLUMNS] * 1e6
    error = np.linalg.norm(actual - expected, axis=0) / np.linalg.norm(expected, axis=0)
    assert error.max() < relative


@pytest.mark.parametrize("name", [NAMES[column] for column in COLUMNS])
def test_tight_jacobians_are_those_of_the_independent_simulator(name):
    begin = rig(REFERENCE["cases"][0])
    column = NAMES.index(name)
    size = values(begin)[column]

    def slope(step):
        ahead, behind = (simulate(varied(begin, name, s * step * size), TIMES)[:, 1] for s in (1.0, -1.0))
        return (ahead - behind) / (2.0 * step * size)

    expected = (4.0 * slope(1e-4) - slope(2e-4)) / 3.0
    actual = jacobian(begin, TIMES, TIGHT)[1][:, column]
    assert np.linalg.norm(actual - expected) < 1e-6 * np.linalg.norm(expected)
