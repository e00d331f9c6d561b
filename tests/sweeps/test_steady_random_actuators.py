"""Steady cycles of random actuators of every law are those after very many, with their derivatives and multipliers."""

from itertools import combinations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from random_sweeps import random_actuators

import pdssjax
from benchmarks.maps import net_step_after
from pdssjax import Accuracy
from pdssjax.core import members
from pdssjax.integration import integrate_to_times
from pdssjax.sweeps import Listed, plan_sweep

ASIDE = {"bristle": "its cycles never repeat where a bond snaps (tests/simulation/test_steady.py)"}
"""Laws that are not compared, and why."""
LAWS = [(law, "") for law in sorted(members("friction")) if law not in (*ASIDE, "anisotropic-lugre")]
LAWS += [("anisotropic-lugre", "deflection"), ("anisotropic-lugre", "force")]
pytestmark = [pytest.mark.slow, pytest.mark.parametrize(("law", "state"), LAWS)]
LATE = 200
"""So many cycles show how a transient dies out."""
SLOW = 0.85
"""Points with larger multipliers take too many cycles until one is steady."""
FAST = 0.08
"""Points with smaller multipliers are compared apart: their cycles are steady soon."""
LEFT = 1e-13
"""Of a transient, at a cycle that counts as steady."""
STEPS = (3e-3, 1e-3, 3e-5)
"""Of differences, relative: one of them is small enough for the fastest ripple and large enough for rounding."""
ASKED = 1e-5
"""Of derivative and metric."""
CLIFF = 5e-6
"""Where no two sizes of step agree better, the differences have no limit to compare with.

Saturations of Dahl's law that parameters 4e-5 and less away bring about move a net step of 0.35 um by 1.3e-14 m.
"""
PARTS = (-1.0, -0.5, 0.5, 1.0)
ROUNDING = 1e-12
"""Shifts [m] below this do not shrink evenly."""


@pytest.fixture(autouse=True)
def forget_compiled_code():
    """Of a law that is done with: that of all together takes 20 GB."""
    yield
    jax.clear_caches()


def test_net_steps_are_those_after_200_cycles(law, state):
    study, columns = random_actuators(law, state, 9)
    points = Listed(columns)
    data = pdssjax.sweep(study, points, cycles="steady", workers=1)
    brute = net_step_after(plan_sweep(study, points).function)
    expected = np.array([float(brute(values)) for values in points.values()])
    told = data.failure == 0
    assert told.sum() >= 8
    np.testing.assert_allclose(data.net_step[told], expected[told], rtol=0.0, atol=1e-10)


def test_derivatives_are_those_of_late_cycles(law, state):
    # Four elements of generalized Maxwell slip take half an hour of 16.
    count = 8 if law == "generalized-maxwell-slip" else 16
    study, here = random_actuators(law, state, count)
    found, by = with_derivatives(study, here)
    told = (found.failure.values == 0) & (found.multiplier.values < SLOW)
    fast = told & (found.multiplier.values < FAST)
    assert told.sum() >= 0.75 * count
    for chosen in (fast, told & ~fast):
        if chosen.any():
            assert_right(*derivative_errors(study, here, by, found, chosen))


def test_derivatives_are_those_of_late_cycles_and_multipliers_the_decay_seen(law, state):
    study, here = random_actuators(law, state, 6, slowly=True)
    found, by = with_derivatives(study, here)
    told = (found.failure.values == 0) & (found.multiplier.values < SLOW)
    assert told.sum() >= 2
    assert_right(*derivative_errors(study, here, by, found, told))
    points = Listed(here)
    function = plan_sweep(study, points).function
    moduli = np.stack([multipliers(function, values) for values in points.values()])
    np.testing.assert_allclose(moduli[:, 0], found.multiplier.values, rtol=1e-6)
    seen = np.array([decay_seen(function, values) for values in points.values()])
    compared = np.isfinite(seen) & (found.failure.values == 0)
    # What a transient is made of may leave the slowest out, for as long as it can be seen.
    assert (np.abs(moduli / seen[:, None] - 1.0).min(axis=1)[compared] < 2e-3).all()
    assert (np.abs(moduli[:, 0] / seen - 1.0)[compared] < 2e-3).sum() >= max(1, compared.sum() - 1)


