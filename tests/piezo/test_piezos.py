"""What every platform does under a voltage, against its definition and SciPy; answers to powers of time."""

from decimal import Decimal, localcontext

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow
from parts import BoucWen, Creep, DistributedRod, MaxwellSlip, Sawtooth, SecondOrder, Step
from scipy.linalg import expm

from pdssjax import Accuracy, Taylor
from pdssjax.actuator import DrivenPlatform
from pdssjax.core import quantities
from pdssjax.drive.base import Segment, Voltage
from pdssjax.integration import TIGHT
from pdssjax.piezo import damped, mode_responses, underdamped
from pdssjax.piezo._dynamics import lag_response, oscillator_response
from pdssjax.simulation import PlatformOnly, platform, sensor_samples
from tests.reference.combinations.motion import simulate
from tests.reference.combinations.rig import rig_of

PIEZOS = {"second-order": SecondOrder, "creep": Creep, "bouc-wen": BoucWen, "maxwell-slip": MaxwellSlip}
W = 6736.0


@jax.jit
def moved(piezo, drive, times, tolerance, settle_tolerance):
    """The platform alone [m]; compiled once for a piezo and a waveform, whatever the numbers."""
    assert times.shape == (97,)
    system = PlatformOnly(DrivenPlatform(piezo), drive)
    return sensor_samples(system, times, Accuracy(tolerance, settle_tolerance, Taylor(10)))


USUAL, FINE = ((a.tolerance, a.settle_tolerance) for a in (Accuracy(), TIGHT))


