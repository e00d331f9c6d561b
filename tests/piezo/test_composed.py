"""Stacks put together of hysteresis, asymmetry and creep move as NumPy makes them of the textbook's definitions."""

import dataclasses
import itertools
import pickle
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from marks import slow
from parts import Cycloidal, Sampled, Sawtooth, SimplifiedLuGre, Sine
from scipy.integrate import solve_ivp

from pdssjax import Accuracy, Actuator, Effector, Taylor
from pdssjax.actuator import DrivenPlatform
from pdssjax.core import member, member_name, quantities
from pdssjax.piezo import Composition
from pdssjax.piezo._composition import composition_of
from pdssjax.simulation import PlatformOnly, StickSlip, sensor_samples

QUICKLY = Accuracy(method=Taylor(8), max_steps=20000)
TIMES = np.arange(61) * 5e-3
VOLTS = 20.0 + 15.0 * np.sin(2 * np.pi * 7.0 * TIMES) + 6.0 * np.sin(2 * np.pi * 19.0 * TIMES)
SLOW = {"natural_frequency": 250.0, "damping_ratio": 0.4}
STACKS = {
    "static+play-4+asymmetry-3+creep-2": {},
    "static+maxwell-slip-3+creep-1": {},
    "static+bouc-wen+creep-1": {},
    "first-order+play-3+asymmetry-2+creep-2": {"time_constant": 8e-3},
    "second-order+play-4+asymmetry-3+creep-2": SLOW,
    "second-order+maxwell-slip-2": {"natural_frequency": 180.0, "damping_ratio": 1.7},
    "rod-1+play-2+creep-1": {"modulus": 2e7, "viscosity": 5e4},
}
HISTORY = {"initial_voltage": 8.0, "initial_peak": 31.0}


def stack_class(name):
    return member("piezo", f"composed:{name}")


def made(name):
    """A stack with large hysteresis, that has not begun at rest at 0 V."""
    model = stack_class(name)
    numbers = {"play": 6e-9, "stop": 7e-9, "creep": 4e-9, "hysteresis": 3e-8, "initial_creep": 5e-8}
    given = {}
    for field, declared in quantities(model).items():
        word, _, number = field.rpartition("_")
        large = numbers.get(word if number.isdigit() else field)
        given[field] = declared.nominal if large is None else large * (1.0 + 0.2 * (int(number) if word else 0))
    history = {k: v for k, v in HISTORY.items() if k in given}
    return model(**(given | {k: 12.0 for k in given if k.endswith("_range")} | history | STACKS[name]))


def shown(stack, times):
    system = PlatformOnly(DrivenPlatform(stack), Sampled(TIMES, VOLTS))
    return sensor_samples(system, times, QUICKLY, segments=TIMES.size + 1)


def shown_at(stack, drive, times):
    return sensor_samples(PlatformOnly(DrivenPlatform(stack), drive), times, QUICKLY, segments=6)


@cache
def compiled(name):
    return jax.jit(shown), jnp.asarray(TIMES[0] + np.linspace(0.0, TIMES[-1], 97))


# What follows knows nothing of the package but the numbers of a stack.


def played(volts, thresholds, begin):
    """The play operator, by its definition: z(t) = max(v - r, min(v + r, z before)), for every threshold r."""
    z, out = np.array(begin, float), []
    for v in volts:
        z = np.maximum(v - thresholds, np.minimum(v + thresholds, z))
        out.append(z)
    return np.array(out).T


def aim_by_numpy(stack, composition, volts, times):
    """What the ceramic aims at, at `times` on a path so fine that nothing happens in between."""
    g = lambda name: float(getattr(stack, name))
    n = composition.elements
    total = g("gain") * volts
    path = np.concatenate([[0.0, g("initial_peak"), g("initial_voltage")], volts])
    if composition.has_elements:
        word = "play" if composition.hysteresis == "play" else "stop"
        thresholds = g(f"{word}_range") * np.arange(1, n + 1) / n
        weights = np.array([g(f"{word}_{j}") for j in range(1, n + 1)])
        plays = played(path, thresholds, np.zeros(n))[:, 3:]
        total = total + weights @ (plays if word == "play" else plays - volts)
    total = total + sum(g(f"asymmetry_{k}") * volts**k for k in range(2, composition.asymmetry + 1))
    for j in range(1, composition.creep + 1):
        share, time = g(f"creep_{j}"), g("creep_time") * 10.0 ** (j - 1)
        c = share * g("initial_voltage") + g(f"initial_creep_{j}")
        crept = [c]
        for begin, end, v0, v1 in zip(times, times[1:], volts, volts[1:], strict=False):
            slope = (v1 - v0) / (end - begin)
            steady = lambda v, slope=slope, time=time, share=share: share * (v - slope * time)
            c = steady(v1) + (c - steady(v0)) * np.exp(-(end - begin) / time)
            crept.append(c)
        total = total + np.array(crept)
    return total


