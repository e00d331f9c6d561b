"""What a simulator must offer to be measured."""

import abc
import dataclasses
import importlib.util
import time
from collections.abc import Callable, Sequence

import numpy as np

from pdssjax import Record

from ..grid import Grid
from ..problem import PARAMETERS, Problem

ATTEMPTS, LOOSER = 20, 1.2
"""How often a solver that got stuck is tried again, and by how much looser each time."""

BLEND = 1.0
"""Relative speed [um/s] over which an integrator in a fit blends the two senses of sliding: where a contact
sticks between them LSODA gets stuck with it, and no tolerance helps.  It moves a record by less than 1e-3 um."""

Run = Callable[[np.ndarray, float], np.ndarray]
"""From parameters, as `problem.NAMES` has them [SI], and a tolerance to the result [um]."""


@dataclasses.dataclass(frozen=True)
class Prepared:
    """A run that is ready to be called."""

    run: Run
    compile_seconds: float
    """Spent on tracing and compiling before the first call."""


class AbstractPeer(abc.ABC):
    """One way to simulate the problem.

    What needs an optional package imports it inside its methods.
    """

    tolerances: tuple[float, ...] = ()
    """To be tried for a trajectory, loosest first."""
    jacobian_tolerances: tuple[float, ...] = ()
    """The same for a Jacobian; empty: it makes none."""
    sweep_tolerances: tuple[float, ...] = ()
    """The same for a sweep."""
    sweep_share: int = 1
    """A slow one sweeps only one voltage in so many; its time is multiplied."""
    fit_tolerance: float | None = None
    """That of a fit with differences; None: it makes none."""

    @property
    @abc.abstractmethod
    def name(self) -> str:
        """As the table calls it."""

    def missing(self) -> str | None:
        """Why it cannot run here, as a sentence; None where it can."""
        return None

    @abc.abstractmethod
    def trajectory(self, problem: Problem) -> Prepared:
        """The end-effector at the sample times, shape (samples,)."""

    def jacobian(self, problem: Problem) -> Prepared:
        """d x_e / d log(parameter), shape (samples, 10): central differences unless a peer knows better."""
        prepared = self.trajectory(problem)
        return Prepared(lambda p, tolerance: differences(prepared.run, p, tolerance), prepared.compile_seconds)

    def sweep(self, grid: Grid) -> Prepared:
        """The end-effector at every sample of a grid, shape (points, samples); wanted with `sweep_tolerances`."""
        raise NotImplementedError

    def record(self, parameters: np.ndarray, record: Record, tolerance: float) -> np.ndarray:
        """The end-effector at the times of a measured record [um]; wanted where there is a `fit_tolerance`."""
        raise NotImplementedError


def differences(run: Run, parameters: np.ndarray, tolerance: float) -> np.ndarray:
    """Central differences in the logarithms, with the step that suits the tolerance."""
    return central_differences(lambda p: run(p, tolerance), parameters, tolerance ** (1.0 / 3.0))


def central_differences(run: Callable[[np.ndarray], np.ndarray], parameters: np.ndarray, step: float) -> np.ndarray:
    """Of `run` by the logarithms of its `parameters`, a column each."""
    columns = []
    for i in range(parameters.size):
        factor = np.where(np.arange(parameters.size) == i, np.exp(step), 1.0)
        columns.append((run(parameters * factor) - run(parameters / factor)) / (2.0 * step))
    return np.stack(columns, axis=1)


def persist(run: Callable[[float], np.ndarray], tolerance: float) -> np.ndarray:
    """What `run` makes of a tolerance: LSODA gets stuck at a switch now and then; another one, and it is past it."""
    motion = run(tolerance)
    for attempt in range(1, ATTEMPTS):
        if np.isfinite(motion).all():
            break
        motion = run(tolerance * LOOSER**attempt)
    return motion


def warmed(run: Run, tolerance: float) -> Prepared:
    """`run`, called once for its compiler; the time of that call is taken for the compilation."""
    begun = time.perf_counter()
    run(PARAMETERS, tolerance)
    return Prepared(run, time.perf_counter() - begun)


def ladder(loosest: float, tightest: float, a_decade: int = 2) -> tuple[float, ...]:
    """Tolerances from loosest to tightest, so many a decade."""
    steps = round(a_decade * np.log10(loosest / tightest)) + 1
    return tuple(float(t) for t in loosest * 10.0 ** (-np.arange(steps) / a_decade))


def not_installed(packages: Sequence[str]) -> str | None:
    """A sentence about the first of `packages` that is not installed."""
    for package in packages:
        if importlib.util.find_spec(package) is None:
            return f"The package {package} is not installed; `make bench` tries to."
    return None
