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
from collections.abc import Callable
from pathlib import Path

import numpy as np

from ..problem import PARAMETERS, Problem
from .base import AbstractPeer, Prepared, ladder, warmed

_SOURCE = Path(__file__).with_name("floor.c")
_ORDER = 8


@dataclasses.dataclass(frozen=True)
class CFloor(AbstractPeer):
    """The C stepper at a tolerance in um, which is also what it takes for rest."""

    tolerances: tuple[float, ...] = ladder(1e-2, 1e-8)
    jacobian_tolerances: tuple[float, ...] = ladder(1e-3, 1e-8)

    @property
    def name(self) -> str:
        return "C floor"

    def missing(self) -> str | None:
        return None if shutil.which("gcc") else "There is no gcc here to compile the hand-written stepper."

    def trajectory(self, problem: Problem) -> Prepared:
        return warmed(lambda p, tolerance: simulate(p, problem, tolerance)[0], 1e-3)

    def jacobian(self, problem: Problem) -> Prepared:
        return warmed(lambda p, tolerance: simulate(p, problem, tolerance, jacobian=True)[1], 1e-3)


def simulate(parameters, problem: Problem, tolerance: float, order: int = _ORDER, jacobian=False, precise=False):
    """End-effector [um], shape (samples,), and its Jacobian, shape (samples, 10), where wanted.

    `precise` computes in long double.
    """
    times = np.ascontiguousarray(problem.times)
    out = np.zeros(times.size)
    slopes = np.zeros((times.size if jacobian else 0, PARAMETERS.size))
    pointer = lambda array: array.ctypes.data_as(ctypes.c_void_p)
    steps = _library("long double" if precise else "double")(
        pointer(np.ascontiguousarray(parameters, float)),
        problem.voltage,
        problem.frequency,
        problem.cycles,
        pointer(times),
        times.size,
        tolerance,
        tolerance,
        order,
        pointer(out),
        pointer(slopes) if jacobian else None,
    )
    if steps < 0:
        out[:], slopes[:] = np.nan, np.nan
    return out, slopes


@functools.cache
def _library(real: str) -> Callable[..., int]:
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "floor.so"
        options = ["-O3", "-march=native", "-std=gnu11", "-shared", "-fPIC", f"-DREAL={real}"]
        subprocess.run(["gcc", *options, "-o", str(target), str(_SOURCE), "-lm"], check=True)
        function = ctypes.CDLL(str(target)).simulate
    pointer, number, whole = ctypes.c_void_p, ctypes.c_double, ctypes.c_int
    function.argtypes = [pointer, number, number, whole, pointer, whole, number, number, whole, pointer, pointer]
    function.restype = whole
    return function


PEERS = (CFloor(),)