def filtered(stack, composition, aim, times, rest):
    """The mechanics' answer to an aim known at close times, by SciPy."""
    if composition.dynamics == "static":
        return aim
    at = lambda t: np.interp(t, times, aim)
    if composition.dynamics == "first-order":
        tau = float(stack.time_constant)
        field, begin = lambda t, x: [(at(t) - x[0]) / tau], [rest]
    else:
        mode = stack.dynamics.modes[0]
        w, xi = float(mode.frequency), float(mode.damping)
        field, begin = lambda t, x: [x[1], w**2 * (float(mode.share) * at(t) - x[0]) - 2 * xi * w * x[1]], [rest, 0.0]
    return solve_ivp(field, times[[0, -1]], begin, t_eval=times, rtol=1e-9, atol=1e-15, max_step=1e-4).y[0]


QUICK = "static+play-4+asymmetry-3+creep-2", "static+maxwell-slip-3+creep-1", "first-order+play-3+asymmetry-2+creep-2"
"""What the default tests look at; that a second-order stack rides along is below."""


@pytest.mark.parametrize("name", [name if name in QUICK else slow(name) for name in STACKS if "bouc" not in name])
def test_a_composed_stack_moves_as_numpy_makes_it_move(name):
    stack, composition = made(name), composition_of(name)
    predict, times = compiled(name)
    fine = np.linspace(0.0, TIMES[-1], 60 * 96 + 1)
    volts = np.interp(fine, TIMES, VOLTS)
    aim = aim_by_numpy(stack, composition, volts, fine)
    # What the mechanics rest at before t = 0, where the voltage jumps from there to the first sample's.
    still = aim_by_numpy(stack, composition, np.array([float(stack.initial_voltage)]), np.zeros(1))[0]
    expected = filtered(stack, composition, aim, fine, still * (stack.dynamics.modes[0].share if "rod" in name else 1))
    np.testing.assert_allclose(predict(stack, times), expected[::60], rtol=0.0, atol=2e-6 * np.ptp(expected))


@pytest.mark.parametrize("name", ["static+play-2", "static+creep-1", slow("second-order+creep-1")])
def test_a_long_record_of_a_stack_without_one_of_its_parts_is_that_of_a_few_samples(name):
    """Mechanics, elements or creep that are not there are arrays without elements, which a map over samples refuses."""
    stack = stack_class(name)(**{key: field.nominal for key, field in quantities(stack_class(name)).items()})
    often = jnp.linspace(0.0, TIMES[-1], 16 * 64 + 1)
    found = jax.jit(shown)(stack, often)
    np.testing.assert_allclose(found[::16], jax.jit(shown)(stack, often[::16]), rtol=0.0, atol=1e-15)


def test_what_rides_on_a_composed_stack_moves_as_scipy_makes_it_move():
    """With the contact's reaction on the platform, whose hysteresis stays the voltage's."""
    name = "second-order+maxwell-slip-2"
    stack, composition = dataclasses.replace(made(name), mass=0.3), composition_of(name)
    friction, mass = SimplifiedLuGre(sigma0=3e3, sigma1=2.0, f_ss=2e-3), 0.1
    system = StickSlip(Actuator(stack, friction, Effector(mass), feedback=True), Sampled(TIMES, VOLTS))
    times = np.linspace(0.0, TIMES[-1], 97)
    run = jax.jit(lambda system, times: sensor_samples(system, times, QUICKLY, segments=TIMES.size + 1))
    found = np.asarray(run(system, jnp.asarray(times)))

    fine = np.linspace(0.0, TIMES[-1], 60 * 96 + 1)
    aim = aim_by_numpy(stack, composition, np.interp(fine, TIMES, VOLTS), fine)
    still = aim_by_numpy(stack, composition, np.array([float(stack.initial_voltage)]), np.zeros(1))[0]
    w, xi = 180.0, float(stack.dynamics.modes[0].damping)

    def field(t, x):
        platform, speed, _, rides, z = x
        v = speed - rides
        slip = v - 3e3 * abs(v) * z / 2e-3
        force = 3e3 * z + 2.0 * slip
        push = w**2 * (np.interp(t, fine, aim) - platform) - 2.0 * xi * w * speed
        return [speed, push - force / 0.3, rides, force / mass, slip]

    begin = [still, 0.0, still, 0.0, 0.0]
    solved = solve_ivp(field, times[[0, -1]], begin, "LSODA", times, rtol=1e-9, atol=1e-15, max_step=2e-4)
    way = solved.y[2]
    assert np.ptp(solved.y[0] - way) > 0.2 * np.ptp(solved.y[0]), "it slips"
    np.testing.assert_allclose(found, way, rtol=0.0, atol=1e-5 * np.ptp(way))


