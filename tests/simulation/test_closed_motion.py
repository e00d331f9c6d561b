"""A prescribed motion under a law that slides in closed form: the same as stepped, in value and in derivative."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow

from pdssjax import Accuracy
from pdssjax.core import member, members, quantities
from pdssjax.simulation import FRICTION_FORCE, PrescribedMotion, sensor_samples

TIMES = np.linspace(0.0, 1.0, 81)
MOTION = 2e-6 * np.interp(TIMES, [0.0, 0.21, 0.4, 0.45, 1.0], [0.0, 1.0, -1.0, -1.0, 0.5])
"""A triangle with a rest."""
CLOSED = [name for name in members("friction") if member("friction", name).slides_in_closed_form()]
QUICK = ("coulomb", "reset-integrator")


def shown(name, segments):
    """Force at `TIMES` and its derivative by a factor of the first parameter; stepped where `segments` is None."""
    kind = member("friction", name)
    field = next(iter(quantities(kind)))

    def run(by):
        law = kind(**{field: by * getattr(kind(), field)})
        system = PrescribedMotion(law, jnp.asarray(TIMES), jnp.asarray(MOTION))
        return sensor_samples(system, jnp.asarray(TIMES), Accuracy(), FRICTION_FORCE, segments)

    return jax.jit(lambda by: jax.jvp(run, (by,), (1.0,)))


@pytest.mark.parametrize("name", [n if n in QUICK else slow(n) for n in CLOSED])
def test_it_is_what_steps_lead_to(name):
    (closed, slope), (stepped, expected) = shown(name, TIMES.size)(1.01), shown(name, None)(1.01)
    np.testing.assert_allclose(closed, stepped, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(slope, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
