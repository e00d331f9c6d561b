"""The amplifier: its bandwidth, its slew limit, where the one gives way to the other, and the derivatives in both."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from parts import BoucWen, Sawtooth, SecondOrder, SimplifiedLuGre, Sine, Static, Step
from scipy.integrate import solve_ivp

from pdssjax import Actuator, Amplifier, Effector, Stop, Taylor
from pdssjax.actuator import DrivenPlatform
from pdssjax.integration import TIGHT, integrate_steps, states_at
from pdssjax.simulation import PlatformOnly, StickSlip

FINE = dataclasses.replace(TIGHT, method=Taylor(10))
W, XI, C = 6736.0, 0.1772, 1.007e-7
SAMPLES = 100
"""Of every record: another number would be compiled anew."""


@jax.jit
def behind(piezo, amplifier, drive, times):
    """The voltage that reaches the piezo [V], the platform [m], and the run: one program a piezo and a waveform."""
    assert times.shape == (SAMPLES,)
    system = PlatformOnly(DrivenPlatform(piezo, amplifier), drive)
    run = integrate_steps(system, times[-1], FINE)
    x, *_ = states_at(system, run, times)
    return x.driven.supply[0], jax.vmap(system.shown_displacement)(x), run


@jax.jit
def with_slopes(numbers, drive, times):
    """The derivatives of the platform by bandwidth and slew, and what `behind` gives: one program for both."""

    def both(numbers):
        found = behind(SecondOrder(), Amplifier(numbers[0], numbers[1]), drive, times)
        return found[1], found

    return jax.jacfwd(both, has_aux=True)(numbers)


def output(amplifier, drive, times):
    """The voltage that reaches a second-order piezo [V], its platform [m], and the run."""
    numbers, times = jnp.asarray([amplifier.bandwidth, amplifier.slew]), jnp.asarray(times)
    if isinstance(drive, Sawtooth):
        return with_slopes(numbers, drive, times)[1]
    return behind(SecondOrder(), amplifier, drive, times)


def step(volts):
    """A step, as a sawtooth that jumps and then hardly falls: a `Step` would be compiled anew."""
    return Sawtooth(volts, 1e-13, direction=-1.0)


def test_a_small_sine_follows_the_transfer_function_of_first_order():
    frequency, bandwidth = 800.0, 1200.0
    times = np.linspace(0.02, 0.03, SAMPLES)
    shown, _, run = output(Amplifier(bandwidth, 1e9), Sine(2.0, frequency), times)
    w = 2 * np.pi * frequency
    transfer = 1.0 / (1.0 + 1j * frequency / bandwidth)
    np.testing.assert_allclose(shown, 1.0 - np.real(transfer * np.exp(1j * w * times)), rtol=0.0, atol=1e-9)
    assert int(run.events) == 0


def test_a_large_step_rises_at_the_slew_rate_and_ends_exponentially():
    slew, bandwidth, volts = 2e5, 5e3, 60.0
    pole = 2 * np.pi * bandwidth
    turns = (volts - slew / pole) / slew
    times = np.linspace(0.0, 6e-4, SAMPLES + 1)[1:]
    shown, _, run = output(Amplifier(bandwidth, slew), step(volts), times)
    expected = np.where(times < turns, slew * times, volts - slew / pole * np.exp(-pole * (times - turns)))
    # A local error of 1e-14 m, as `TIGHT` allows, is 1e-7 V here.
    np.testing.assert_allclose(shown, expected, rtol=0.0, atol=1e-8)
    assert int(run.events) == 1
    ends = (run.steps.t_local + run.steps.duration)[: int(run.count)]
    assert float(jnp.min(jnp.abs(ends - turns))) < 1e-18


def followed(bandwidth, slew, pieces, times):
    """Platform displacement [m] by SciPy: (begin, end, command) pieces, the slew limit as it is defined."""
    pole = 2 * np.pi * bandwidth

    def field(t, x, command):
        slope = np.clip(pole * (command(t) - x[2]), -slew, slew)
        return [x[1], W**2 * (C * x[2] - x[0]) - 2 * XI * W * x[1], slope]

    x, out = np.zeros(3), []
    for begin, end, command in pieces:
        inside = [float(t) for t in times if begin < t <= end]
        stops = sorted({*inside, end})
        tight = dict(method="DOP853", rtol=1e-11, atol=[1e-17, 1e-14, 1e-10], max_step=2e-5)
        solved = solve_ivp(field, (begin, end), x, args=(command,), t_eval=stops, **tight)  # pyright: ignore
        out += [y for y, t in zip(solved.y[0], stops, strict=True) if t in inside]
        x = solved.y[:, -1]
    return np.array(out)


CASES = {
    "step": (step(60.0), [(0.0, 0.01, lambda t: 60.0)]),
    "sawtooth": (
        Sawtooth(64.0, 200.0),
        [(k * 0.005, (k + 1) * 0.005, lambda t, k=k: 64.0 * (t / 0.005 - k)) for k in range(3)],
    ),
    "sine": (Sine(64.0, 1000.0), [(0.0, 0.008, lambda t: 32.0 * (1 - np.cos(2e3 * np.pi * t)))]),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(("bandwidth", "slew"), [(3e3, 1e9), (3e3, 1.2e5)])
def test_the_platform_behind_it_moves_as_scipy_has_it(name, bandwidth, slew):
    drive, pieces = CASES[name]
    times = jnp.linspace(0.0, pieces[-1][1], SAMPLES + 1)[1:]
    _, shown, _ = output(Amplifier(bandwidth, slew), drive, times)
    np.testing.assert_allclose(shown, followed(bandwidth, slew, pieces, times), rtol=0.0, atol=2e-11)


@pytest.mark.parametrize(
    "drive",
    [pytest.param(Step(60.0), marks=pytest.mark.slow, id="step"), pytest.param(Sawtooth(64.0, 200.0), id="sawtooth")],
)
def test_the_platform_has_the_derivatives_of_central_differences_in_bandwidth_and_slew(drive):
    times = jnp.linspace(1e-4, 0.012, SAMPLES)
    motion = lambda q: with_slopes(q, drive, times)[1][1]
    nominal = jnp.asarray([3e3, 4e5])
    slopes = with_slopes(nominal, drive, times)[0]
    for i in range(2):
        step = 1e-5 * nominal * jnp.eye(2)[i]
        expected = (motion(nominal + step) - motion(nominal - step)) / (2e-5 * nominal[i])
        assert float(jnp.abs(expected).max()) > 0
        np.testing.assert_allclose(slopes[:, i], expected, rtol=0.0, atol=1e-5 * float(jnp.abs(expected).max()))


def test_a_static_platform_shows_what_the_amplifier_gives():
    times = jnp.linspace(0.0, 0.012, SAMPLES + 1)[1:]
    amplifier = Amplifier(3e3, 4e5)
    static: Any = Static
    _, shown, _ = behind(static(), amplifier, Sawtooth(64.0, 200.0), times)
    volts, *_ = output(amplifier, Sawtooth(64.0, 200.0), times)
    np.testing.assert_allclose(shown, C * volts, rtol=0.0, atol=1e-14)


@pytest.mark.slow
def test_hysteresis_behind_it_learns_that_the_voltage_turns_at_a_corner_of_the_command():
    times = np.linspace(0.0, 0.012, SAMPLES + 1)[1:]
    a, b, g, bandwidth = 0.3, 0.03, 0.01, 3e3
    _, shown, _ = behind(BoucWen(), Amplifier(bandwidth, 1e9), Sawtooth(64.0, 200.0), jnp.asarray(times))

    def field(t, x, k):
        slope = 2 * np.pi * bandwidth * (64.0 * (t / 0.005 - k) - x[2])
        lags = a * C * slope - b * abs(slope) * x[3] - g * slope * abs(x[3])
        return [x[1], W**2 * (C * x[2] - x[3] - x[0]) - 2 * XI * W * x[1], slope, lags]

    x, out = np.zeros(4), []
    for k in range(3):
        inside = [float(t) for t in times if k * 0.005 < t <= (k + 1) * 0.005]
        stops = sorted({*inside, (k + 1) * 0.005})
        tight = dict(method="DOP853", rtol=1e-11, atol=[1e-17, 1e-14, 1e-10, 1e-17], max_step=1e-5)
        solved = solve_ivp(field, (k * 0.005, (k + 1) * 0.005), x, args=(k,), t_eval=stops, **tight)  # pyright: ignore
        out += [y for y, t in zip(solved.y[0], stops, strict=True) if t in inside]
        x = solved.y[:, -1]
    np.testing.assert_allclose(shown, out, rtol=0.0, atol=2e-11)


@pytest.mark.parametrize("slews", [0.0, 1.0, -1.0])
@pytest.mark.parametrize("which", [-2.0, -1.0, 2.0, 3.0])
def test_events_of_other_parts_leave_it_as_it_is(slews, which):
    driven = DrivenPlatform(SecondOrder(), Amplifier(3e3, 4e5))
    x = driven.initial()._replace(supply=(jnp.asarray(20.0), jnp.asarray(slews)))
    after = driven.after_event(Sawtooth(64.0, 200.0).segment(jnp.zeros(())), 1e-3, x, jnp.asarray(which))
    assert [float(number) for number in after.supply] == [20.0, slews]


@pytest.mark.slow
def test_a_stop_that_is_met_and_left_changes_nothing_of_what_the_amplifier_gives():
    """Nor its derivatives: each touch had set it slewing for an instant, the wrong way."""
    times, drive = jnp.linspace(1e-4, 0.012, SAMPLES), Sawtooth(64.0, 200.0)

    def volts(numbers, stopped):
        driven = DrivenPlatform(SecondOrder(), Amplifier(numbers[0], numbers[1]))
        actuator = Actuator(driven.piezo, SimplifiedLuGre(), Effector(), False, driven.amplifier, Stop(1e5, gap=4e-7))
        system = StickSlip(actuator, drive) if stopped else PlatformOnly(driven, drive)
        run = integrate_steps(system, times[-1], FINE)
        x, *_ = states_at(system, run, times)
        return x.driven.supply[0], (x.driven.supply[0], x.in_contact[0] if stopped else None)

    slopes = jax.jit(jax.jacfwd(volts, has_aux=True), static_argnums=1)
    (found, (shown, in_contact)), (expected, (alone, _)) = (slopes(jnp.array([3e3, 4e4]), s) for s in (True, False))
    assert np.abs(np.diff(in_contact)).sum() > 2
    np.testing.assert_allclose(shown, alone, rtol=0.0, atol=1e-6)
    largest = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(found / largest, expected / largest, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("ulps", [-4, -1, 0, 1, 4])
def test_at_a_corner_at_which_the_contact_rests_the_bend_tells_where_it_goes(ulps):
    # Behind an amplifier neither velocity nor acceleration nor its rate jump there, and the margins are rounding.
    drive = Sawtooth(64.0, 20.0, 2e-4)
    stack, law = SecondOrder(), SimplifiedLuGre(sigma0=1.1e6, sigma1=220.0, f_ss=0.6)
    amplifier = Amplifier(bandwidth=7400.0, slew=1e9)
    system = StickSlip(Actuator(stack, law, Effector(), amplifier=amplifier), drive)
    slow, fast = (system.segment(jnp.asarray(float(index))) for index in (3, 4))
    platform = system.actuator.driven_platform
    rest = platform.steady(slow, slow.duration, platform.initial(), 0.0)
    voltage = rest.supply[0] * (1.0 + ulps * np.finfo(float).eps)
    x = system.initial()._replace(driven=rest._replace(supply=(voltage, rest.supply[1])))
    _, mode = system.on_segment_start(fast, x, jnp.asarray(2.0))
    assert float(mode) == -1.0
