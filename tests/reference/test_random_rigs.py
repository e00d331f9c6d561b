"""Rigs drawn at random move as the independent simulator has them: law, stack, load, drive and direction alike."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from rigs import SAMPLES, trajectory

from pdssjax import Accuracy
from tests.reference.independent import Rig, simulate
from tests.reference.test_independent_laws import SIMULATED, cases, moments, packaged

SHAPES = "atol", "exponent", "delta"
"""Numbers of a law that are no quantity to scatter."""
REQUIRED = 1e-10
"""What the default accuracy keeps everywhere: 1e-4 um [m]."""
SEEDS = range(8)


def scattered(random: np.random.Generator, value: float, factor: float) -> float:
    return float(value * factor ** random.uniform(-1.0, 1.0))


def random_numbers(random: np.random.Generator) -> dict[str, Any]:
    """All that is not the law's."""
    return dict(
        gain=scattered(random, 1.007e-7, 1.5),
        frequency=scattered(random, 6736.0, 1.7),
        damping=scattered(random, 0.1772, 2.0),
        mass=scattered(random, 0.086, 1.5),
        load=float(random.uniform(-0.1, 0.1)),
        voltage=float(random.uniform(15.0, 120.0)),
        cycle=float(random.choice([0.05, 0.02, 0.2])),
        fall=float(random.choice([0.0, 2e-4, 1e-3])),
        forward=bool(random.integers(2)),
        feedback=bool(random.random() < 0.25),
    )


def law_rig(name: str, seed: int) -> Rig:
    """Stiffness and damping of the contact scattered by 5 either way, its forces by 1.4."""
    random = np.random.default_rng([7, seed])
    law = list(cases(name).values())[seed % len(cases(name))]
    numbers = {field.name: getattr(law, field.name) for field in dataclasses.fields(law)}
    quantities = {
        key: scattered(random, value, 5.0 if key.startswith("sigma") else 1.4)
        for key, value in numbers.items()
        if key not in SHAPES and isinstance(value, float) and value
    }
    law = dataclasses.replace(law, **quantities)
    return Rig(**random_numbers(random), law=law, tilt=float(random.uniform(-0.05, 0.05)))


def anisotropic_rig(reading: str, seed: int) -> Rig:
    random = np.random.default_rng([8, seed])
    pair = lambda values, factor: tuple(scattered(random, value, factor) for value in values)
    return Rig(
        **random_numbers(random), s0=pair(Rig.s0, 5.0), s1=pair(Rig.s1, 5.0), f_ss=pair(Rig.f_ss, 1.4), reading=reading
    )


def agrees(run, expected: np.ndarray) -> None:
    assert int(run.failure) == 0
    np.testing.assert_allclose(run.platform, expected[:, 0], rtol=0.0, atol=REQUIRED)
    np.testing.assert_allclose(run.effector, expected[:, 1], rtol=0.0, atol=REQUIRED)


@pytest.mark.slow
@pytest.mark.parametrize("name", SIMULATED)
def test_of_every_law(name):
    for seed in SEEDS:
        rig = law_rig(name, seed)
        times = moments(rig)
        agrees(packaged(rig, name, times), simulate(rig, times, longest=2e-5))


@pytest.mark.slow
@pytest.mark.parametrize("reading", ["deflection", "force"])
def test_of_the_anisotropic_law(reading):
    for seed in range(10):
        rig = anisotropic_rig(reading, seed)
        times = moments(Rig(cycle=rig.cycle))
        times = times[np.linspace(0, times.size - 1, SAMPLES).astype(int)]
        agrees(trajectory(rig, times, Accuracy()), simulate(rig, times))
