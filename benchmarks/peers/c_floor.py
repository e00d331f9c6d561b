"""A hand-written C stepper for this one problem (`floor.c`), compiled by gcc when first used: the floor.

It locates the events and cuts the tail of the ring-down to its analytic ramp, as pdssjax
does, but steps every cycle, and knows no other actuator.
"""

import ctypes
import dataclasses
import functools
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from ..grid import Grid
from ..problem import PARAMETERS, Problem
from .base import AbstractPeer, Prepared, ladder, warmed

_SOURCE = Path(__file__).with_name("floor.c")
_ORDER = 8


@dataclasses.dataclass(frozen=True)
class CFloor(AbstractPeer):
    """The C stepper at a tolerance in um, which is also what it takes for rest."""

    tolerances: tuple[float, ...] = ladder(1e-2, 1e-8)
    jacobian_tolerances: tuple[float, ...] = ladder(1e-3, 1e-8)
    sweep_tolerances: tuple[float, ...] = ladder(1e-4, 1e-5, 4)

    @property
    def name(self) -> str:
        return "C floor"

    def missing(self) -> str | None:
        return None if shutil.which("gcc") else "There is no gcc here to compile the hand-written stepper."

    def trajectory(self, problem: Problem) -> Prepared:
        return warmed(lambda p, tolerance: simulate(p, problem, tolerance)[0], 1e-3)

    def jacobian(self, problem: Problem) -> Prepared:
        return warmed(lambda p, tolerance: simulate(p, problem, tolerance, jacobian=True)[1], 1e-3)

    def sweep(self, grid: Grid) -> Prepared:
        return warmed(lambda p, tolerance: simulate_grid(p, grid, tolerance), 1e-3)


def simulate(parameters, problem: Problem, tolerance: float, order: int = _ORDER, jacobian=False, precise=False):
    """End-effector [um], shape (samples,), and its Jacobian, shape (samples, 10), where wanted.

    `precise` computes in long double.
    """
    times = np.ascontiguousarray(problem.times)
    out = np.zeros(times.size)
    slopes = np.zeros((times.size if jacobian else 0, PARAMETERS.size))
    steps = _library("long double" if precise else "double").simulate(
        _pointer(np.ascontiguousarray(parameters, float)),
        problem.voltage,
        problem.frequency,
        problem.cycles,
        _pointer(times),
        times.size,
        tolerance,
        tolerance,
        order,
        _pointer(out),
        _pointer(slopes) if jacobian else None,
    )
    if steps < 0:
        out[:], slopes[:] = np.nan, np.nan
    return out, slopes


def simulate_grid(parameters, grid: Grid, tolerance: float, order: int = _ORDER, precise=False) -> np.ndarray:
    """End-effector at every sample of a grid [um], shape (points, samples)."""
    voltages, frequencies = np.ascontiguousarray(grid.points.T)
    times = np.ascontiguousarray(grid.times)
    out = np.zeros(times.shape)
    steps = _library("long double" if precise else "double").sweep(
        _pointer(np.ascontiguousarray(parameters, float)),
        _pointer(voltages),
        _pointer(frequencies),
        len(times),
        grid.cycles + 1,
        _pointer(times),
        times.shape[1],
        tolerance,
        tolerance,
        order,
        _pointer(out),
    )
    return out if steps >= 0 else np.full(times.shape, np.nan)


def _pointer(array: np.ndarray) -> ctypes.c_void_p:
    return array.ctypes.data_as(ctypes.c_void_p)


@functools.cache
def _library(real: str) -> Any:
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "floor.so"
        options = ["-O3", "-march=native", "-std=gnu11", "-shared", "-fPIC", f"-DREAL={real}"]
        subprocess.run(["gcc", *options, "-o", str(target), str(_SOURCE), "-lm"], check=True)
        library = ctypes.CDLL(str(target))
    array, number, whole = ctypes.c_void_p, ctypes.c_double, ctypes.c_int
    library.simulate.argtypes = [array, number, number, whole, array, whole, number, number, whole, array, array]
    library.simulate.restype = whole
    library.sweep.argtypes = [array, array, array, whole, whole, array, whole, number, number, whole, array]
    library.sweep.restype = ctypes.c_long
    return library


PEERS = (CFloor(),)