@pytest.mark.parametrize(
    "name",
    [
        "first-order+play-3+asymmetry-2+creep-2",
        slow("second-order+maxwell-slip-2"),
        slow("second-order+play-4+asymmetry-3+creep-2"),
    ],
)
def test_derivatives_agree_with_differences(name):
    stack = made(name)
    predict, times = compiled(name)
    leaves, tree = jax.tree.flatten(stack)
    numbers = np.array([float(leaf) for leaf in leaves])
    scale = np.where(numbers == 0.0, 1e-3, np.abs(numbers))
    of = lambda x: predict(jax.tree.unflatten(tree, [x[i] for i in range(len(leaves))]), times)
    jacobian = np.asarray(jax.jit(jax.jacfwd(lambda f: of(f * scale)))(numbers / scale))
    step = 1e-5
    for i, column in enumerate(jacobian.T):
        e = np.eye(len(leaves))[i] * step
        difference = (np.asarray(of((numbers / scale + e) * scale)) - of((numbers / scale - e) * scale)) / (2.0 * step)
        size = np.abs(difference).max()
        np.testing.assert_allclose(column, difference, rtol=0.0, atol=2e-4 * size + 1e-15)


STEEP = {
    "first-order+asymmetry-9": ({"time_constant": 1e-2}, 2e-4),
    "second-order+asymmetry-7": ({"natural_frequency": 2000.0, "damping_ratio": 0.3}, 5e-6),
    "second-order+asymmetry-5": ({"natural_frequency": 2000.0, "damping_ratio": 3.0}, 5e-6),
}


@pytest.mark.parametrize("name", [name if "first" in name else slow(name) for name in STEEP])
def test_a_steep_flank_of_a_bent_curve_moves_a_stack_as_scipy_has_it(name):
    """The steady answer to it, a polynomial, is up to a billion times the stroke, and the transient takes it back."""
    numbers, fall = STEEP[name]
    stack = stack_class(name)(**numbers)
    curve = [0.0, stack.gain, *(getattr(stack, f"asymmetry_{k}") for k in range(2, stack.composition.asymmetry + 1))]
    corners = [(0.0, 0.0), (0.1, 60.0), (0.1 + fall, 0.0), (0.15, 60.0 * (0.05 - fall) / (0.1 - fall))]

    def field(t, x):
        aim = np.polynomial.polynomial.polyval(np.interp(t, *zip(*corners, strict=True)), curve)
        if len(x) == 1:
            return (aim - x) / stack.time_constant
        w = stack.natural_frequency
        return [x[1], w**2 * (aim - x[0]) - 2.0 * stack.damping_ratio * w * x[1]]

    state, expected = np.zeros(1 if "first" in name else 2), []
    for (begin, _), (end, _) in itertools.pairwise(corners):
        solved = solve_ivp(field, (begin, end), state, "DOP853", rtol=1e-11, atol=1e-18, max_step=(end - begin) / 20)
        state = solved.y[:, -1]
        expected.append(state[0])
    times = jnp.asarray([end for end, _ in corners[1:]])
    predict = jax.jit(lambda fall: shown_at(stack, Sawtooth(60.0, 10.0, fall), times))
    np.testing.assert_allclose(predict(fall), expected, rtol=0.0, atol=1e-10 * np.ptp(expected))


@pytest.mark.parametrize(
    "name", [slow("second-order+asymmetry-3"), slow("first-order+play-3+asymmetry-5"), "first-order+asymmetry-2"]
)
def test_derivatives_by_the_length_of_a_very_steep_flank_agree_with_differences(name):
    times = jnp.asarray([0.0203, 0.0207, 0.0402])
    predict = jax.jit(lambda fall: shown_at(stack_class(name)(), Sawtooth(60.0, 50.0, fall), times))
    difference = (predict(2e-8) - predict(0.0)) / 2e-8
    np.testing.assert_allclose(jax.jit(jax.jacfwd(predict))(1e-8), difference, rtol=1e-4)


WAVES = [Sine(30.0, 7.0), Sine(-25.0, 9.0, 20.0, 1.0), Cycloidal(30.0, 9.0, 4e-3, -1.0), Cycloidal(25.0, 9.0)]


def test_a_wave_moves_a_composed_stack_as_numpy_makes_it_move():
    name, drive = "static+maxwell-slip-3+creep-1", WAVES[1]
    fine, segments = np.linspace(0.0, 0.16, 40 * 80 + 1), drive.segments(0.17)
    expected = aim_by_numpy(made(name), composition_of(name), np.asarray(drive.at(fine)), fine)[40::40]
    system = PlatformOnly(DrivenPlatform(made(name)), drive)
    found = jax.jit(lambda times: sensor_samples(system, times, QUICKLY, segments=segments))(fine[40::40])
    # A chord of 1/2000 of a period is off by (2 pi / 2000)^2 / 16 of the swing.
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-6 * np.ptp(expected))


def test_a_name_says_it_all_also_to_another_process():
    for name in STACKS:
        model = stack_class(name)
        assert composition_of(name).text == name
        assert member_name(model) == f"composed:{name}"
        assert pickle.loads(pickle.dumps(model)) is model is stack_class(name)
    assert member("piezo", "composed").composition == Composition()


@pytest.mark.parametrize(
    "name", ["static+", "statics", "static+play", "static+play-0", "play-3+static", "static+creep-x"]
)
def test_what_names_no_stack_is_refused(name):
    with pytest.raises(KeyError):
        stack_class(name)
