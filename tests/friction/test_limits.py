"""Limits of a law, what it carries at rest, sliding in closed form, and the size of its deflection."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from parts import (
    BlimanSorine,
    Coulomb,
    Dahl,
    Elastoplastic,
    GeneralizedMaxwellSlip,
    LuGre,
    ResetIntegrator,
    SimplifiedLuGre,
    Stribeck,
)
from scipy.optimize import brentq
from sliding import drive, slid, zigzag

from pdssjax import AbstractFriction
from pdssjax.core import member, members, quantities
from pdssjax.friction.base import deflection_scale

PATH = [0.7e-6, -1.1e-6, 0.4e-6, 0.1e-6, 3e-6]
SPEEDS = [1e-3, 2e-4, 3e-3, 1e-3, 5e-4]


def force_along(law: AbstractFriction, x: np.ndarray | None = None) -> np.ndarray:
    """The force [N] at 40 points of each leg; events within the legs do not count."""
    run = zigzag(law, PATH, SPEEDS, samples=400)
    grids, begin = [], 0
    for end in run.ends:
        x, force = run.x[begin : end + 1], run.force[begin : end + 1]
        order = np.argsort(x, kind="stable")
        grids.append(np.interp(np.linspace(x[order][0], x[order][-1], 40)[1:-1], x[order], force[order]))
        begin = end + 1
    return np.concatenate(grids)


ONE_ELEMENT = dict(
    zip((f"{kind}_{i}" for kind in ("stiffness", "strength") for i in (2, 3, 4)), [1e-3] * 3 + [1e-9] * 3, strict=True)
)
LIMITS = {
    "lugre without stribeck effect is the simplified law": (
        LuGre(1e6, 45.0, 0.0, 0.6, 0.6, 1e-3),
        SimplifiedLuGre(1e6, 45.0, 0.6),
        1e-12,
    ),
    "dahl with exponent 1 is the simplified law without damping": (
        Dahl(1e6, 0.6, 1.0),
        SimplifiedLuGre(1e6, 0.0, 0.6),
        1e-7,
    ),
    "bliman and sorine of first order is dahl with exponent 1": (
        BlimanSorine(0.6, 0.0, 3e-6, 0.2),
        Dahl(1e6, 0.6, 1.0),
        1e-7,
    ),
    "bliman and sorine with equal paths is dahl, too": (BlimanSorine(0.6, 0.3, 0.6e-6, 1.0), Dahl(1e6, 0.6, 1.0), 1e-7),
    "dahl with exponent 0 is a bond without stiction": (Dahl(1e6, 0.6, 0.0), ResetIntegrator(1e6, 0.6, 0.0, 0.0), 1e-6),
    "maxwell slip with one element is a bond without stiction": (
        GeneralizedMaxwellSlip(stiffness_1=1e6, strength_1=0.6, weakened=1.0, **ONE_ELEMENT),
        ResetIntegrator(1e6, 0.6, 0.0, 0.0),
        1e-6,
    ),
    "stribeck with one level is coulomb": (Stribeck(0.6, 0.6, 1e-3, 0.0, 1.3), Coulomb(0.6), 1e-12),
}


@pytest.mark.parametrize("name", LIMITS)
def test_limit(name):
    law, other, tolerance = LIMITS[name]
    np.testing.assert_allclose(force_along(law), force_along(other), atol=tolerance)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_elastoplastic_where_all_yields_is_lugre(sign):
    """LuGre is alpha = 1: not z_ba = 0, with which alpha still rises from 0."""
    curve = dict(sigma0=1e6, sigma1=45.0, sigma2=2.0, f_c=0.5, f_s=0.7, v_s=1e-3)
    plastic, lugre = Elastoplastic(**curve, elastic_part=0.0), LuGre(**curve)
    for z, v in ((0.75e-6, 2e-4), (0.55e-6, 3e-3), (0.6e-6, 1e-3)):
        z, v = jnp.asarray(sign * z), jnp.asarray(sign * v)
        begun = (z, *(jnp.asarray(flag) for flag in (0.0, 1.0, 0.0)))
        assert float(plastic.rate(begun, v, sign)[0]) == pytest.approx(
            float(lugre.rate((z, 0.0), v, sign)[0]), rel=1e-13
        )
        assert float(plastic.force(begun, v, sign)) == pytest.approx(float(lugre.force((z, 0.0), v, sign)), rel=1e-13)
    softer = zigzag(plastic, [0.3e-6])
    assert softer.force[-1] > zigzag(lugre, [0.3e-6]).force[-1] + 0.01


@pytest.mark.parametrize("elastic_part", [0.9, 0.99])
def test_an_elastoplastic_contact_that_hardly_yields_before_it_slides_becomes_a_bond(elastic_part):
    law = Elastoplastic(1e6, 0.0, 0.0, 0.6, 0.6, 1e-3, elastic_part)
    away = np.abs(force_along(law) - force_along(ResetIntegrator(1e6, 0.6, 0.0, 0.0))).max()
    assert 0.0 < away < 0.6 * (1.0 - elastic_part)


@pytest.mark.slow
def test_maxwell_slip_follows_the_stribeck_curve_with_a_lag_that_its_attraction_shortens():
    law = lambda attraction: GeneralizedMaxwellSlip(weakened=0.6, attraction=attraction)
    curve = Stribeck(f_c=0.6 * 0.65, f_s=0.65)
    velocity = lambda t: 3e-4 + 0.2 * t
    force_lag = []
    for attraction in (3e3, 3e4, 3e5):
        state = slid(law(attraction), 6e-6, velocity(0.0))
        run = drive(law(attraction), velocity, 5e-3, state)
        at = velocity(5e-3)
        slope = 0.2 * float(jax.grad(lambda v: curve.force((), v, 1.0))(at))
        expected = -float(curve.force((), jnp.asarray(at), 1.0)) * slope / attraction
        force_lag.append(run.force[-1] - float(curve.force((), jnp.asarray(at), 1.0)))
        assert force_lag[-1] == pytest.approx(expected, rel=0.3 * 3e3 / attraction + 1e-3)
    assert force_lag[0] > 9.0 * force_lag[1] > 81.0 * force_lag[2] > 0.0


ELASTIC = [name for name in members("friction") if member("friction", name).at_rest == "elastic"]


def loaded(name: str, force: float):
    law = member("friction", name)()
    state = jax.jit(under_load)(law, force)
    return law, [float(component) for component in state]


@pytest.mark.parametrize("name", ELASTIC)
@pytest.mark.parametrize("force", [0.2, -0.2])
def test_it_carries_the_force(name, force):
    law, state = loaded(name, force)
    assert float(law.force(tuple(state), 0.0, np.sign(force))) == pytest.approx(force, rel=1e-12)


def path_to(force, target: float, low: float, high: float) -> float:
    return brentq(lambda path: force(path) - target, low, high, xtol=1e-22)


@pytest.mark.parametrize("share", [0.2, 0.8, -0.97])
def test_springs_of_generalized_maxwell_slip_stretch_until_their_blocks_slip(share):
    law = member("friction", "generalized-maxwell-slip")()
    stiffness, strength = np.array(law._stiffnesses()), np.array(law._strengths())
    target = abs(share) * strength.sum()
    path = path_to(lambda x: np.minimum(stiffness * x, strength).sum(), target, 0.0, 1e-4)
    _, state = loaded("generalized-maxwell-slip", share * strength.sum())
    assert (path > strength / stiffness).any() == (abs(share) > 0.5)
    np.testing.assert_allclose(state[:4], np.sign(share) * np.minimum(path, strength / stiffness), rtol=1e-12)


@pytest.mark.parametrize("share", [0.3, 0.999, -0.8])
def test_elements_of_bliman_and_sorine_s_law_stretch_along_one_path(share):
    law = member("friction", "bliman-sorine")()
    lengths, f_1 = np.array([law.eta, 1.0]) * law.epsilon, law.f_c + law.f_2
    stretches = lambda path: lengths * (1.0 - np.exp(-path / lengths))
    force = lambda path: stretches(path) @ [f_1 / lengths[0], -law.f_2 / lengths[1]]
    peak = law.eta * law.epsilon / (1.0 - law.eta) * np.log(f_1 / (law.eta * law.f_2))
    path = path_to(force, abs(share) * force(peak), 0.0, peak)
    _, state = loaded("bliman-sorine", share * force(peak))
    np.testing.assert_allclose(state, np.sign(share) * stretches(path), rtol=1e-9)


@pytest.mark.parametrize("share", [0.5, 0.8, -0.95])
def test_bonds_of_the_bristle_law_snap_in_turn(share):
    law = member("friction", "bristle")()
    longest, count, snapped = 1.5 * law.f_c / law.sigma0, law.bristles, 0
    stretches = longest * ((np.arange(count) + 0.5) / count - 0.5) * np.sign(share)
    step = 1e-5 * longest
    # Small steps in one direction; the mirror case has its bonds the other way round.
    while stretches.mean() * law.sigma0 < abs(share) * law.f_c:
        stretches += step
        for broken in np.flatnonzero(stretches >= longest):
            snapped += 1
            stretches[broken] = longest * (snapped * 0.5 * (5.0**0.5 - 1.0) % 1.0)
    _, state = loaded("bristle", share * law.f_c)
    assert (state[-1], snapped > 0) == (snapped, abs(share) > 0.75)
    np.testing.assert_allclose(np.sign(share) * np.array(state[:-1]), stretches, atol=2.0 * step)


@pytest.mark.parametrize("name", ELASTIC)
def test_a_force_beyond_what_it_holds_gives_numbers(name):
    _, state = loaded(name, 30.0)
    assert np.isfinite(state).all()


@pytest.mark.parametrize("name", ELASTIC)
def test_derivatives_are_those_of_differences(name):
    numbers, rebuilt = ravel_pytree((member("friction", name)(), 0.45))
    state = jax.jit(lambda numbers: jnp.stack(under_load(*rebuilt(numbers))))
    columns = np.asarray(jax.jacfwd(state)(numbers)) * np.asarray(numbers)
    for i, number in enumerate(numbers):
        change = np.zeros(numbers.size)
        change[i] = 1e-6 * float(number)
        differences = (state(numbers + change) - state(numbers - change)) / 2e-6
        np.testing.assert_allclose(columns[:, i], differences, rtol=1e-5, atol=1e-8 * np.abs(columns).max())
    assert np.abs(columns[:, -1]).max() > 0.0


def under_load(law, force):
    return law.under_load(force)


SLIDING = [member("friction", name) for name in members("friction")]
CLOSED = [law for law in SLIDING if law.slides_in_closed_form()]
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
    told = [law for law in SLIDING if law.without_rate is not None]
    assert {law.__name__ for law in told} >= {"Coulomb", "Dahl", "GeneralizedMaxwellSlip"}
    for kind in told:
        law = kind(**kind.without_rate)
        if not kind.slides_in_closed_form():
            continue
        ends = [
            force(law, law.slide(begun(law, 1.0), jnp.asarray(v), jnp.asarray(7e-7 / v), 1.0), v) for v in (1e-6, 1.0)
        ]
        assert ends[0] == pytest.approx(ends[1], rel=1e-9)


WITHOUT = {"coulomb", "stribeck"}
"""Nothing of them deflects."""
LAWS = sorted(set(members("friction")) - WITHOUT)
_FORCES = ("f_", "strength", "epsilon")
"""What the fields begin with to which the deflection at which a law yields is proportional."""


def weakened(law, by):
    kind = member("friction", law)
    return kind(**{f: by * q.nominal for f, q in quantities(kind).items() if f.startswith(_FORCES)})


def test_what_yields_at_a_tenth_of_a_micrometre_or_more_counts_as_it_is():
    assert [float(deflection_scale(yielding)) for yielding in (1e-6, 1e-7, 1e-9)] == [1.0, 1.0, pytest.approx(100.0)]


@pytest.mark.parametrize("law", LAWS)
def test_every_deflection_of_every_law_counts_by_where_it_yields(law):
    usual, weak, weaker = ([float(x) for x in weakened(law, by).error_scale()] for by in (10.0, 1e-3, 1e-4))
    deflections = [i for i, (a, b) in enumerate(zip(weak, weaker, strict=True)) if a != b]
    assert deflections and usual == [1.0] * len(usual)
    assert all(weaker[i] == pytest.approx(10.0 * weak[i]) and weak[i] > 10.0 for i in deflections)


@pytest.mark.parametrize("law", sorted(WITHOUT))
def test_a_law_without_deflection_has_nothing_to_count(law):
    assert all(float(x) == 1.0 for x in weakened(law, 1e-6).error_scale())
