"""Limit cases, balances and symmetries of the motion, and what the edges of a record do to it."""

from dataclasses import replace

import numpy as np
import pytest
from parts import AnisotropicLuGre, Sawtooth
from rigs import SAMPLES, trajectory
from scipy.integrate import cumulative_simpson, solve_ivp
from sliding import Contact

from pdssjax import Accuracy, Taylor
from pdssjax.integration import TIGHT
from tests.reference.independent import Rig

USUAL = Accuracy(method=Taylor(12))
FINE = replace(TIGHT, method=USUAL.method)
TIMES = 0.00031 + np.arange(SAMPLES) * 0.005
SAME = replace(Rig(), s0=(1e6, 1e6), s1=(45.0, 45.0), f_ss=(0.65, 0.65))


class NeverRepeating(Sawtooth):
    """A sawtooth that keeps its period to itself."""

    def period(self):
        return None


def test_what_never_slips_rides_along():
    run = trajectory(Rig(f_ss=(1e4, 1e4), s0=(1e8, 1e8), voltage=5.0), TIMES, USUAL)
    np.testing.assert_allclose(run.effector, run.platform, rtol=0.0, atol=5e-9)  # the bristles still give


@pytest.mark.slow
def test_a_heavy_platform_feels_no_friction():
    rigs = (Rig(reading="force", stack=1e6, feedback=feedback, fall=9e-4) for feedback in (False, True))
    free, coupled = (trajectory(rig, TIMES, USUAL) for rig in rigs)
    np.testing.assert_allclose(coupled.platform, free.platform, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(coupled.effector, free.effector, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("load", [0.0, -0.1])
def test_momentum_and_energy_are_balanced_with_feedback(load):
    """What voltage, friction and load give is what the masses have, sample by sample through a drop."""
    rig = Rig(reading="force", feedback=True, load=load, fall=9e-4)
    times = rig.cycle + 1e-5 * np.arange(SAMPLES)
    run = trajectory(rig, times, FINE)
    gathered = lambda rate: cumulative_simpson(rate, x=times, initial=0.0)
    stiffness = rig.stack * rig.frequency**2
    push = stiffness * (rig.gain * run.voltage - run.platform)
    push -= 2.0 * rig.damping * rig.frequency * rig.stack * run.platform_velocity + run.friction
    slid = run.platform_velocity - run.effector_velocity
    effector = rig.mass * (run.effector_velocity - run.effector_velocity[0])
    platform = rig.stack * (run.platform_velocity - run.platform_velocity[0])
    work = gathered((run.friction + load) * run.effector_velocity + push * run.platform_velocity)
    energy = 0.5 * (rig.mass * run.effector_velocity**2 + rig.stack * run.platform_velocity**2)
    for have, given in (
        (effector, gathered(run.friction + load)),
        (platform, gathered(push)),
        (energy - energy[0], work),
    ):
        np.testing.assert_allclose(have, given, rtol=0.0, atol=2e-3 * abs(given).max())
    assert gathered(run.friction * slid)[-1] > 0  # the slip has cost energy


def test_the_two_readings_agree_where_nothing_depends_on_direction():
    for load in (0.0, 0.1):
        rig = replace(SAME, load=load, fall=9e-4)
        runs = [trajectory(replace(rig, reading=reading), TIMES, FINE) for reading in ("deflection", "force")]
        np.testing.assert_allclose(runs[0].effector, runs[1].effector, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(runs[0].friction, runs[1].friction, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("reading", ["deflection", "force"])
@pytest.mark.parametrize("fall", [0.0, 9e-4])
def test_backward_is_forward_in_the_mirror(reading, fall):
    """From the third cycle on: the first one of a forward drive is slower, with no fast flank."""
    there = Rig(reading=reading, fall=fall)
    back = replace(there, forward=False, s0=there.s0[::-1], s1=there.s1[::-1], f_ss=there.f_ss[::-1])
    times = 2.0 * there.cycle + np.arange(SAMPLES) * 0.0034
    forward, backward = (np.asarray(trajectory(rig, times, FINE).effector) for rig in (there, back))
    np.testing.assert_allclose(forward - forward[0], backward[0] - backward, rtol=0.0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("rig", [Rig(fall=9e-4), Rig(load=-0.1, forward=False)], ids=["forward", "stuck backward"])
def test_repeated_cycles_are_those_that_are_marched(rig):
    times = np.linspace(0.01, 1.6, SAMPLES)
    repeated, marched = trajectory(rig, times, Accuracy()), trajectory(rig, times, Accuracy(), drive=NeverRepeating)
    assert (bool(repeated.repeated), bool(marched.repeated)) == (True, False)
    assert int(repeated.steps) < 0.6 * int(marched.steps)
    np.testing.assert_allclose(repeated.effector, marched.effector, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(repeated.platform, marched.platform, rtol=0.0, atol=1e-11)


def test_before_the_drive_all_is_at_rest():
    run = trajectory(Rig(), np.linspace(-0.3, -0.01, SAMPLES), USUAL)
    assert int(run.failure) == 0
    assert not np.any([run.voltage, run.platform, run.effector, run.effector_velocity])
    partly = trajectory(Rig(), np.linspace(-0.1, 0.1, SAMPLES), USUAL)
    assert not partly.effector[:60].any()
    assert partly.effector[61:].all()


@pytest.mark.parametrize("end", [0.2, 0.2004, 0.2009, 0.4, 0.40001])
@pytest.mark.parametrize("fall", [0.0, 9e-4])
def test_where_a_record_ends_changes_nothing_before(end, fall):
    times = np.linspace(end - 0.01, end, SAMPLES)
    short = trajectory(Rig(fall=fall), times, FINE)
    long = trajectory(Rig(fall=fall), np.append(times[:-1], 0.6), FINE)
    assert int(short.failure) == 0
    np.testing.assert_allclose(short.effector[:-1], long.effector[:-1], rtol=0.0, atol=1e-13)


def test_without_voltage_and_load_nothing_moves():
    run = trajectory(Rig(voltage=0.0), TIMES, USUAL)
    assert int(run.failure) == 0
    assert not run.effector.any()


FIELDS = "gain frequency damping mass s0 s1 f_ss voltage cycle fall".split()


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("factor", [0.01, 100.0])
@pytest.mark.parametrize("base", [Rig(fall=9e-4), Rig(reading="force", feedback=True, load=-0.1, fall=9e-4)], ids=str)
def test_a_trial_far_off_ends_finite_or_says_why(base, field, factor):
    value = getattr(base, field)
    rig = replace(base, **{field: tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value})
    run = trajectory(rig, TIMES, USUAL)
    everything = np.stack([run.platform, run.effector, run.effector_velocity, run.friction])
    assert np.isfinite(everything).all() if int(run.failure) == 0 else np.isnan(everything).all()
    assert int(run.rejected) <= int(run.steps)


def work_of_a_loop(law: AnisotropicLuGre, side: float) -> float:
    """Energy [J] that a bristle swallows when pulled slowly to one side and let back."""
    stiff = law.sigma0_a if side > 0 else law.sigma0_b
    contact = Contact(law)
    pulled = 0.02 * 0.5 / stiff  # far below breakaway
    creep = 1e-7

    def rates(v):
        def field(_, x):
            state, sign = x[:1], np.sign(v)
            return [contact.rate(state, v, sign)[0], contact.force(state, v, sign) * v]

        return field

    there = solve_ivp(rates(side * creep), (0.0, pulled / creep), [0.0, 0.0], rtol=1e-8, atol=1e-20)
    unloaded = lambda t, x: side * x[0]
    unloaded.terminal = True
    back = solve_ivp(
        rates(-side * creep), (0.0, 9.0 * pulled / creep), there.y[:, -1], rtol=1e-8, atol=1e-20, events=unloaded
    )
    assert back.t_events[0].size == 1
    return back.y[1, -1] / (0.5 * stiff * pulled**2)


@pytest.mark.parametrize(("reading", "creates"), [("deflection", -1.0), ("force", 1.0)])
def test_neither_reading_is_passive_where_the_stiffness_depends_on_direction(reading, creates):
    """With s0a > s0b the deflection state gains energy on the side z < 0, the force state on the other."""
    a, b = 1.1484e6, 0.953789e6
    law = AnisotropicLuGre(a, b, 1e-3, 1e-3, 0.7964, 0.5458, reading)
    loops = {side: work_of_a_loop(law, side) for side in (1.0, -1.0)}
    assert loops[creates] < -0.1
    assert loops[-creates] > 0.1
    expected = {"deflection": {1.0: 1 - b / a, -1.0: 1 - a / b}, "force": {1.0: 1 - a / b, -1.0: 1 - b / a}}[reading]
    assert loops == pytest.approx(expected, abs=0.03)
    same = AnisotropicLuGre(a, a, 1e-3, 1e-3, 0.7, 0.7, reading)
    assert min(work_of_a_loop(same, side) for side in (1.0, -1.0)) > 0.0
