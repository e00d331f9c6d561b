"""Whole actuators, any waveform, stack, contact and part together, move as the simulator of `combinations` has it.

That is first held against closed forms, and against the other independent simulator; then, among the slow tests, the
package against it.
"""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from experiments.actuator_structure import SHARES, Structure
from experiments.random_actuators import PUBLISHED, STRUCTURES, named
from pdssjax import AbstractDrive
from pdssjax.core import quantities
from pdssjax.integration import TIGHT
from pdssjax.simulation import ACCELERATION, DISPLACEMENT, STOP_FORCE, VELOCITY
from tests.reference.combinations.motion import simulate
from tests.reference.combinations.rig import rig_of
from tests.reference.independent import Rig, simulate as simulate_on_one_stack
from tests.reference.laws.dahl import Dahl
from tests.reference.laws.generalized_maxwell_slip import GeneralizedMaxwellSlip
from tests.reference.laws.lugre import LuGre
from tests.reference.laws.reset_integrator import ResetIntegrator

GAIN, PEAK = 1e-7, 64.0
SEEN = np.linspace(1e-4, 0.049, 200)
OUTPUTS = {DISPLACEMENT: "displacement", VELOCITY: "velocity", ACCELERATION: "acceleration", STOP_FORCE: "stop_force"}
AGREES = 5e-8
"""Part of a record's largest value to which both agree; of 136 actuators the worst is 1.6e-8 and the median 4e-11."""
COMBINATIONS = [f"combination {number}" for number in range(60)]
MOVED = [
    name
    for name, structure in STRUCTURES.items()
    if structure.of != "contact" and structure.friction != "bristle" and name not in PUBLISHED
]
"""Of every kind that a study can have, but for what `laws` and `independent` have: contacts moved as prescribed, the
bristle law, the published actuators (at 5 Hz half a minute each)."""
NOMINAL = ("combination 18",)
"""Behind an amplifier, the acceleration of a second-order stack."""


def shown(piezo: str, drive: tuple[str, dict[str, Any]], numbers: dict[str, float], times=SEEN, **chosen: Any):
    """The record of a rig, of a Coulomb contact where there is one."""
    return simulate(rig_of(piezo, "coulomb", drive, numbers, **chosen), times)


def test_an_amplifier_slews_and_then_settles():
    w, slew = 2 * math.pi * 5e3, 1e5
    numbers = {"piezo.gain": GAIN, "amplifier.slew": slew, "amplifier.bandwidth": 5e3}
    times = np.linspace(1e-5, 2e-3, 100)
    drive = "Step", dict(voltage=PEAK, rise_time=0.0)
    found = shown("static", drive, numbers, times, parts=("amplifier",), of="unloaded")
    ends = PEAK / slew - 1.0 / w
    settling = PEAK - slew / w * np.exp(-w * np.maximum(times - ends, 0.0))
    np.testing.assert_allclose(found / GAIN, np.where(times < ends, slew * times, settling), rtol=0.0, atol=1e-11)


def test_a_platform_rings_after_a_step():
    w, xi, gain = 6736.0, 0.1772, GAIN
    numbers = {"piezo.gain": gain, "piezo.natural_frequency": w, "piezo.damping_ratio": xi}
    times, damped = np.linspace(1e-5, 5e-3, 100), w * math.sqrt(1 - xi**2)
    found = shown("second-order", ("Step", dict(voltage=PEAK, rise_time=0.0)), numbers, times, of="unloaded")
    swings = np.cos(damped * times) + xi * w / damped * np.sin(damped * times)
    np.testing.assert_allclose(found, gain * PEAK * (1 - np.exp(-xi * w * times) * swings), rtol=0.0, atol=1e-16)


def test_a_sensor_is_late_and_slow():
    numbers = {"piezo.gain": GAIN, "sensor.bandwidth": 800.0, "sensor.delay": 3e-4}
    times = np.linspace(1e-5, 2e-3, 100)
    drive = "Step", dict(voltage=PEAK, rise_time=0.0)
    found = shown("static", drive, numbers, times, parts=("sensor",), of="unloaded")
    expected = GAIN * PEAK * -np.expm1(-2 * math.pi * 800.0 * np.maximum(times - 3e-4, 0.0))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-16)


