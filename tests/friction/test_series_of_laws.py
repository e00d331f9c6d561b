"""Within a branch: power series of a law against SciPy, derivatives of a force against differences."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow
from parts import AnisotropicLuGre, Dahl, Stribeck
from scipy.integrate import solve_ivp
from sliding import Contact

from pdssjax.core import member, members, quantities
from pdssjax.integration.taylor_series import Series, polynomial, taylor_coefficients

LAWS = {name: member("friction", name)() for name in members("friction")} | {
    "anisotropic lugre, force": AnisotropicLuGre(state="force"),
    "dahl, brittle": Dahl(exponent=0.4),
    "dahl, ductile": Dahl(exponent=1.7),
    "stribeck, exponential": Stribeck(delta=1.0, sigma2=2.0),
}
ORDER, COARSE = 12, 5
"""Orders of the series for values, and for derivatives."""
CHANGE, PACE = 4.0, 4e-4
"""Rate of the velocity [m/s2] and the velocity at first [m/s], in the direction of motion."""
BRANCHES = [("early", 0.02e-6, 1e-5), ("elements slip", 0.3e-6, 1e-5), ("late", 1.9e-6, 1e-5)]
"""How far the contact has slid before [m], and for how long it is expanded [s]; a fifth of that for derivatives."""
SIGNED = [(BRANCHES[0], 1.0), (BRANCHES[1], -1.0), slow(BRANCHES[2], -1.0)]
SIGNED += [slow(BRANCHES[0], -1.0), slow(BRANCHES[1], 1.0), (BRANCHES[2], 1.0)]
"""A branch each with one direction of motion by default: directions differ in signs alone."""


@functools.cache
def begun(name: str, path: float, sign: float) -> np.ndarray:
    """The state of a law after `path` at the steady velocity, with every flag where it should be."""
    contact = Contact(LAWS[name])
    m = contact.on_reversal(contact.initial, sign)
    v = sign * PACE
    for part in np.full(40, path / 40.0):
        field = lambda t, y: contact.rate(y, v, sign)
        m = solve_ivp(field, (0.0, part / PACE), m, rtol=1e-9, atol=1e-16).y[:, -1] if m.size else m
        m = contact.begun(m, v, sign)
    return m


def expanded(law, m, sign, elapsed, opaque_one, order=ORDER):
    """State and force after `lapse` [s] while the velocity grows steadily, by one power series.

    Run as it stands: to compile it for every law would take most of the time of the suite.  That the same series
    are right compiled, too, `tests/integration/test_step_methods.py` tells.
    """

    def field(time, x):
        velocity = sign * (PACE + CHANGE * time)
        return [*law.rate(tuple(x), velocity, sign)]

    series = taylor_coefficients(field, 0.0, list(m), order, opaque_one) if len(m) else []
    contact_state = tuple(polynomial(c) for c in series)
    velocity = polynomial([sign * PACE, sign * CHANGE])
    values = lambda s: sum(s[k] * elapsed**k for k in range(order + 1)) if isinstance(s, Series) else s
    guards = [values(g) for g in law.guards(contact_state, velocity, sign)]
    return [values(s) for s in contact_state], values(law.force(contact_state, velocity, sign)), guards


SLOPES = jax.jacfwd(lambda *given: expanded(*given, order=COARSE)[1])


def integrated(law, m, sign, elapsed) -> tuple[np.ndarray, float]:
    contact = Contact(law)
    velocity = lambda t: sign * (PACE + CHANGE * t)
    field = lambda t, y: contact.rate(y, velocity(t), sign)
    if len(m):
        m = solve_ivp(field, (0.0, elapsed), m, method="DOP853", rtol=1e-13, atol=1e-20).y[:, -1]
    return m, contact.force(m, velocity(elapsed), sign)


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize(("branch", "sign"), SIGNED, ids=lambda b: b[0] if isinstance(b, tuple) else str(b))
def test_the_power_series_of_a_law_is_its_solution(name, branch, sign):
    law, (_, path, elapsed) = LAWS[name], branch
    m = begun(name, path, sign)
    state, force, guards = expanded(law, tuple(m), sign, elapsed, 1.0)
    expected, expected_force = integrated(law, m, sign, elapsed)
    np.testing.assert_allclose(np.array(state, float), expected, rtol=1e-9, atol=1e-17)
    assert float(force) == pytest.approx(expected_force, rel=1e-9)
    contact = Contact(law)
    numbers = contact.guards(expected, sign * (PACE + CHANGE * elapsed), sign)
    np.testing.assert_allclose(np.array(guards, float), numbers, rtol=1e-6, atol=1e-14)
    assert (numbers >= 0.0).all()  # the branch has not ended


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("branch", [BRANCHES[0], *map(slow, BRANCHES[1:])], ids=lambda b: b[0])
def test_a_force_can_be_differentiated_by_every_parameter_of_its_law(name, branch):
    law, path, elapsed = LAWS[name], branch[1], 0.2 * branch[2]
    m = begun(name, path, 1.0)
    slopes = SLOPES(law, tuple(m), 1.0, elapsed, 1.0)
    size = abs(float(integrated(law, m, 1.0, elapsed)[1]))
    for parameter in quantities(type(law)):
        value = float(getattr(law, parameter))
        step = 1e-4 * value if value else 1e-3

        def force(change, parameter=parameter, value=value):
            changed = dataclasses.replace(law, **{parameter: value + change})
            return integrated(changed, m, 1.0, elapsed)[1]

        # At the end of its range forwards, else central; both to fourth order.
        weights = {-2: 1, -1: -8, 1: 8, 2: -1} if value else {0: -25, 1: 48, 2: -36, 3: 16, 4: -3}
        expected = sum(weight * force(k * step) for k, weight in weights.items()) / (12.0 * step)
        given = float(getattr(slopes, parameter))
        assert given * (value or 1.0) == pytest.approx(expected * (value or 1.0), rel=1e-6, abs=1e-8 * size), parameter


@pytest.mark.parametrize("name", LAWS)
def test_laws_can_be_compiled_and_mapped_over_their_parameters(name):
    law = LAWS[name]
    many = jax.tree.map(lambda leaf: leaf * jnp.linspace(0.9, 1.1, 3), law)
    state = tuple(jnp.asarray(x) for x in begun(name, 0.3e-6, 1.0))
    force = lambda law: law.force(law.after_event(law.on_reversal(state, 1.0), 1e-3, 1.0, 0), 1e-3, 1.0)
    mapped = jax.jit(jax.vmap(force))(many)
    alone = [float(force(jax.tree.map(lambda leaf, i=i: leaf[i], many))) for i in range(3)]
    np.testing.assert_allclose(mapped, alone, rtol=1e-12)
