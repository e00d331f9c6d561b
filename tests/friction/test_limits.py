"""Where one friction law is the limit of another, the two agree along the same path."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from sliding import drive, slid, zigzag

from pdssjax import AbstractFriction
from pdssjax.friction.bliman_sorine import BlimanSorine
from pdssjax.friction.coulomb import Coulomb
from pdssjax.friction.dahl import Dahl
from pdssjax.friction.elastoplastic import Elastoplastic
from pdssjax.friction.generalized_maxwell_slip import GeneralizedMaxwellSlip
from pdssjax.friction.lugre import LuGre
from pdssjax.friction.reset_integrator import ResetIntegrator
from pdssjax.friction.simplified_lugre import SimplifiedLuGre
from pdssjax.friction.stribeck import Stribeck

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
    "bliman and sorine with equal paths is dahl, too": (
        BlimanSorine(0.6, 0.3, 0.6e-6, 1.0),
        Dahl(1e6, 0.6, 1.0),
        1e-7,
    ),
    "dahl with exponent 0 is a bond without stiction": (
        Dahl(1e6, 0.6, 0.0),
        ResetIntegrator(1e6, 0.6, 0.0, 0.0),
        1e-6,
    ),
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


@pytest.mark.parametrize("elastic_part", [0.9, 0.99, 0.999])
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
