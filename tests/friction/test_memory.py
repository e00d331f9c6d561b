"""What friction laws remember: hysteresis loops, energy, drift, and what the speed has to do with it."""

import numpy as np
import pytest
from marks import slow
from parts import (
    BlimanSorine,
    Bristle,
    Coulomb,
    Dahl,
    Elastoplastic,
    GeneralizedMaxwellSlip,
    LuGre,
    ResetIntegrator,
    SimplifiedLuGre,
    Stribeck,
)
from sliding import push, zigzag

INDEPENDENT = {
    "coulomb": Coulomb(),
    "dahl": Dahl(),
    "dahl, brittle": Dahl(exponent=0.5),
    "bliman and sorine": BlimanSorine(),
    "bristle": Bristle(bristles=8),
    "reset integrator": ResetIntegrator(beta=0.0),
    "maxwell without weakening": GeneralizedMaxwellSlip(weakened=1.0),
}
"""Laws that see the path only."""
PASSIVE = INDEPENDENT | {
    "stribeck": Stribeck(),
    "dahl, ductile": Dahl(exponent=2.0),
    "simplified lugre": SimplifiedLuGre(),
    "lugre with enough viscous friction": LuGre(f_c=0.5, f_s=0.7, sigma1=20.0, sigma2=8.0),
    "elastoplastic": Elastoplastic(f_c=0.6, f_s=0.6),
    "reset integrator": ResetIntegrator(),
}
"""Laws that cannot create energy; the bristles begin with some, which they may give back."""
TURNS = [1.1e-6, 0.2e-6, 0.9e-6, -1.4e-6, -0.3e-6, -0.5e-6, 2.5e-6, 2.4e-6, 2.45e-6, -0.1e-6, 0.1e-6, -3e-6, 0.0]
QUICK = "dahl, brittle", "elastoplastic", "reset integrator", "maxwell without weakening"


@pytest.mark.parametrize("name", [name if name in QUICK else slow(name) for name in PASSIVE])
def test_passive_laws_never_give_back_more_than_they_took(name):
    law = PASSIVE[name]
    speeds = [10.0 ** (-4 + i % 3) for i in range(len(TURNS))]
    work = zigzag(law, TURNS, speeds, samples=400).work()
    stored = 0.0
    if isinstance(law, Bristle):
        stored = 0.5 * law.sigma0 * float(np.mean(np.square(law.initial()[:-1])))
    assert work.min() > -stored - 1e-5 * work[-1]
    assert work[-1] > 1e-6


@pytest.mark.parametrize("name", ["lugre", slow("elastoplastic"), slow("maxwell")])
def test_laws_with_a_stribeck_curve_dissipate_in_moderate_motion_though_it_is_not_proved(name):
    law = {"lugre": LuGre(), "elastoplastic": Elastoplastic(), "maxwell": GeneralizedMaxwellSlip()}[name]
    work = zigzag(law, TURNS, [10.0 ** (-4 + i % 3) for i in range(len(TURNS))], samples=400).work()
    assert work.min() > -1e-5 * work[-1]


def test_lugre_gives_energy_away_where_its_condition_is_broken():
    """A slow slide stretches the bristle to f_s; a dash, for which only f_c is left, lets its damper push."""
    creates = LuGre(f_c=0.5, f_s=0.7, sigma1=45.0, sigma2=0.0)
    keeps = LuGre(f_c=0.5, f_s=0.7, sigma1=45.0, sigma2=45.0 * (0.7 - 0.5) / 0.5)
    turns, speeds = [5e-6, 5.2e-6], [1e-4, 100.0]
    assert zigzag(creates, turns, speeds, samples=1000).work()[-1] < 0.0
    assert zigzag(keeps, turns, speeds, samples=1000).work()[-1] > 0.0


@pytest.mark.parametrize("name", INDEPENDENT)
def test_rate_independent_laws_do_not_see_the_speed(name):
    law = INDEPENDENT[name]
    slow, fast = (zigzag(law, [0.7e-6, -1e-6, 0.4e-6], speed, samples=30) for speed in (1e-5, 1e-2))
    np.testing.assert_allclose(slow.force, fast.force, atol=1e-8)
    np.testing.assert_allclose(slow.x, fast.x, atol=1e-13)


