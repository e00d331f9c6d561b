"""A sensor that shows a new value only at every so many samples is told from a coarse one, and from rest."""

import numpy as np
import pytest

from pdssjax.metrics import describe_hold, fresh_samples, hold_length


def rung(random, elapsed):
    """What a stack with a little damping leaves of a step."""
    rate, damping = 2.0 * np.pi * random.uniform(300.0, 2000.0), 10.0 ** random.uniform(-2.0, -0.6)
    return np.exp(-damping * rate * elapsed) * np.cos(rate * elapsed)


def motion(random, kind, time):
    """One of height 1 or so."""
    count = random.integers(2, 20)
    phase = np.mod(count * time / time[-1], 1.0)
    cycle, elapsed = np.floor(count * time / time[-1]), phase * time[-1] / count
    return {
        "step": lambda: np.where(cycle > 0, 1.0 - rung(random, np.maximum(time - time[-1] / count, 0.0)), 0.0),
        "sawtooth": lambda: phase + random.random() * cycle + 0.2 * rung(random, elapsed),
        "steps": lambda: (np.mod(cycle, 2) * 2 - 1) * (1.0 - 2.0 * rung(random, elapsed)),
        "sine": lambda: np.sin(2.0 * np.pi * count * time / time[-1]),
        "ramp": lambda: time / time[-1],
        "rest": lambda: 0.0 * time,
        "square": lambda: np.mod(cycle, 2),
        "stairs": lambda: cycle,
    }[kind]()


def recorded(random, kinds, held=1):
    """A record with noise, counted by its sensor in steps from a ten thousandth to a tenth of its height."""
    size = int(random.integers(400, 4000))
    time = np.arange(size) * 10.0 ** random.uniform(-5.3, -4.3)
    count = 10.0 ** random.uniform(-4.0, -1.0 if held == 1 else -2.0)
    noise = count * random.choice([0.0, random.uniform(0.0, 1.0), random.uniform(0.0, 5.0)])
    seen = motion(random, random.choice(kinds), time) + noise * random.normal(size=size)
    seen = 1e-6 * count * np.round(seen / count)
    first = int(random.integers(held))
    return seen[np.maximum((np.arange(size) - first) // held * held + first, 0)]


def test_of_1000_records_without_a_hold_none_is_taken_for_one():
    random = np.random.default_rng(1)
    kinds = ["step", "sawtooth", "steps", "sine", "ramp", "rest", "square", "stairs"]
    assert [found for found in (hold_length(recorded(random, kinds)) for _ in range(1000)) if found is not None] == []


@pytest.mark.parametrize("held", [2, 3, 4, 5])
def test_holds_of_records_that_ring_are_found(held):
    random = np.random.default_rng(held)
    found = [hold_length(recorded(random, ["step", "sawtooth", "steps"], held)) for _ in range(50)]
    assert found == [held] * 50


def test_a_sensor_that_is_not_in_step_with_its_digitiser_is_found():
    time = 1e-5 * np.arange(2000)
    shown = np.floor(time / 2.5e-5 + 1e-9) * 2.5e-5
    seen = rung(np.random.default_rng(3), shown)
    assert hold_length(seen) == pytest.approx(2.5, abs=0.02)
    assert "at the rate" in describe_hold(seen) and "held =" not in describe_hold(seen)


@pytest.mark.parametrize("first", [0, 1, 2])
def test_fresh_samples_are_those_at_which_the_value_changes(first):
    new = np.random.default_rng(0).normal(size=100)
    seen = np.concatenate([np.full(first, 9.0), np.repeat(new, 3)])
    kept = fresh_samples(seen, 3)
    np.testing.assert_array_equal(seen[kept], new)
    assert np.flatnonzero(kept)[0] == first
    assert "held = 3" in describe_hold(seen)


@pytest.mark.parametrize("values", [np.zeros(50), np.arange(3.0), np.full(40, np.nan), np.zeros(0)])
def test_records_that_say_nothing_are_no_trouble(values):
    assert hold_length(values) is None and describe_hold(values) == ""
