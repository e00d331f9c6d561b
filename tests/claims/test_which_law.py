"""The experiment on which law a rig's record supports, in small."""

import pytest
from compared_laws import Here

from experiments import which_law

pytestmark = pytest.mark.slow  # LuGre's law in an actuator is compiled, twice


def test_a_made_up_record_has_its_noise_and_its_contact_free():
    study = which_law.measured("lugre", 1, 2e-3)
    (record,) = study.records
    assert record.time.size == 100 and record.noise == which_law.NOISE
    free = {path for path, parameter in study.parameters.items() if parameter.free}
    assert free == {f"friction.{name}" for name in which_law.CONTACTS["lugre"]}


def test_dense_samples_tell_a_law_with_damping_from_coulombs():
    found = which_law.answered("lugre", 2, 5e-4, ["coulomb"], Here())
    assert found["coulomb"].is_worse and found.chosen == "lugre"
    assert which_law.row("lugre", 2, 5e-4, found).ours == "lugre"