def test_damping_makes_a_law_see_the_speed():
    for law in (SimplifiedLuGre(), LuGre(), Elastoplastic(), ResetIntegrator()):
        slow, fast = (zigzag(law, [0.3e-6, -0.3e-6], speed, samples=30) for speed in (1e-5, 1e-2))
        assert np.abs(slow.force - fast.force).max() > 0.1


def at_turns(law, turns: list[float]) -> np.ndarray:
    """The force [N] at the end of each leg of a slow path."""
    run = zigzag(law, turns, speed=1e-5, samples=2)
    return run.force[run.ends]


def test_maxwell_slip_closes_inner_loops_and_forgets_them():
    law = GeneralizedMaxwellSlip(weakened=1.0)
    outer = [0.9e-6, -0.5e-6, 0.9e-6]
    inner = [0.9e-6, 0.1e-6, 0.4e-6, 0.1e-6, -0.5e-6, 0.2e-6, -0.1e-6, 0.2e-6, 0.9e-6]
    plain, looped = at_turns(law, outer), at_turns(law, inner)
    assert looped[3] == pytest.approx(looped[1], abs=1e-9)  # the inner loop closes ...
    np.testing.assert_allclose([looped[4], looped[-1]], plain[1:], atol=1e-9)  # ... and leaves no trace


def test_maxwell_slip_unloads_along_the_virgin_curve_twice_as_large():
    law = GeneralizedMaxwellSlip(weakened=1.0)
    stiffness, strength = np.array([4e5, 3e5, 2e5, 1e5]), np.array([0.06, 0.14, 0.2, 0.25])
    virgin = lambda x: np.minimum(np.outer(x, stiffness), strength).sum(axis=1)
    run = zigzag(law, [1e-6, -1e-6], speed=1e-4)
    back = run.v < 0
    masing = virgin(np.array([1e-6])) - 2.0 * virgin(0.5 * (1e-6 - run.x[back]))
    np.testing.assert_allclose(run.force[back], masing, atol=1e-9)


@pytest.mark.parametrize("law", [Dahl(), LuGre(), BlimanSorine()], ids=str)
def test_laws_with_one_memory_do_not_close_an_inner_loop(law):
    before, _, after = at_turns(law, [0.9e-6, 0.1e-6, 0.4e-6, 0.1e-6])[1:]
    assert abs(after - before) > 5e-3


BIAS, SWING, CYCLES, FREQUENCY = 0.15, 0.13, 9, 60.0
"""A force [N] between 0.02 and 0.28, below breakaway for every law, below s0 z_ba = 0.33 for the elastoplastic one."""


def creep(law) -> np.ndarray:
    """Displacement [m] of a mass at the end of each cycle of the force, without the first two."""
    ramp = lambda t: min(t * FREQUENCY, 1.0) ** 2 * (3.0 - 2.0 * min(t * FREQUENCY, 1.0))
    force = lambda t: ramp(t) * (BIAS + SWING * np.sin(2.0 * np.pi * FREQUENCY * t))
    return push(law, force, np.arange(CYCLES) / FREQUENCY, mass=0.05, dashpot=300.0)[2:]


@pytest.mark.parametrize("law", [slow(Elastoplastic()), ResetIntegrator()], ids=str)
def test_these_laws_do_not_drift_under_a_force_that_swings_below_breakaway(law):
    seen = creep(law)
    assert seen[-1] > 1e-7
    assert np.abs(np.diff(seen)).max() < 1e-12


@pytest.mark.parametrize("law", [slow(GeneralizedMaxwellSlip()), slow(GeneralizedMaxwellSlip(weakened=1.0))], ids=str)
def test_maxwell_slip_creeps_less_and_less_and_not_for_ever(law):
    """It shakes down: the weak elements slip a little less in every cycle, and in the end none does."""
    steps = np.diff(creep(law))
    assert (steps[1:] < 0.7 * steps[:-1]).all()


@pytest.mark.parametrize("law", [slow(Dahl()), slow(SimplifiedLuGre()), LuGre(f_c=0.65, f_s=0.65)], ids=str)
def test_dahl_and_lugre_drift_under_such_a_force_as_far_as_the_closed_form_says(law):
    """dF = s0 (1 -+ F/f_c) dx up and down; dashpot and inertia only delay."""
    high, low = (BIAS + SWING) / 0.65, (BIAS - SWING) / 0.65
    each = 0.65e-6 * (np.log((1.0 - low) / (1.0 - high)) - np.log((1.0 + high) / (1.0 + low)))
    np.testing.assert_allclose(np.diff(creep(law)), each, rtol=0.02)