def assert_right(errors, cliffs):
    """All but those at a cliff, of which there is one point at most."""
    assert ((errors < ASKED) | cliffs).all()
    assert cliffs.any(axis=(0, 1)).sum() <= 1


def with_derivatives(study, here):
    """Steady cycles with derivatives by every column but the direction, and these."""
    by = [path for path in here if path != "drive.direction"]
    metrics = ("multiplier",)
    return pdssjax.sweep(study, Listed(here), cycles="steady", derivatives=by, metrics=metrics, workers=1), by


@eqx.filter_jit
def multipliers(function, values):
    system = function.system(jnp.asarray(values))
    return pdssjax.steady_cycle(system.actuator, system.drive).multipliers


def derivative_errors(study, here, by, found, chosen):
    """Of net step and stroke by each path at the points `chosen`, beside the sizes of derivative and metric.

    The derivatives are found by (I - M)^-1; a late cycle has them from every cycle before it.  And which are off
    where the differences are of each other, too: at a cliff.
    """
    found, here = found.isel(point=chosen), {path: column[chosen] for path, column in here.items()}
    rows = [here | {path: (1.0 + step * part) * here[path]} for path in by for step in STEPS for part in PARTS]
    points = Listed({path: np.concatenate([row[path] for row in rows]) for path in here})
    cycles = int(np.ceil(np.log(LEFT) / np.log(max(1e-3, found.multiplier.values.max()))))
    # Steps of 1e-15 m would share what courses lose of a net step that is the difference of far longer motions.
    fine = Accuracy(tolerance=1e-17, max_steps=1_000_000)
    moved, count = pdssjax.sweep(study, points, cycles=cycles, accuracy=fine, workers=1), found.failure.size
    errors, cliffs = [], []
    for name in ("net_step", "stroke"):
        at = moved[name].values.reshape(len(by), len(STEPS), len(PARTS), count)
        slopes = np.stack([found[f"{name}_by_{path.replace('.', '_')}"].values * here[path] for path in by])
        differences = [
            (4.0 * (at[:, k, 2] - at[:, k, 1]) / step - (at[:, k, 3] - at[:, k, 0]) / (2.0 * step)) / 3.0
            for k, step in enumerate(STEPS)
        ]
        size = np.abs(found[name].values)
        apart = [np.abs(slopes - difference) / (np.abs(difference) + size) for difference in differences]
        between = [np.abs(first - second) / (np.abs(first) + size) for first, second in combinations(differences, 2)]
        error = np.min(apart, axis=0)
        errors.append(error)
        cliffs.append((error >= ASKED) & (np.min(between, axis=0) > CLIFF))
    return np.stack(errors), np.stack(cliffs)


@eqx.filter_jit
def shifts(function, values):
    """How far the states at the openings of cycles are from those a cycle earlier, shape (components, cycles) [m]."""
    system = function.system(values)
    times = jnp.arange(1, LATE + 2) / system.drive.cycle_frequency() * (1.0 - 1e-12)
    reached = integrate_to_times(system, times, Accuracy(1e-14, 1e-15, max_steps=800_000)).x
    x = jnp.stack([*jax.tree.leaves(reached.driven), reached.v])
    # The states are in metres, once time is counted in the slowest oscillation's 1/w.
    scale = jnp.stack([*jax.tree.leaves(system.state_scale().driven), system.state_scale().v])
    return jnp.diff(x, axis=1) * scale[:, None]


def decay_seen(function, values):
    """By what the last shifts before rounding shrink: a recurrence of second order, of the two largest multipliers.

    NaN where they are gone too soon, or where a third one is seen.
    """
    shift = np.asarray(shifts(function, values))
    size = np.linalg.norm(shift, axis=0)
    late = np.flatnonzero((size[:-2] < 1e-4 * size.max()) & (size[2:] > ROUNDING))
    if late.size < 8:
        return np.nan
    late = late[-8:]
    two = np.concatenate([shift[:, [k, k + 1]] / size[k] for k in late])
    third = np.concatenate([shift[:, k + 2] / size[k] for k in late])
    # Where one multiplier is left the least coefficients are taken: the second root is smaller then.
    last, first = np.linalg.lstsq(two, third, rcond=1e-3)[0]
    alone = np.linalg.norm(two @ [last, first] - third) < 1e-3 * np.linalg.norm(third)
    return np.abs(np.roots([1.0, -first, -last])).max() if alone else np.nan
