"""The package's models of an `independent.Rig`, compiled once for each structure and shared by the tests."""

import dataclasses
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from parts import AnisotropicLuGre, Sawtooth, SecondOrder

from pdssjax import Accuracy, Actuator, Effector, Taylor, simulate
from pdssjax.simulation import displacements
from tests.reference.independent import Rig

SAMPLES = 120
"""Samples a record, the same everywhere: another number would be compiled anew."""
NAMES = "gain frequency damping stack mass load s0_a s0_b s1_a s1_b f_ss_a f_ss_b voltage rate fall forward".split()


def values(rig: Rig) -> np.ndarray:
    """The numbers of a rig in the order of `NAMES`."""
    contact = [*rig.s0, *rig.s1, *rig.f_ss]
    drive = [rig.voltage, 1.0 / rig.cycle, rig.fall, 1.0 if rig.forward else -1.0]
    return np.array([rig.gain, rig.frequency, rig.damping, rig.stack, rig.mass, rig.load, *contact, *drive])


def models(
    numbers, reading: str, feedback: bool, drive: type = Sawtooth, rests: bool = False
) -> tuple[Actuator, Sawtooth]:
    """Actuator and drive with the given numbers."""
    gain, frequency, damping, stack, mass, load, *contact = numbers[:12]
    friction = AnisotropicLuGre(*contact, reading)
    stack_model, effector = SecondOrder(gain, frequency, damping, stack), Effector(mass, load)
    actuator = Actuator(stack_model, friction, effector, feedback, rests_under_load=rests)
    return actuator, drive(*numbers[12:])


@cache
def compiled(reading: str, feedback: bool, method: Taylor, rests: bool = False, drive: type = Sawtooth):
    """`simulate` as a function of (numbers, times, tolerance, rest)."""

    def run(numbers, times, tolerance, settle_tolerance):
        accuracy = Accuracy(tolerance, settle_tolerance, method)
        return simulate(*models(numbers, reading, feedback, drive, rests), times, accuracy)

    return jax.jit(run)


@cache
def compiled_jacobian(reading: str, feedback: bool, method: Taylor):
    """Derivatives of (platform, effector) with respect to the numbers, shape (2, samples, numbers)."""

    def run(numbers, times, tolerance, settle_tolerance):
        accuracy = Accuracy(tolerance, settle_tolerance, method)
        return jnp.stack(displacements(*models(numbers, reading, feedback), times, accuracy))

    return jax.jit(jax.jacfwd(run))


def trajectory(rig: Rig, times, accuracy: Accuracy, **kind):
    assert len(times) == SAMPLES
    return compiled(rig.reading, rig.feedback, accuracy.method, rig.rests_under_load, **kind)(
        values(rig), times, accuracy.tolerance, accuracy.settle_tolerance
    )


def jacobian(rig: Rig, times, accuracy: Accuracy) -> np.ndarray:
    assert len(times) == SAMPLES
    run = compiled_jacobian(rig.reading, rig.feedback, accuracy.method)
    return np.asarray(run(values(rig), times, accuracy.tolerance, accuracy.settle_tolerance))


def varied(rig: Rig, name: str, change: float) -> Rig:
    """The rig with one of its numbers changed by an amount."""
    if name == "rate":
        return dataclasses.replace(rig, cycle=1.0 / (1.0 / rig.cycle + change))
    if name[-2:] in ("_a", "_b"):
        pair = list(getattr(rig, name[:-2]))
        pair[name.endswith("b")] += change
        return dataclasses.replace(rig, **{name[:-2]: tuple(pair)})
    return dataclasses.replace(rig, **{name: getattr(rig, name) + change})
