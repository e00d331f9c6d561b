"""What the hysteretic stacks make of a voltage, before the oscillator: loops, memory, energy, jumps."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from marks import slow
from parts import BoucWen, MaxwellSlip
from scipy.integrate import solve_ivp

from pdssjax.core import member
from pdssjax.drive.base import Segment, Voltage
from pdssjax.piezo._ceramic import after_jump

SHARES, THRESHOLDS = (0.08, 0.06, 0.05, 0.04), (4.0, 10.0, 18.0, 28.0)
PIEZOS = {"bouc-wen": BoucWen, "maxwell-slip": MaxwellSlip}


@jax.jit
def _passed(piezo, levels, signs):
    """The voltage that drives the oscillator after each of the jumps to `levels` [V]."""

    def jump(state, given):
        volts, sign = given
        state = piezo.on_segment_start(state, Segment(jnp.ones(()), volts, sign))
        pushed = piezo.acceleration((jnp.zeros(()), jnp.zeros(()), *state[2:]), Voltage(volts, 0.0, 0.0))
        return state, pushed / (piezo.natural_frequency**2 * piezo.gain)

    return lax.scan(jump, piezo.initial(), (levels, signs))[1]


def loop(piezo, turns):
    """Voltages and those that drive the oscillator, along a path of 40 jumps from each of the `turns` to the next."""
    legs = [np.linspace(here, there, 41)[1:] for here, there in itertools.pairwise(turns)]
    signs = np.repeat(np.sign(np.diff(turns)), 40)
    levels = np.concatenate(legs)
    return np.stack([levels, _passed(piezo, jnp.asarray(levels), jnp.asarray(signs))], axis=1)


def area(path) -> float:
    """Area of a loop in the plane of driving voltage against voltage; positive counter-clockwise."""
    u, d = path.T
    return float(0.5 * np.sum(u * np.roll(d, -1) - d * np.roll(u, -1)))


@pytest.mark.parametrize("name", PIEZOS)
def test_major_loops_dissipate_and_close(name):
    path = loop(PIEZOS[name](), [0.0, *[64.0, -64.0] * 6])
    before, last = path[-160:-80], path[-80:]
    assert area(last) > 0
    np.testing.assert_allclose(last, before, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("name", PIEZOS)
@pytest.mark.parametrize("seed", range(3))
def test_no_closed_path_of_the_voltage_creates_energy(name, seed):
    turns = np.random.default_rng(seed).uniform(-50.0, 50.0, 8)
    # Shrinking loops wear off what is stored, so that at the end there is nothing left to give back.
    shrinking = [60.0 * (-0.8) ** k for k in range(30)]
    path = np.concatenate([[[0.0, 0.0]], loop(PIEZOS[name](), [0.0, *turns, *shrinking, 0.0])])
    u, d = path.T
    assert np.sum(0.5 * (u[1:] + u[:-1]) * np.diff(d)) > 0


def test_elements_that_slip_make_a_loop_as_wide_as_their_thresholds_say():
    path = loop(MaxwellSlip(), [0.0, 80.0, -80.0, 80.0])
    down, up = path[40:80], path[80:120]
    width = np.interp(0.0, down[::-1, 0], down[::-1, 1]) - np.interp(0.0, up[:, 0], up[:, 1])
    assert width == pytest.approx(2 * np.dot(SHARES, THRESHOLDS), rel=1e-9)


def test_bouc_and_wens_loop_is_as_wide_as_its_closed_form():
    piezo = BoucWen(alpha=0.3, beta=0.2, gamma=0.05)
    path = loop(piezo, [0.0, 200.0, -200.0, 200.0])
    down, up = path[40:80], path[80:120]
    width = np.interp(0.0, down[::-1, 0], down[::-1, 1]) - np.interp(0.0, up[:, 0], up[:, 1])
    assert width == pytest.approx(2 * 0.3 / 0.25, rel=1e-9)


def test_a_small_loop_returns_to_where_it_left_the_large_one_and_is_forgotten():
    plain = loop(MaxwellSlip(), [0.0, 40.0, 60.0])
    visited = loop(MaxwellSlip(), [0.0, 40.0, 22.0, 30.0, 25.0, 40.0, 60.0])
    np.testing.assert_allclose(visited[5 * 40 - 1], plain[39], atol=1e-12)
    np.testing.assert_allclose(visited[-40:], plain[-40:], atol=1e-12)


def test_small_loops_between_the_same_voltages_are_congruent():
    rising, falling = [0.0, 40.0, 20.0, 40.0], [0.0, 80.0, 20.0, 40.0, 20.0, 40.0]
    first, second = loop(MaxwellSlip(), rising)[-80:], loop(MaxwellSlip(), falling)[-80:]
    apart = second[:, 1] - first[:, 1]
    np.testing.assert_allclose(apart, apart[0], atol=1e-12)
    assert abs(apart[0]) > 0.1


@pytest.mark.parametrize("name", PIEZOS)
def test_a_path_may_be_passed_in_one_jump_or_in_many(name):
    piezo = PIEZOS[name]()
    at = lambda volts: Segment(jnp.asarray(1.0), jnp.asarray(volts), jnp.asarray(0.0))
    begun = piezo.on_segment_start(piezo.on_segment_start(piezo.initial(), at(47.0)), at(31.0))
    once, many = piezo.on_segment_start(begun, at(-22.0)), begun
    for volts in np.linspace(31.0, -22.0, 54)[1:]:
        many = piezo.on_segment_start(many, at(volts))
    np.testing.assert_allclose(once, many, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(once[2], many[2], rtol=1e-12)


@pytest.mark.parametrize(("beta", "gamma"), [(0.03, 0.01), (0.03, -0.03), (0.03, 0.03), (0.02, 0.05)])
@pytest.mark.parametrize("change", [-70.0, -3.0, 5.0, 90.0])
@pytest.mark.parametrize("h", [-2e-6, slow(-1e-8), slow(0.0), 9e-7])
def test_bouc_and_wens_jump_follows_the_path(beta, gamma, change, h):
    piezo = BoucWen(alpha=0.3, beta=beta, gamma=gamma)
    zero, volt = jnp.zeros(()), 0.3 * piezo.gain  # the state is h in volts
    begun = (zero, zero, zero + 20.0, jnp.asarray(h / volt), zero + 1.0, zero + 1.0)
    at = Segment(jnp.asarray(1.0), jnp.asarray(20.0 + change), jnp.asarray(0.0))
    flow = lambda _, x: [0.3 * piezo.gain * change - beta * abs(change) * x[0] - gamma * change * abs(x[0])]
    path = solve_ivp(flow, (0.0, 1.0), [h], method="DOP853", rtol=1e-12, atol=1e-22, max_step=1e-3)
    assert float(volt * piezo.on_segment_start(begun, at)[3]) == pytest.approx(path.y[0, -1], rel=1e-5, abs=1e-13)


@pytest.mark.parametrize("h", [-0.4, 0.0, 0.7])
def test_a_jump_of_no_height_has_the_derivative_of_a_small_one(h):
    after = jax.jit(lambda change: after_jump(jnp.asarray(h), change, 1.0, 0.03, 0.01))
    small = 1e-6
    assert float(jax.grad(after)(0.0)) == pytest.approx(float(after(small) - after(0.0)) / small, rel=1e-4)


@pytest.mark.parametrize("path", ["initial_voltage", "initial_peak"])
def test_a_stack_that_has_rested_at_0_V_has_the_derivatives_of_one_that_rested_near_it(path):
    stack = member("piezo", "composed:second-order+bouc-wen")
    begun = jax.jit(lambda volts: jnp.stack([jnp.asarray(number) for number in stack(**{path: volts}).initial()]))
    expected = (begun(1e-5) - begun(0.0)) / 1e-5
    found = jax.jacfwd(begun)(0.0)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-5 * float(jnp.abs(expected).max()) + 1e-6)
