"""What defines each friction law: how it slides, how stiff it is at rest, where it breaks away."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parts import (
    BlimanSorine,
    Bristle,
    Coulomb,
    Dahl,
    Elastoplastic,
    GeneralizedMaxwellSlip,
    LuGre,
    ResetIntegrator,
    Sawtooth,
    SecondOrder,
    SimplifiedLuGre,
    Stribeck,
)
from sliding import drive, slid, zigzag

import pdssjax
from pdssjax import Actuator, Effector, InputError

VELOCITIES = (2e-4, -7e-4, 1.3e-3, -5e-3)


def gaussian(v: float, f_c: float = 0.5, f_s: float = 0.7, v_s: float = 1e-3, viscous: float = 3.0) -> float:
    """Steady friction [N] with the Stribeck curve (5.10), written once more."""
    return np.sign(v) * (f_c + (f_s - f_c) * np.exp(-((v / v_s) ** 2))) + viscous * v


CURVE = dict(f_c=0.5, f_s=0.7, v_s=1e-3, sigma2=3.0)
ELEMENTS = dict(strength_1=0.1, strength_2=0.15, strength_3=0.2, strength_4=0.25)
STEADY = {
    "coulomb": (Coulomb(0.65), lambda v: 0.65 * np.sign(v)),
    "stribeck": (Stribeck(**CURVE), gaussian),
    "dahl": (Dahl(f_c=0.65), lambda v: 0.65 * np.sign(v)),
    "dahl, brittle": (Dahl(f_c=0.65, exponent=0.4), lambda v: 0.65 * np.sign(v)),
    "simplified lugre": (SimplifiedLuGre(f_ss=0.65), lambda v: 0.65 * np.sign(v)),
    "lugre": (LuGre(**CURVE), gaussian),
    "elastoplastic": (Elastoplastic(**CURVE), gaussian),
    "reset integrator": (ResetIntegrator(f_c=0.5, a=0.4), lambda v: 0.5 * np.sign(v)),
    "bliman and sorine": (BlimanSorine(f_c=0.5, f_2=0.3), lambda v: 0.5 * np.sign(v)),
    "maxwell": (GeneralizedMaxwellSlip(**ELEMENTS, weakened=5.0 / 7.0, v_s=1e-3, sigma2=3.0), gaussian),
}


@pytest.mark.parametrize("name", STEADY)
@pytest.mark.parametrize("v", VELOCITIES)
def test_steady_sliding_takes_the_force_of_the_closed_form(name, v):
    law, expected = STEADY[name]
    state = slid(law, 6e-5 + 0.004 * abs(v), v)
    assert float(law.force(state, jnp.asarray(v), np.sign(v))) == pytest.approx(expected(v), rel=1e-7)


def test_bristles_slide_at_the_mean_force_asked_for_in_both_directions():
    law = Bristle(f_c=0.5)
    for v in (1e-3, -1e-3):
        path = 2.0 * float(law.longest())
        run = drive(law, lambda _, v=v: v, path / abs(v), slid(law, path, v), samples=2)
        assert run.work()[-1] / run.x[-1] == pytest.approx(0.5 * np.sign(v), rel=0.02)


STIFFNESS = {
    "dahl": (Dahl(sigma0=8e5, exponent=2.0), 8e5),
    "simplified lugre": (SimplifiedLuGre(sigma0=8e5), 8e5),
    "lugre": (LuGre(sigma0=8e5, sigma2=3.0), 8e5),
    "elastoplastic": (Elastoplastic(sigma0=8e5), 8e5),
    "reset integrator": (ResetIntegrator(sigma0=8e5, a=0.25), 1e6),
    "bristle": (Bristle(sigma0=8e5), 8e5),
    "bliman and sorine": (BlimanSorine(f_c=0.5, f_2=0.3, epsilon=2e-6, eta=0.25), 1.6e6 - 0.15e6),
    "maxwell": (GeneralizedMaxwellSlip(), 1e6),
}


@pytest.mark.parametrize("name", STIFFNESS)
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_contact_at_rest_is_as_stiff_as_its_parameters_say(name, direction):
    law, expected = STIFFNESS[name]
    run = drive(law, lambda _: direction * 1e-7, 1e-12 / 1e-7, samples=2)
    slope = (run.force[-1] - run.force[0]) / (run.x[-1] - run.x[0])
    assert slope == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_set_valued_laws_hold_up_to_their_force_and_lose_part_of_it_by_moving(sign):
    assert float(Coulomb(0.4).breakaway_force((), sign)) == pytest.approx(0.4 * sign)
    stribeck = Stribeck(f_c=0.4, f_s=0.7)
    assert float(stribeck.breakaway_force(stribeck.initial(), sign)) == pytest.approx(0.7 * sign)
    assert float(stribeck.force((), jnp.asarray(sign * 0.1), sign)) == pytest.approx(0.4 * sign)


@pytest.mark.parametrize(("delta", "tolerance"), [(2.0, 1e-15), (4.0, 1e-6), (1.0, 1e-4), (0.5, 3e-3)])
def test_a_stribeck_curve_of_any_exponent_is_smooth_at_rest_and_else_the_closed_form(delta, tolerance):
    law = Stribeck(f_c=0.4, f_s=0.7, v_s=2e-3, delta=delta)
    for v in (0.0, 1e-7, 3e-6, 1e-4, 2e-3, 1e-2):
        expected = 0.4 + 0.3 * np.exp(-((v / 2e-3) ** delta))
        assert float(law.force((), jnp.asarray(v), 1.0)) == pytest.approx(expected, abs=tolerance)
        slope = jax.grad(lambda law, v=v: law.force((), jnp.asarray(v), 1.0))(law)
        assert all(np.isfinite(leaf) for leaf in jax.tree.leaves(slope))


@pytest.mark.parametrize(
    "law",
    [
        Stribeck(f_c=0.7, f_s=0.5),
        LuGre(f_c=0.7, f_s=0.5),
        Elastoplastic(f_c=0.7, f_s=0.5, elastic_part=0.95),
        GeneralizedMaxwellSlip(weakened=1.3),
    ],
    ids=str,
)
def test_a_static_force_below_the_kinetic_one_is_friction_that_grows_with_the_velocity(law):
    forces = [float(law.force(slid(law, 2e-5, v), jnp.asarray(v), 1.0)) for v in (2e-4, 1e-3, 4e-3)]
    assert forces[0] < forces[1] < forces[2]


def test_the_reset_integrator_breaks_away_above_its_sliding_force_and_drops_to_it():
    law = ResetIntegrator(sigma0=1e6, f_c=0.5, a=0.4, beta=0.0)
    run = zigzag(law, [3e-6])
    at = int(np.argmax(run.force))
    assert run.force[at] == pytest.approx(1.4 * 0.5, rel=1e-9)
    assert run.x[at] == pytest.approx(0.5e-6, rel=1e-9)
    np.testing.assert_allclose(run.force[at + 1 :], 0.5, rtol=1e-12)


def test_the_second_order_model_overshoots_by_the_closed_form_and_where_it_says():
    f_1, f_2, epsilon, eta = 0.8, 0.3, 3e-6, 0.2
    run = zigzag(BlimanSorine(f_1 - f_2, f_2, epsilon, eta), [2e-5], samples=4001)
    peak = eta * epsilon / (1.0 - eta) * np.log(f_1 / (eta * f_2))
    curve = lambda x: f_1 * (1.0 - np.exp(-x / (eta * epsilon))) - f_2 * (1.0 - np.exp(-x / epsilon))
    assert run.x[np.argmax(run.force)] == pytest.approx(peak, abs=6e-9)
    assert run.force.max() == pytest.approx(curve(peak), rel=1e-6)
    np.testing.assert_allclose(run.force, curve(run.x), atol=1e-9)
    assert run.force.max() > 1.2 * run.force[-1]


@pytest.mark.parametrize("exponent", [0.0, 0.4, 1.0, 1.7])
def test_dahls_curve_is_the_closed_form_of_its_exponent(exponent):
    law = Dahl(sigma0=1e6, f_c=0.6, exponent=exponent)
    run = zigzag(law, [3e-6])
    path = run.x * 1e6 / 0.6
    if exponent == 1.0:
        room = np.exp(-path)
    else:
        room = np.maximum(1.0 - (1.0 - exponent) * path, 0.0) ** (1.0 / (1.0 - exponent))
    np.testing.assert_allclose(run.force, 0.6 * (1.0 - room), atol=1e-8)
    assert run.events == (1 if exponent < 1.0 else 0)


def test_elastoplastic_contact_is_a_spring_up_to_its_breakaway_and_then_yields():
    law = Elastoplastic(sigma0=1e6, sigma1=0.0, f_c=0.5, f_s=0.6, elastic_part=0.7)
    run = zigzag(law, [1.5e-5, 1.49e-5], speed=1e-6)
    out, elastic = run.v > 0, run.x <= 0.7 * 0.5e-6
    assert float(law.breakaway()) == pytest.approx(0.7 * 0.5e-6)
    np.testing.assert_allclose(run.force[out & elastic], 1e6 * run.x[out & elastic], rtol=1e-9)
    assert (run.force[out & ~elastic] < 1e6 * run.x[out & ~elastic]).all()
    slow = 0.5 + 0.1 * np.exp(-1e-6)
    assert run.force[out][-1] == pytest.approx(slow, rel=1e-8)
    np.testing.assert_allclose(run.force[~out], slow + 1e6 * (run.x[~out] - 1.5e-5), rtol=1e-8)  # elastic at once


def test_maxwell_elements_slip_one_after_the_other_at_their_own_forces():
    law = GeneralizedMaxwellSlip(weakened=1.0)
    run = zigzag(law, [4e-6])
    stiffness, strength = np.array([4e5, 3e5, 2e5, 1e5]), np.array([0.06, 0.14, 0.2, 0.25])
    expected = np.minimum(np.outer(run.x, stiffness), strength).sum(axis=1)
    np.testing.assert_allclose(run.force, expected, atol=1e-10)
    assert run.events == 4


def test_slow_breakaway_of_the_laws_with_a_stribeck_curve_takes_the_static_force():
    for law in (LuGre(**CURVE), Elastoplastic(**CURVE), GeneralizedMaxwellSlip(**ELEMENTS)):
        assert zigzag(law, [1e-5], speed=2e-5).force.max() == pytest.approx(0.7, rel=2e-4)


class Tanh(Coulomb):
    """A law that series cannot pass."""

    def force(self, state, v, sign):
        return self.f_c * jnp.tanh(v)


def test_a_law_with_functions_of_jax_numpy_is_refused_with_those_to_use():
    with pytest.raises(InputError, match=r"tanh.*expected \+ - \* / and the functions exp, power"):
        pdssjax.simulate(Actuator(SecondOrder(), Tanh(), Effector(0.086)), Sawtooth(), jnp.linspace(0.0, 0.1, 11))
