"""The run that every simulator does, and its tight reference.

The thesis's actuator (deflection state, no feedback) under an ideal sawtooth from rest.
Displacements are in um here, so that tolerances and errors read as they are spoken of.
"""

import dataclasses
import functools
import math

import jax
import jax.numpy as jnp
import numpy as np

from pdssjax import AbstractDrive, Accuracy, Actuator, Effector, Taylor
from pdssjax.drive.sawtooth import Sawtooth
from pdssjax.friction.anisotropic_lugre import AnisotropicLuGre
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import displacements

NAMES = (
    "natural frequency",
    "damping ratio",
    "gain",
    "mass",
    "sigma0_a",
    "sigma0_b",
    "sigma1_a",
    "sigma1_b",
    "f_ss_a",
    "f_ss_b",
)
"""The columns of the Jacobian: d x_e / d log(parameter)."""

PARAMETERS = np.array([6736.0, 0.1772, 1.007e-7, 0.086, 1.1484e6, 0.953789e6, 54.4, 38.9, 0.7964, 0.5458])
"""Their values [SI]."""

UM = 1e6
"""Micrometres in a metre."""


@dataclasses.dataclass(frozen=True)
class Problem:
    """One record of a forward sawtooth, `samples` of the end-effector at equal intervals."""

    voltage: float = 64.0
    frequency: float = 5.0
    cycles: int = 8
    samples: int = 1601

    @property
    def times(self) -> np.ndarray:
        """Sample times [s], from 0 to the end of the last cycle."""
        return np.linspace(0.0, self.cycles / self.frequency, self.samples)

    def drive(self) -> Sawtooth:
        """The voltage."""
        return Sawtooth(voltage=self.voltage, frequency=self.frequency)


class EveryCycle(Sawtooth):
    """A sawtooth that does not say that it repeats: every cycle is stepped."""

    def period(self):
        return None


def actuator(parameters) -> Actuator:
    """The thesis's actuator with the given values of `NAMES`."""
    frequency, damping, gain, mass, *friction = (parameters[i] for i in range(len(NAMES)))
    piezo = SecondOrder(gain=gain, natural_frequency=frequency, damping_ratio=damping)
    return Actuator(piezo, AnisotropicLuGre(*friction), Effector(mass))


def effector(parameters, problem: Problem, accuracy: Accuracy, drive: AbstractDrive | None = None):
    """What pdssjax makes of the problem: the end-effector at the sample times [um]."""
    times = jnp.asarray(problem.times)
    return displacements(actuator(parameters), drive or problem.drive(), times, accuracy)[1] * UM


@dataclasses.dataclass(frozen=True)
class Reference:
    """The right answer."""

    trajectory: np.ndarray
    """End-effector [um], shape (samples,)."""
    jacobian: np.ndarray
    """d x_e / d log p [um], shape (samples, 10)."""

    def error(self, trajectory) -> float:
        """Largest error of a trajectory [um]."""
        return _number(np.max(np.abs(np.asarray(trajectory) - self.trajectory)))

    def jacobian_errors(self, jacobian) -> np.ndarray:
        """Relative error of every column, shape (10,)."""
        return column_errors(np.asarray(jacobian), self.jacobian)

    def jacobian_error(self, jacobian) -> float:
        """That of the worst column."""
        return _number(np.max(self.jacobian_errors(jacobian)))


def column_errors(jacobian: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Of each column, relative to its norm."""
    return np.linalg.norm(jacobian - right, axis=0) / np.linalg.norm(right, axis=0)


@functools.cache
def reference(problem: Problem) -> Reference:
    """A run of pdssjax at a tolerance of 1e-9 um, every cycle stepped.

    `speed` compares it with the hand-written stepper in long double, which shares no line
    with it; tighter than this the events drown in rounding.
    """
    tight = Accuracy(1e-15, 1e-15, Taylor(12), max_steps=400 * problem.cycles)
    every = EveryCycle(voltage=problem.voltage, frequency=problem.frequency)

    def run(logarithms):
        x = effector(PARAMETERS * jnp.exp(logarithms), problem, tight, every)
        return x, x

    jacobian, trajectory = jax.jit(jax.jacfwd(run, has_aux=True))(jnp.zeros(len(NAMES)))
    return Reference(np.asarray(trajectory), np.asarray(jacobian))


@dataclasses.dataclass(frozen=True)
class Piece:
    """A stretch of drive with a straight voltage."""

    begin: float
    end: float
    voltage: float
    """Just after `begin` [V]."""
    slope: float
    """[V/s]"""


def pieces(drive: AbstractDrive, until: float) -> list[Piece]:
    """The straight pieces of `drive` up to `until` [s], as plain numbers."""
    found, begin, index = [], 0.0, 0
    while begin < until * (1.0 - 1e-12):
        segment = drive.segment(jnp.asarray(float(index)))
        length = float(segment.duration)
        if length > 0.0:
            found.append(Piece(begin, min(begin + length, until), float(segment.start), float(segment.slope)))
        begin, index = begin + length, index + 1
    return found


def _number(error) -> float:
    """NaN counts as infinitely wrong."""
    return math.inf if np.isnan(error) else float(error)