def test_coulomb_friction_brakes_after_each_corner_and_then_sticks():
    """A triangle of velocities +-s: the end-effector comes up to them with f_c / m."""
    mass, force = 0.086, 0.65
    numbers = {"piezo.gain": GAIN, "effector.mass": mass, "friction.f_c": force}
    found = shown("static", ("Triangle", dict(voltage=PEAK, frequency=20.0, symmetry=0.5)), numbers)
    s, a = GAIN * PEAK / 0.025, force / mass
    first = np.where(s / a > SEEN, 0.5 * a * SEEN**2, s * SEEN - 0.5 * s**2 / a)
    since = np.maximum(SEEN - 0.025, 0.0)
    braked = np.minimum(since, 2 * s / a)
    second = s * 0.025 - 0.5 * s**2 / a + s * braked - 0.5 * a * braked**2 - s * (since - braked)
    np.testing.assert_allclose(found, np.where(SEEN < 0.025, first, second), rtol=0.0, atol=1e-17)


def test_what_sticks_is_pushed_into_the_stop():
    stiffness, dissipation, gap, w = 1e4, 10.0, 3e-6, 2 * math.pi * 20.0
    numbers = {"piezo.gain": GAIN, "effector.mass": 0.086, "friction.f_c": 0.65, "stop.stiffness": stiffness}
    numbers |= {"stop.dissipation": dissipation, "stop.gap": gap}
    drive = "Sine", dict(voltage=PEAK, frequency=20.0)
    found = shown("static", drive, numbers, parts=("stop",), output="stop_force")
    y, dy = 0.5 * GAIN * PEAK * (1 - np.cos(w * SEEN)), 0.5 * GAIN * PEAK * w * np.sin(w * SEEN)
    expected = stiffness * np.maximum(y - gap, 0.0) * (1 + dissipation * dy)
    assert expected.max() > 0.03
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11)


def test_bouc_and_wen_s_loop_solves_its_equation():
    beta, gamma, weight, w = 0.03, 0.02, 3e-8, 2 * math.pi * 20.0
    numbers = {"piezo.gain": GAIN, "piezo.hysteresis": weight, "piezo.beta": beta, "piezo.gamma": gamma}
    drive = "Sine", dict(voltage=PEAK, frequency=20.0)
    found = shown("composed:static+bouc-wen", drive, numbers, of="unloaded")
    slope = lambda t: 0.5 * PEAK * w * math.sin(w * t)
    rate = lambda t, h: slope(t) - beta * abs(slope(t)) * h - gamma * slope(t) * abs(h)
    h = solve_ivp(rate, (0.0, 0.05), [0.0], "DOP853", SEEN, rtol=1e-12, atol=1e-13, max_step=1e-5).y[0]
    u = 0.5 * PEAK * (1 - np.cos(w * SEEN))
    np.testing.assert_allclose(found, GAIN * u + weight * (u - h), rtol=0.0, atol=1e-16)


def test_play_follows_its_definition():
    """Each element stays within its threshold of the voltage: v = max(u - r, min(u + r, v))."""
    numbers = {"piezo.gain": GAIN, "piezo.play_1": 1e-8, "piezo.play_2": 2e-8, "piezo.play_range": 12.0}
    # Turning points of the voltage are among the samples.
    times = np.arange(1, 1000) * 0.05 / 500
    found = shown("composed:static+play-2", ("Sine", dict(voltage=PEAK, frequency=20.0)), numbers, times, of="unloaded")
    elements, expected = [0.0, 0.0], []
    for u in 0.5 * PEAK * (1 - np.cos(2 * math.pi * 20.0 * times)):
        elements = [max(u - r, min(u + r, v)) for r, v in zip((6.0, 12.0), elements, strict=True)]
        expected.append(GAIN * u + 1e-8 * elements[0] + 2e-8 * elements[1])
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-18)


