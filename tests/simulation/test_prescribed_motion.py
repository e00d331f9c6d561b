"""The contact under a prescribed motion: its force against closed forms, and stepped as in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow
from parts import Coulomb, Dahl, GeneralizedMaxwellSlip, SimplifiedLuGre

from pdssjax import Accuracy, Taylor
from pdssjax.core import member, members, quantities
from pdssjax.simulation import FRICTION_FORCE, PrescribedMotion, sensor_samples

QUICK = Accuracy(method=Taylor(8))
TIMES = np.linspace(0.0, 1.0, 401)
MOTION = 2e-6 * np.interp(TIMES, [0.0, 0.2, 0.6, 1.0], [0.0, 1.0, -1.0, 0.5])
"""A triangle: up, down, up."""


@jax.jit
def _force(law, times, motion):
    return sensor_samples(PrescribedMotion(law, times, motion), times, QUICK, FRICTION_FORCE)


def force(law, times=TIMES, motion=MOTION) -> np.ndarray:
    """Of a law along a motion, compiled once for all laws of a kind."""
    return np.asarray(_force(law, times, motion))


def dahl_by_hand(stiffness: float, level: float) -> np.ndarray:
    """F(x) of Dahl's law with exponent 1: exponential in the distance on each branch."""
    out, now = [0.0], 0.0
    for way in np.diff(MOTION):
        sign = np.sign(way)
        now = sign * level + (now - sign * level) * np.exp(-stiffness * abs(way) / level)
        out.append(now)
    return np.array(out)


UNDAMPED = SimplifiedLuGre(sigma1=0.0)
"""The same as Dahl's law with the exponent 1, and compiled in a fifth of the time."""
of_dahl = pytest.mark.parametrize(
    "law", [pytest.param(Dahl(), id="dahl", marks=pytest.mark.slow), pytest.param(UNDAMPED, id="simplified-lugre")]
)


@of_dahl
def test_dahl_follows_its_exponentials(law):
    level = law.f_c if isinstance(law, Dahl) else law.f_ss
    np.testing.assert_allclose(force(law), dahl_by_hand(law.sigma0, level), atol=1e-9)


@of_dahl
def test_the_force_does_not_depend_on_the_pace_without_damping(law):
    np.testing.assert_allclose(force(law, times=3.0 * TIMES), force(law), atol=1e-9)


def test_coulomb_friction_has_the_sign_of_the_motion_and_none_at_rest():
    motion = np.interp(TIMES, [0.0, 0.3, 0.6, 1.0], [0.0, 1e-6, 1e-6, 0.0])
    shown = force(Coulomb(), motion=motion)
    np.testing.assert_allclose(shown[10:110], Coulomb().f_c)
    np.testing.assert_allclose(shown[130:230], 0.0)
    np.testing.assert_allclose(shown[250:-1], -Coulomb().f_c)


@pytest.mark.parametrize("field", ["sigma0", *(pytest.param(f, marks=pytest.mark.slow) for f in ("sigma1", "f_ss"))])
def test_the_force_can_be_differentiated(field):
    law = SimplifiedLuGre(sigma1=2e3)
    value = getattr(law, field)

    @jax.jit
    def run(x):
        """The force and its derivative by the field."""
        shown = lambda x: _force(SimplifiedLuGre(**{"sigma1": 2e3, field: x}), TIMES, MOTION)
        return jax.jvp(shown, (x,), (jnp.ones(()),))

    step = 1e-5 * value
    differences = (np.asarray(run(value + step)[0]) - np.asarray(run(value - step)[0])) / (2 * step)
    assert np.abs(run(value)[1] - differences).max() < 1e-5 * np.abs(differences).max()


@pytest.mark.slow
def test_elements_that_slip_at_their_limit_have_finite_and_right_derivatives():
    # Without weakening an element that slips stays at its limit exactly: its coefficients vanish, its decay does not.
    def run(strength):
        law = GeneralizedMaxwellSlip(weakened=1.0, strength_1=strength)
        contact = PrescribedMotion(law, jnp.asarray(TIMES), jnp.asarray(MOTION))
        return sensor_samples(contact, jnp.asarray(TIMES), Accuracy(), FRICTION_FORCE)

    # Not quite the nominal strength: there elements let go exactly at a sample, where the derivative jumps.
    compiled, strength, step = jax.jit(run), 1.0371 * GeneralizedMaxwellSlip().strength_1, 1e-7
    differences = (np.asarray(compiled(strength + step)) - np.asarray(compiled(strength - step))) / (2 * step)
    slope = np.asarray(jax.jvp(compiled, (jnp.asarray(strength),), (jnp.asarray(1.0),))[1])
    np.testing.assert_allclose(slope, differences, atol=1e-4 * np.abs(differences).max())


PLACED_AT = np.linspace(0.0, 1.0, 81)
PLACES = 2e-6 * np.interp(PLACED_AT, [0.0, 0.21, 0.4, 0.45, 1.0], [0.0, 1.0, -1.0, -1.0, 0.5])
"""A triangle with a rest."""
CLOSED = [name for name in members("friction") if member("friction", name).slides_in_closed_form()]
BY_DEFAULT = ("coulomb", "reset-integrator")


def shown(name, segments):
    """Force at `PLACED_AT` and its derivative by a factor of the first parameter; stepped where `segments` is None."""
    kind = member("friction", name)
    field = next(iter(quantities(kind)))
    accuracy = QUICK if name in BY_DEFAULT else Accuracy()

    def run(by):
        law = kind(**{field: by * getattr(kind(), field)})
        system = PrescribedMotion(law, jnp.asarray(PLACED_AT), jnp.asarray(PLACES))
        return sensor_samples(system, jnp.asarray(PLACED_AT), accuracy, FRICTION_FORCE, segments)

    return jax.jit(lambda by: jax.jvp(run, (by,), (1.0,)))


@pytest.mark.parametrize("name", [n if n in BY_DEFAULT else slow(n) for n in CLOSED])
def test_it_is_what_steps_lead_to(name):
    (closed, slope), (stepped, expected) = shown(name, PLACED_AT.size)(1.01), shown(name, None)(1.01)
    np.testing.assert_allclose(closed, stepped, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(slope, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
