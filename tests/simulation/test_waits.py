"""A rest before the first motion and between two is not stepped, however long, and its derivatives are right."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import Actuator, Amplifier, Effector, simulate
from pdssjax.core import member
from pdssjax.drive.sampled import Sampled

VOLTS = np.array([0.0, 0.0, 60.0, 60.0, 0.0, 0.0])
"""Rest, a pulse with steep flanks, rest."""
INSTANTS = np.array([0.0, 0.0, 1e-4, 2e-3, 2.1e-3, 1.0])
TIMES = np.append(-1e-3, np.linspace(0.0, 8e-3, 20))
"""From the end of the wait on."""
RIGS = {
    "lugre": ("lugre", {}, False, False, 0.0, False),
    "dahl": ("dahl", {}, False, False, 0.0, False),
    "amplified": ("simplified-lugre", {}, False, True, 0.0, False),
    "felt by the stack": ("elastoplastic", {}, True, False, 0.0, False),
    "a load that sets in": ("simplified-lugre", {}, True, False, 0.05, False),
    "a load that was carried": ("generalized-maxwell-slip", {}, True, False, 0.05, True),
    "deflection": ("anisotropic-lugre", {"state": "deflection"}, False, False, 0.0, False),
    "force": ("anisotropic-lugre", {"state": "force"}, False, True, 0.0, False),
    "sticking": ("coulomb", {}, False, False, 0.0, False),
}
QUICK = ("a load that sets in",)
"""What the default tests look at: the others are compiled in slow ones."""


def compiled(rig):
    """Effector at `TIMES`, steps and failure as a function of (load, wait), and the derivative by the load."""
    law, words, feedback, amplified, load, rests = RIGS[rig]
    friction, amplifier = member("friction", law)(**words), Amplifier() if amplified else None

    def run(load, wait):
        actuator = Actuator(
            member("piezo", "second-order")(),
            friction,
            Effector(load=load),
            feedback,
            amplifier,
            rests_under_load=rests,
        )
        drive = Sampled(jnp.asarray(INSTANTS).at[1:].add(wait), jnp.asarray(VOLTS))
        found = simulate(actuator, drive, jnp.asarray(TIMES) + wait)
        return found.effector, (found.steps, found.failure)

    return load, jax.jit(lambda load, wait: jax.jvp(lambda load: run(load, wait), (load,), (1.0,), has_aux=True))


@pytest.mark.parametrize("rig", [pytest.param(rig, marks=() if rig in QUICK else pytest.mark.slow) for rig in RIGS])
def test_a_wait_takes_no_steps_and_changes_nothing(rig):
    load, run = compiled(rig)
    shown, _, (steps, failure) = run(load, 0.3)
    for wait in (20.0, 3600.0):
        later, _, (more, failed) = run(load, wait)
        assert int(failure) == int(failed) == 0
        assert int(more) <= int(steps) + 1
        np.testing.assert_allclose(later, shown, rtol=0.0, atol=1e-12)
    # A load is an elastic displacement at once: its derivative at zero is whole, too.
    step = 1e-6
    differences = (run(load + step, 20.0)[0] - run(load - step, 20.0)[0]) / (2.0 * step)
    assert np.abs(run(load, 20.0)[1] - differences).max() < 1e-5 * np.abs(differences).max()