# By default `test_composed` has elements of slip and creep.
@pytest.mark.parametrize("name", [name if name in ("second-order", "bouc-wen") else slow(name) for name in PIEZOS])
def test_the_platform_moves_as_scipy_has_it(name):
    piezo, times = PIEZOS[name](), jnp.linspace(0.0, 0.1199, 98)[1:]
    drive = "Sawtooth", dict(voltage=64.0, frequency=25.0, fall_time=1e-4)
    numbers = {f"piezo.{field}": float(getattr(piezo, field)) for field in quantities(type(piezo))}
    expected = simulate(rig_of(name, "", drive, numbers, of="unloaded"), times, longest=2e-4)
    np.testing.assert_allclose(moved(piezo, Sawtooth(64.0, 25.0, 1e-4), times, *USUAL), expected, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("name", ["bouc-wen", slow("maxwell-slip")])
def test_a_jump_is_the_limit_of_a_fast_ramp(name):
    piezo = PIEZOS[name]()
    times = np.pad(np.linspace(1e-3, 0.1, 50), (0, 47), mode="edge")
    jump, *ramps = (np.asarray(moved(piezo, Sawtooth(64.0, 25.0, tf), times, *FINE)) for tf in (0.0, 1e-9, 2e-9))
    differences = [np.abs(ramp - jump).max() for ramp in ramps]
    assert differences[0] < 2e-12
    assert differences[1] == pytest.approx(2 * differences[0], rel=0.05)


@pytest.mark.parametrize("damping", [0.2, 0.99999, 1.0, 1.00001, 1.4, 8.0])
@pytest.mark.parametrize("elapsed", [1e-8, 1e-5, 3e-4, 0.004])
def test_a_free_oscillation_of_any_damping_is_that_of_the_matrix_exponential(damping, elapsed):
    matrix = np.array([[0.0, 1.0], [-(W**2), -2 * damping * W]])
    scale = np.diag([W, 1.0])  # the exponential is as precise as its norm is small
    expected = np.linalg.inv(scale) @ expm(elapsed * scale @ matrix @ np.linalg.inv(scale)) @ scale @ [2e-6, -0.01]
    for value, wanted, unit in zip(damped(2e-6, -0.01, W, damping, elapsed), expected, (2e-6, 0.01), strict=True):
        assert float(value) == pytest.approx(wanted, rel=1e-8, abs=1e-12 * unit)
    if damping < 0.9:
        again = underdamped(2e-6, -0.01, W, damping, elapsed)
        np.testing.assert_allclose(again, damped(2e-6, -0.01, W, damping, elapsed), rtol=1e-12)


@pytest.mark.parametrize("excitation", ["strain", "equal"])
def test_a_rod_steps_as_the_sum_of_its_modes(excitation):
    piezo = DistributedRod(3, excitation=excitation, viscosity=3e5)
    times = jnp.linspace(0.0, 0.004, 200)
    both = lambda piezo: (platform(piezo, Step(48.2), times, 2), mode_responses(piezo.modes, 48.2, times).sum(axis=0))
    np.testing.assert_allclose(*jax.jit(both)(piezo), rtol=0.0, atol=1e-16)


def test_a_rod_is_accelerated_by_a_force_and_gives_way_to_it_like_its_modes():
    piezo = DistributedRod(3)
    rest, nothing = piezo.initial(), Voltage(0.0, 0.0, 0.0)
    pushed = sum(piezo.rate(rest, nothing, 2.0)[1::2])
    assert float(pushed) == pytest.approx(2.0 / float(piezo.mass), rel=1e-12)
    segment = Segment(jnp.asarray(jnp.inf), jnp.asarray(0.0), jnp.asarray(0.0))
    steady = piezo.steady(rest, segment, 0.0, 2.0)
    np.testing.assert_allclose(jnp.stack(piezo.rate(steady, nothing, 2.0)), 0.0, atol=1e-9)
    assert float(piezo.platform(steady)[0]) > 0


@pytest.mark.slow
def test_a_rod_moves_as_the_numbers_say_that_it_holds():
    predict = jax.jit(lambda rod: platform(rod, Step(48.2), jnp.linspace(1e-4, 0.004, 30), 2))
    nominal, h = float(DistributedRod().modulus), 1e-6
    with_modulus = lambda modulus: eqx.tree_at(lambda rod: rod.modulus, DistributedRod(), modulus)
    softer = with_modulus(jnp.asarray(0.6 * nominal))
    np.testing.assert_array_equal(predict(softer), predict(DistributedRod(modulus=jnp.asarray(0.6 * nominal))))
    found = jax.grad(lambda rod: predict(rod)[7])(jax.tree.map(jnp.asarray, DistributedRod())).modulus
    above, below = (predict(with_modulus(jnp.asarray(nominal * (1.0 + step))))[7] for step in (h, -h))
    assert float(found) == pytest.approx(float(above - below) / (2.0 * h * nominal), rel=1e-6)


def test_a_rod_refuses_a_number_that_it_does_not_know():
    with pytest.raises(TypeError, match="'modulos'"):
        DistributedRod(modulos=1.0)


def test_creep_adds_as_much_in_every_decade():
    k, t1, volts = 0.015, 0.002, 64.0
    times = jnp.geomspace(0.004, 0.4, 97)
    shown = moved(Creep(creep=k, creep_time=t1), Step(volts), times, *USUAL)
    # The oscillator follows what has crept; behind it by its lag 2 xi / w.
    delay = 2 * 0.1772 / 6736.0
    crept = jnp.sum(1 - jnp.exp(-(times - delay) / (t1 * jnp.array([[1.0], [10.0], [100.0]]))), axis=0)
    late = times > 0.02  # when the oscillator has died down to e^-24
    np.testing.assert_allclose(np.asarray(shown)[late], 1.007e-7 * volts * (1 + k * crept)[late], rtol=1e-6)
    growth = np.diff(np.interp(np.log10([0.01, 0.1]), np.log10(times), shown)) / (1.007e-7 * volts)
    assert growth == pytest.approx(k, rel=0.15)


TIMES = np.array([1e-9, 1e-4, 0.1, 0.9, 1.1, 1.8, 1.9, 2.5, 3.5, 4.1, 4.2, 5.0, 8.0, 20.0])
DAMPINGS = [0.01, 0.3, 1.0, 1.019, 1.021, 3.0, 8.0]
H = 1e-5


def followed(x, damping, degree):
    """h_0 to h_degree, by r_k' = k r_(k-1) in the equations, from where all that is left out is below 1e-100."""
    known: dict[int, Decimal] = {}
    with localcontext(prec=200):
        far = int(degree + 80 + 8 * x * (1 + 2 * (damping or 0.0)))
        x, xi = Decimal(float(x)), Decimal(damping or 0.0)
        h, before = Decimal(0), Decimal(0)
        for k in range(far, 0, -1):
            if damping is None:
                h = known[k - 1] = x / k * (1 - h)
            elif k > 1:
                h, before = x * x / (k * (k - 1)) * (1 - before) - 2 * xi * x / (k - 1) * h, h
                known[k - 2] = h
    return np.array([float(known[k]) for k in range(degree + 1)])


def check(of, x, damping, degree):
    """Values and derivatives by time at points that are compiled as one."""
    expected = np.array([followed(*at, degree) for at in zip(x, damping, strict=True)])
    arguments = jnp.asarray(x), jnp.asarray(np.array(damping, float))
    values, slopes = jax.jit(jax.vmap(lambda *at: jax.jvp(lambda x: of(x, at[1]), at[:1], (1.0,))))(*arguments)
    np.testing.assert_allclose(values, expected, rtol=4e-13)
    # r_k' = k r_(k-1) is x h_k' = k (h_(k-1) - h_k).
    difference = np.arange(1, degree + 1) * (expected[:, :-1] - expected[:, 1:])
    np.testing.assert_allclose(slopes[:, 1:] * x[:, None], difference, rtol=4e-12, atol=4e-15 * degree)


@pytest.mark.parametrize("degree", [1, 9])
def test_a_lag_follows_powers_of_time_to_rounding(degree):
    check(lambda x, _: jnp.stack(lag_response(x, degree)), TIMES, [None] * TIMES.size, degree)


@pytest.mark.parametrize("damping", [0.3, 3.0])
def test_an_oscillator_follows_a_cube_of_time_to_rounding(damping):
    expected = np.array([followed(x, damping, 3) for x in TIMES]).T
    np.testing.assert_allclose(oscillator_response(jnp.asarray(TIMES), jnp.asarray(damping), 3), expected, rtol=4e-13)


@pytest.mark.slow
@pytest.mark.parametrize("degree", [1, 3, 9])
def test_an_oscillator_follows_powers_of_time_to_rounding(degree):
    x, damping = (grid.ravel() for grid in np.meshgrid(TIMES, DAMPINGS))
    of = lambda x, xi: jnp.stack(oscillator_response(x, xi, degree))
    check(of, x, damping, degree)
    by_damping = jax.jit(jax.vmap(lambda x, xi: jax.jvp(lambda xi: of(x, xi), (xi,), (1.0,))[1]))(x, damping)
    above, below = (
        np.array([followed(*at, degree) for at in zip(x, damping * s, strict=True)]) for s in (1 + H, 1 - H)
    )
    np.testing.assert_allclose(by_damping, (above - below) / (2 * H * damping[:, None]), rtol=1e-6, atol=1e-10)