@pytest.mark.parametrize(
    ("name", "law"),
    [
        pytest.param("lugre", LuGre(), id="lugre"),
        pytest.param("reset-integrator", ResetIntegrator(), id="reset-integrator", marks=pytest.mark.slow),
        pytest.param("dahl", Dahl(), id="dahl", marks=pytest.mark.slow),
        pytest.param("generalized-maxwell-slip", GeneralizedMaxwellSlip(), id="Maxwell slip", marks=pytest.mark.slow),
    ],
)
def test_both_independent_simulators_agree(name, law):
    """Where the other one reaches: a second-order stack under a sawtooth, here with feedback and a load."""
    rig = Rig(law=law, cycle=0.05, fall=8e-4, feedback=True, load=0.1)
    times = np.linspace(1e-3, 0.07, 40)
    numbers = {"piezo.gain": rig.gain, "piezo.natural_frequency": rig.frequency, "piezo.damping_ratio": rig.damping}
    numbers |= {"piezo.mass": rig.stack, "effector.mass": rig.mass, "effector.load": rig.load}
    numbers |= {f"friction.{field}": x for field, x in vars(law).items()}
    drive = "Sawtooth", dict(voltage=rig.voltage, frequency=1.0 / rig.cycle, fall_time=rig.fall)
    found = simulate(rig_of("second-order", name, drive, numbers, feedback=True), times)
    np.testing.assert_allclose(found, simulate_on_one_stack(rig, times, longest=2e-5)[:, 1], rtol=0.0, atol=1e-14)


def waveform(drive: AbstractDrive) -> tuple[str, dict[str, Any]]:
    """A waveform of the package as kind and plain numbers."""
    kind, given = type(drive).__name__, vars(drive)
    if kind == "ZeroOrderHold":
        return kind, dict(base=waveform(given["drive"]), interval=float(given["interval"]))
    if kind == "Sampled":
        samples = {field: np.asarray(given[field]).tolist() for field in ("times", "voltages")}
        return kind, samples | dict(interpolation=float(given["interpolation"]))
    return kind, {field: float(number) for field, number in drive.numbers().items()}


def drawn(structure: Structure, factors: np.ndarray) -> dict[str, dict[str, float]]:
    """By part and field the numbers that these logarithms of factors make; of a share they are on its odds."""
    numbers: dict[str, dict[str, float]] = {part: {} for part in ("drive", *structure.models)}
    for (path, nominal), factor in zip(structure.nominal.items(), np.exp(factors), strict=True):
        part, field = path.split(".")
        scaled = float(nominal * factor)
        numbers[part][field] = scaled / (1.0 - nominal + scaled) if field in SHARES else scaled
    return numbers


def expected(structure: Structure, factors: np.ndarray) -> np.ndarray:
    """What the simulator shows of the actuator that these logarithms of factors make."""
    numbers = drawn(structure, factors)
    whole = {}
    for part, model in structure.models.items():
        built = model(**numbers[part])  # which knows the numbers that are not drawn
        whole |= {f"{part}.{field}": float(getattr(built, field)) for field in quantities(model)}
    rig = rig_of(
        structure.piezo,
        structure.friction,
        waveform(structure.drive.with_numbers(numbers["drive"])),
        whole,
        structure.state,
        structure.parts,
        feedback=structure.feedback,
        rests_under_load=structure.rests_under_load,
        of=structure.of,
        output=OUTPUTS[structure.output],
    )
    return simulate(rig, structure.times)


def agrees(name: str, seeds: tuple[int, ...]) -> None:
    """Of the actuators that these seeds draw; -1 is the nominal one."""
    structure = named(name)
    packaged = jax.jit(lambda factors: structure.shown(factors, TIGHT))
    for seed in seeds:
        factors = structure.draw(np.random.default_rng([99, seed])) if seed >= 0 else np.zeros(len(structure.nominal))
        wanted = expected(structure, factors)
        found, largest = np.asarray(packaged(jnp.asarray(factors))), np.abs(wanted).max()
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=AGREES * largest, err_msg=f"{name}, seed {seed}")


@pytest.mark.slow
@pytest.mark.parametrize("name", NOMINAL)
def test_the_package_moves_nominal_actuators_alike(name):
    agrees(name, (-1,))


@pytest.mark.slow
@pytest.mark.parametrize("name", COMBINATIONS)
def test_the_package_moves_every_combination_alike(name):
    agrees(name, (0, 1))


@pytest.mark.slow
@pytest.mark.parametrize("name", MOVED)
def test_the_package_moves_every_structure_alike(name):
    agrees(name, (0, 1))
