"""What every hybrid system keeps, along a run of its own.

A system in `pdssjax/simulation/systems/NAME.py` is found by its file; `tests/simulation/systems/NAME.py` makes one
of it, as a function of a factor near 1 with which its events move, and where it settles one that does, `settling`.
"""

import functools
import importlib.util
import pkgutil
from pathlib import Path
from types import ModuleType

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pdssjax import AbstractHybridSystem, Accuracy, Taylor
from pdssjax.integration import SETTLED, integrate_steps, states_at
from pdssjax.simulation import systems

NAMES = [found.name for found in pkgutil.iter_modules(systems.__path__) if not found.name.startswith("_")]
TOLERANCE = 1e-12
USUAL = Accuracy(method=Taylor(8), tolerance=TOLERANCE, settle_tolerance=TOLERANCE, max_steps=4096)
INSIDE = (0.1, 0.5, 0.9)


def example(name: str) -> ModuleType:
    path = Path(__file__).parents[1] / "simulation" / "systems" / f"{name}.py"
    found = importlib.util.spec_from_file_location(f"example_{name}", path)
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


@functools.cache
def run_of(name: str):
    """The system, and a compiled function of the factor: its run, and the derivative of the begins of its steps."""
    made = example(name)

    def begins(factor):
        run = integrate_steps(made.system(factor), jnp.asarray(made.HORIZON), USUAL)
        return run.steps.origin + run.steps.t_local, run

    def with_derivative(factor):
        times, slopes, run = jax.jvp(begins, (factor,), (jnp.ones(()),), has_aux=True)
        return times, slopes, run

    return made.system(1.0), jax.jit(with_derivative)


@functools.cache
def steps_of(name: str):
    system, run = run_of(name)
    found = run(jnp.ones(()))[2]
    assert int(found.failure) == 0
    return system, found, jax.tree.map(lambda a: np.asarray(a)[: int(found.count)], found.steps)


@pytest.mark.parametrize("name", NAMES)
def test_a_system_has_an_example_whose_events_are_located(name):
    system, run, _ = steps_of(name)
    assert isinstance(system, AbstractHybridSystem)
    assert int(run.events) > 3


@pytest.mark.parametrize("name", NAMES)
def test_rates_and_scales_have_the_shape_of_the_state(name):
    system, _, steps = steps_of(name)
    first, structure = system.initial(), jax.tree.structure(system.initial())
    segment = system.segment(jnp.zeros(()))
    for mode in np.unique(steps.mode):
        assert jax.tree.structure(system.field(segment, 0.0, first, mode)) == structure
    scales = np.array(jax.tree.leaves(system.state_scale()), float)
    assert jax.tree.structure(system.state_scale()) == structure
    assert np.isfinite(scales).all()
    assert (scales > 0.0).all()


@functools.cache
def inside_states(name: str):
    """Along the run: state, rate by the polynomial, rate by the field, guards, length of the step and mode."""
    system, _, steps = steps_of(name)
    structure = jax.tree.structure(system.initial())

    @jax.jit
    @jax.vmap
    def look(step):
        def at(part):
            polynomial = lambda time: jnp.stack([jnp.polyval(c[::-1], time) for c in step.polynomials])
            values, slopes = jax.jvp(polynomial, (part * step.duration,), (jnp.ones(()),))
            state = jax.tree.unflatten(structure, list(values))
            place = (system.segment(step.index), step.t_local + part * step.duration, state, step.mode)
            rates = jnp.stack([jnp.asarray(rate, float) for rate in jax.tree.leaves(system.field(*place))])
            guards = jnp.stack([jnp.asarray(guard, float) for guard in system.guards(*place)])
            return values, slopes, rates, guards

        return jax.tree.map(lambda *found: jnp.stack(found), *(at(part) for part in (*INSIDE, 1.0)))

    walked = jax.tree.map(lambda a: a[(steps.duration > 0.0) & (steps.mode != SETTLED)], steps)
    return system, walked, jax.tree.map(np.asarray, look(walked))


@pytest.mark.parametrize("name", NAMES)
def test_inside_a_mode_the_field_is_smooth_and_guards_are_positive(name):
    system, steps, (_, slopes, rates, guards) = inside_states(name)
    scales = np.array(jax.tree.leaves(system.state_scale()), float)
    off = np.abs(slopes - rates)[:, :-1] * scales * steps.duration[:, None, None]
    assert off.max() < 100.0 * TOLERANCE
    size = np.abs(guards).max(axis=(0, 1))
    assert (guards[:, :-1] > -1e-9 * size).all()


def settling(name: str):
    """The example of a system that settles, if its file has one: system and run."""
    system = example(name).settling()
    return system, jax.jit(lambda: integrate_steps(system, jnp.asarray(example(name).HORIZON), USUAL))()


@pytest.mark.parametrize("name", [name for name in NAMES if hasattr(example(name), "settling")])
def test_rates_are_the_derivative_of_the_state_while_it_is_settled_too(name):
    system, run = settling(name)
    assert int(run.failure) == 0
    times, h = example(name).HORIZON * np.linspace(0.01, 0.99, 301), 1e-7

    @jax.jit
    def look():
        (before, _, _, earlier), (after, *_), (x, segment, t_local, mode) = (
            states_at(system, run, jnp.asarray(times + shift)) for shift in (-h, h, 0.0)
        )
        rates = jax.vmap(system.rates)(segment, t_local, x, mode)
        differences = jax.tree.map(lambda a, b: (b - a) / (2.0 * h), before, after)
        return jax.tree.leaves(rates), jax.tree.leaves(differences), mode, earlier

    rates, differences, mode, earlier = look()
    assert (mode == SETTLED).any()
    for rate, difference in zip(rates, differences, strict=True):
        wrong = np.abs(rate - difference) > 1e-5 * np.abs(difference).max()
        assert not wrong[(mode == SETTLED) & (earlier == SETTLED)].any()
        assert wrong.mean() < 0.02  # an event or a corner may fall between


@pytest.mark.parametrize("name", NAMES)
def test_an_event_leaves_every_guard_positive_a_moment_later(name):
    """What a reset must leave: a state from which the mode that follows can go on."""
    _, steps, (_, _, _, guards) = inside_states(name)
    size = np.abs(guards).max(axis=(0, 1))
    begun = (steps.duration < steps.step_size) & (steps.index == np.roll(steps.index, -1))
    after = np.roll(begun, 1)
    assert after.sum() > 3
    assert (guards[after][:, :-1] > -1e-12 * size).all()
    assert steps.duration[after].min() > 1e-9 * steps.duration.max()


@pytest.mark.parametrize("name", NAMES)
def test_the_derivative_of_an_event_s_time_is_that_of_differences(name):
    _, run = run_of(name)

    def event_times(factor):
        times, slopes, found = run(jnp.asarray(factor, float))
        count = int(found.count)
        cut = np.asarray(found.steps.duration < found.steps.step_size)[: count - 1]
        same = np.diff(np.asarray(found.steps.index)[:count]) == 0
        return np.asarray(times)[1:count][cut & same], np.asarray(slopes)[1:count][cut & same]

    step = 1e-5
    times, slopes = event_times(1.0)
    above, below = event_times(1.0 + step)[0], event_times(1.0 - step)[0]
    assert times.size == above.size == below.size > 3
    differences = (above - below) / (2.0 * step)
    # A reversal of what is left of a ringing, some nm, is located to no more than tolerance / velocity: 1.6e-4 here.
    np.testing.assert_allclose(slopes, differences, rtol=0.0, atol=5e-4 * np.abs(differences).max())
