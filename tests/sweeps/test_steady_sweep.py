"""The steady cycle of a sweep is the cycle after very many."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from quick_blocks import example_study

import pdssjax
from benchmarks.maps import net_step_after
from experiments.random_actuators import Structure
from pdssjax import Accuracy, InputError
from pdssjax.core import member, members
from pdssjax.integration import integrate_to_times
from pdssjax.study.parameter import Parameter
from pdssjax.sweeps import Listed, plan_sweep
from pdssjax.sweeps.job import job_document, point_function

POINTS = {"drive.voltage": [30.0, 64.0, 150.0, 80.0], "drive.frequency": [5.0, 50.0, 120.0, 250.0]}


@pytest.fixture(scope="module")
def study():
    return example_study()


@pytest.fixture(scope="module")
def data(study):
    return pdssjax.sweep(study, Listed(POINTS), cycles="steady", workers=1)


def test_a_steady_sweep_says_after_how_many_cycles_the_motion_repeats(data):
    assert data.attrs["cycles"] == "steady" and not data.failure.any()
    assert (data.cycles_to_repeat == 1).all()
    # At 5 Hz all has come to rest before the next drop; at 250 Hz it still rings.
    assert float(data.decay[0]) < 1e-3 < float(data.decay[3]) < 1.0
    np.testing.assert_allclose(data.net_step, data.speed / data.drive_frequency)
    np.testing.assert_allclose(data.back_slip, data.stroke - data.net_step)


def test_a_job_that_is_steady_is_rebuilt_from_its_text(study):
    planned = plan_sweep(study, POINTS, cycles="steady")
    assert planned.document["cycles"] == "steady"
    assert job_document(point_function(planned.document)) == planned.document


@pytest.mark.parametrize("cycles", ["stead", 0])
def test_another_word_is_refused(study, cycles):
    with pytest.raises(InputError, match='expected a number of at least 1, or "steady"'):
        pdssjax.sweep(study, POINTS, cycles=cycles)


@pytest.mark.slow
def test_random_points_agree_with_200_cycles(study):
    rng = np.random.default_rng(5)
    points = Listed({"drive.voltage": rng.uniform(8.0, 150.0, 12), "drive.frequency": 10 ** rng.uniform(0.7, 2.4, 12)})
    for reading in ("deflection", "force"):
        asked = dataclasses.replace(study, friction_state=reading)
        data = pdssjax.sweep(asked, points, cycles="steady", workers=1)
        brute = net_step_after(plan_sweep(asked, points, cycles="steady").function)
        expected = np.array([float(brute(values)) for values in points.values()])
        np.testing.assert_allclose(data.net_step, expected, rtol=0.0, atol=1e-10)


def random_actuators(law, state, count):
    """A study of a law with its nominal numbers, and points at which all of them, drive and direction are drawn."""
    structure, random = Structure(friction=law, state=state), np.random.default_rng([9, *law.encode(), *state.encode()])
    changed = dict(friction=member("friction", law), friction_state=state or "deflection", parameters={})
    study = dataclasses.replace(example_study(), **changed)
    legal = study.legal()
    parameters = {
        path: Parameter(path, legal[path].unit, legal[path], value=legal[path].nominal)
        for path in legal
        if path.split(".")[0] in ("piezo", "friction", "effector")
    }
    factors = np.exp(0.4 * random.uniform(-1.0, 1.0, (count, len(structure.nominal))))
    columns = {path: value * factors[:, i] for i, (path, value) in enumerate(structure.nominal.items())}
    columns["drive.voltage"] = random.uniform(8.0, 150.0, count)
    columns["drive.frequency"] = 10 ** random.uniform(0.3, 2.4, count)
    columns["drive.direction"] = random.choice([-1.0, 1.0], count)
    return dataclasses.replace(study, parameters=parameters), Listed(columns)


ASIDE = {"bristle": "every tooth of its force is an event, thousands a cycle: minutes a point"}
"""Laws that are not compared, and why."""
LAWS = [(law, "") for law in sorted(members("friction")) if law not in (*ASIDE, "anisotropic-lugre")]
LAWS += [("anisotropic-lugre", "deflection"), ("anisotropic-lugre", "force")]


@pytest.mark.slow
@pytest.mark.parametrize(("law", "state"), LAWS)
def test_random_actuators_of_every_law_agree_with_200_cycles(law, state):
    study, points = random_actuators(law, state, 9)
    data = pdssjax.sweep(study, points, cycles="steady", workers=1)
    brute = net_step_after(plan_sweep(study, points).function)
    expected = np.array([float(brute(values)) for values in points.values()])
    told = data.failure == 0
    assert told.sum() >= 8
    np.testing.assert_allclose(data.net_step[told], expected[told], rtol=0.0, atol=1e-10)


@pytest.mark.slow
def test_a_transient_that_dies_out_slowly_is_left_to_newton(study):
    light = study.with_values({"piezo.damping_ratio": 0.004, "friction.sigma1_a": 1.0, "friction.sigma1_b": 1.0})
    points = Listed({"drive.voltage": [3.0, 3.0], "drive.frequency": [150.0, 200.0]})
    data = pdssjax.sweep(light, points, cycles="steady", workers=1)
    brute = net_step_after(plan_sweep(light, points).function, 1000)
    expected = [float(brute(values)) for values in points.values()]
    assert (data.decay > 0.7).any() and (data.cycles_to_repeat == 1).all()
    np.testing.assert_allclose(data.net_step, expected, rtol=0.0, atol=1e-10)


@pytest.mark.slow
def test_multipliers_are_the_decay_observed(study):
    """A deviation from a steady cycle shrinks as the largest multiplier says, on average: a pair of them beats."""
    light = study.with_values({"piezo.damping_ratio": 0.01, "friction.sigma1_a": 3.0, "friction.sigma1_b": 3.0})
    random = np.random.default_rng(8)
    points = Listed({"drive.voltage": random.uniform(8.0, 60.0, 8), "drive.frequency": random.uniform(150.0, 250.0, 8)})
    data = pdssjax.sweep(light, points, cycles="steady", metrics=("multiplier",), workers=1)
    function = plan_sweep(light, points).function

    @jax.jit
    def shifts(values):
        system = function.system(values)
        times = jnp.arange(1, 62) / system.drive.cycle_frequency() * (1.0 - 1e-12)
        reached = integrate_to_times(system, times, Accuracy(1e-13, 1e-14, max_steps=400_000)).x
        x = jnp.stack([*jax.tree.leaves(reached.driven), reached.v])
        # The states are in metres, once time is counted in the slowest oscillation's 1/w.
        scale = jnp.stack([*jax.tree.leaves(system.state_scale().driven), system.state_scale().v])
        return jnp.linalg.norm(jnp.diff(x, axis=1) * scale[:, None], axis=0)

    compared = 0
    for values, multiplier in zip(points.values(), data.multiplier.values, strict=True):
        away = np.asarray(shifts(values))
        seen = np.arange(60)[(away > 1e-12) & (away < 1e-3 * away.max())]
        if seen.size >= 12:
            compared += 1
            assert np.exp(np.polyfit(seen, np.log(away[seen]), 1)[0]) == pytest.approx(multiplier, rel=0.02)
    assert compared >= 4
