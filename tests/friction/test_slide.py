"""What a constant velocity does to a law, in closed form, against the law's own rates and guards."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import AbstractFriction
from pdssjax.core import member, members
from pdssjax.friction.dahl import Dahl

LAWS = [member("friction", name) for name in members("friction")]
CLOSED = [law for law in LAWS if law.slides_in_closed_form()]
READINGS = [law(**words) for law in CLOSED for words in ({}, {"state": "force"})[: 1 + hasattr(law(), "state")]]
DAHLS = [Dahl(exponent=exponent) for exponent in (0.5, 1.0 - 1e-7, 1.5)]

every = pytest.mark.parametrize("law", [*READINGS, *DAHLS], ids=lambda law: type(law).__name__)


@eqx.filter_jit
def stepped(law: AbstractFriction, state, v, elapsed):
    """The state after 2000 steps of the law's rates (the classical Runge-Kutta method), events in between."""
    sign, step = jnp.sign(v), elapsed / 2000
    rates = lambda z: jnp.stack([0.0 * a + r for a, r in zip(z, law.rate(tuple(z), v, sign), strict=True)])

    def one(_, z):
        a = rates(z)
        b = rates(z + 0.5 * step * a)
        c = rates(z + 0.5 * step * b)
        z = z + step / 6.0 * (a + 2.0 * b + 2.0 * c + rates(z + step * c))
        return jnp.stack(law.on_velocity_jump(tuple(z), v, sign))

    return tuple(jax.lax.fori_loop(0, 2000, one, jnp.stack(state)))


def begun(law: AbstractFriction, sign: float):
    return law.on_velocity_jump(law.on_reversal(law.initial(), sign), jnp.asarray(sign * 1e-3), sign)


def force(law: AbstractFriction, state, v: float) -> float:
    return float(law.force(state, jnp.asarray(v), float(np.sign(v))))


@every
@pytest.mark.parametrize("travel", [3e-7, 2e-6])
def test_it_is_what_small_steps_lead_to_forwards_and_back(law, travel):
    if not law.initial():
        assert law.slide((), jnp.asarray(1e-3), jnp.asarray(1.0), 1.0) == ()
        return
    v, lasts = jnp.asarray(1e-3), jnp.asarray(travel / 1e-3)
    there = law.slide(begun(law, 1.0), v, lasts, 1.0)
    assert force(law, there, 1e-3) == pytest.approx(force(law, stepped(law, begun(law, 1.0), v, lasts), 1e-3), abs=1e-3)
    back = law.on_velocity_jump(law.on_reversal(there, -1.0), -v, -1.0)
    slid = law.slide(back, -v, lasts, -1.0)
    assert force(law, slid, -1e-3) == pytest.approx(force(law, stepped(law, back, -v, lasts), -1e-3), abs=1e-3)


@every
def test_two_stretches_are_as_good_as_one(law):
    v, state = jnp.asarray(-2e-3), begun(law, -1.0)
    once = law.slide(state, v, jnp.asarray(7e-4), -1.0)
    twice = law.slide(law.slide(state, v, jnp.asarray(3e-4), -1.0), v, jnp.asarray(4e-4), -1.0)
    np.testing.assert_allclose(np.asarray(twice), np.asarray(once), rtol=1e-12, atol=1e-20)
    nowhere = law.slide(once, v, jnp.zeros(()), -1.0)
    np.testing.assert_allclose(np.asarray(nowhere), np.asarray(once), rtol=1e-12, atol=1e-20)


def test_an_exponent_of_one_has_a_derivative():
    at = lambda n: Dahl(exponent=n).slide((jnp.zeros(()), jnp.zeros(())), jnp.asarray(1e-3), jnp.asarray(5e-4), 1.0)[0]
    slope = jax.grad(at)(1.0)
    assert float(slope) == pytest.approx(float(at(1.0 + 1e-5) - at(1.0 - 1e-5)) / 2e-5, rel=1e-6)


def test_a_law_without_a_rate_has_one_force_whatever_the_pace():
    told = [law for law in LAWS if law.without_rate is not None]
    assert {law.__name__ for law in told} >= {"Coulomb", "Dahl", "GeneralizedMaxwellSlip"}
    for kind in told:
        law = kind(**kind.without_rate)
        if not kind.slides_in_closed_form():
            continue
        ends = [
            force(law, law.slide(begun(law, 1.0), jnp.asarray(v), jnp.asarray(7e-7 / v), 1.0), v) for v in (1e-6, 1.0)
        ]
        assert ends[0] == pytest.approx(ends[1], rel=1e-9)
