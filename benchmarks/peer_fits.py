"""How others fit the packaged example: a least-squares routine, an integrator and differences.

They are given what a careful user would give them: the same starts, logarithms for positive
parameters, steps of the differences that suit the tolerance, offsets taken out in closed form,
the closed form of the step responses, and a switch of the friction that is blended just enough
for LSODA not to get stuck at it (`BLEND`).  Only the sawtooth records are integrated.
"""

import abc
import contextlib
import dataclasses
import functools
import importlib
import os
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from pdssjax import Record, Study
from pdssjax.drive.step import Step

from .peers.base import AbstractPeer, not_installed
from .problem import UM

DIFFERENCE = 3e-3
"""Step of the differences, in the logarithms."""
_FAR = 4.0
"""Logarithm of a ratio to the start beyond which nothing is integrated: LSODA would not come back."""
_HOPELESS = 1e3
"""Whitened residuals of a run that failed: finite, so that the step is refused and the fit goes on."""
_XTOL, _FTOL = 1e-6, 1e-7
_ORDER = (
    "piezo.natural_frequency piezo.damping_ratio piezo.gain effector.mass friction.sigma0_a friction.sigma0_b "
    "friction.sigma1_a friction.sigma1_b friction.f_ss_a friction.f_ss_b"
).split()
"""The peers' parameters, as `problem.NAMES` has them."""


class OutOfTime(Exception):
    """Raised within a fit that has taken too long."""


@dataclasses.dataclass(frozen=True)
class Fitted:
    """Where a fit ended."""

    values: dict[str, float]
    chi2: float
    seconds: float
    calls: int
    """Evaluations of the residuals, those for differences too."""
    failed: int
    """Those that gave no finite residuals."""
    message: str
    cut: bool

    def says(self) -> str:
        """A sentence for the reader."""
        broken = f"more than {self.seconds:.0f} s, " if self.cut else ""
        stuck = f", {self.failed} of them without a finite result" if self.failed else ""
        return f"{broken}{self.message.rstrip('.')}; {self.calls} evaluations{stuck}; chi-square {self.chi2:.3f}"


@dataclasses.dataclass
class Residual:
    """Whitened residuals as a function of 1 + log(parameter / start), so that relative steps are steps in the log."""

    peer: AbstractPeer
    study: Study
    starts: dict[str, float]
    calls: int = 0
    failed: int = 0
    deadline: float = np.inf
    best: tuple[float, np.ndarray | None] = (np.inf, None)
    """The least chi-square so far, and where."""

    @functools.cached_property
    def free(self) -> list[str]:
        """Paths of what is fitted."""
        return [path for path, parameter in self.study.parameters.items() if parameter.free]

    @functools.cached_property
    def _records(self) -> list[Record]:
        return [record for record in self.study.records if record.role == "fit"]

    def values(self, x: np.ndarray) -> dict[str, float]:
        """All parameters [SI] at the point x."""
        free = {path: self.starts[path] * float(np.exp(shift)) for path, shift in zip(self.free, x - 1.0, strict=True)}
        return self.starts | free

    def __call__(self, x: np.ndarray) -> np.ndarray:
        if time.perf_counter() > self.deadline:
            raise OutOfTime
        self.calls += 1
        found = self._whitened(x) if np.all(np.abs(x - 1.0) < _FAR) else np.array([np.nan])
        if not np.isfinite(found).all():
            self.failed += 1
            return np.full(sum(record.time.size for record in self._records), _HOPELESS)
        chi2 = float(found @ found)
        if chi2 < self.best[0]:
            self.best = (chi2, np.array(x))
        return found

    def _whitened(self, x: np.ndarray) -> np.ndarray:
        values = self.values(x)
        parameters = np.array([values[path] for path in _ORDER])
        parts = []
        for record in self._records:
            if record.measures == "platform":
                motion = step_response(parameters, record)
            else:
                motion = self.peer.record(parameters, record, self.peer.fit_tolerance or 0.0)
            rest = UM * record.measured - motion
            parts.append((rest - rest.mean()) / (UM * (record.noise or 1.0)))
        return np.concatenate(parts)


class AbstractFit(abc.ABC):
    """A least-squares routine."""

    name: str

    def missing(self) -> str | None:
        """Why it cannot run here, as a sentence; None where it can."""
        return None

    @abc.abstractmethod
    def minimise(self, residual: Residual, start: np.ndarray) -> str:
        """Fit; `residual` keeps the best point.  Returns what the routine says of its end."""

    def run(self, residual: Residual, seconds: float) -> Fitted:
        """A fit from the starts, broken off after so many `seconds`.  Compilation is not counted."""
        start = np.ones(len(residual.free))
        residual(start)  # whatever is still to be compiled
        begun = time.perf_counter()
        residual.deadline, residual.calls, residual.failed = begun + seconds, 0, 0
        cut, message = False, ""
        try:
            with _hushed():
                message = self.minimise(residual, start)
        except OutOfTime:
            cut, message = True, "broken off"
        except ValueError as error:
            message = f"gave up: {error}"
        lasted = time.perf_counter() - begun
        chi2, x = residual.best
        values = residual.values(start if x is None else x)
        return Fitted(values, chi2, lasted, residual.calls, residual.failed, message, cut)


@contextlib.contextmanager
def _hushed() -> Iterator[None]:
    """Nothing on the terminal: numbalsoda complains there at every step that it does not find."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


class SciPyFit(AbstractFit):
    """`scipy.optimize.least_squares`, trust region."""

    name = "least_squares"

    def minimise(self, residual: Residual, start: np.ndarray) -> str:
        found = least_squares(
            residual, start, x_scale="jac", diff_step=DIFFERENCE, method="trf", xtol=_XTOL, ftol=_FTOL
        )
        return found.message


class LmFit(AbstractFit):
    """lmfit's `leastsq`, which is MINPACK's Levenberg-Marquardt."""

    name = "lmfit"

    def missing(self) -> str | None:
        return not_installed(["lmfit"])

    def minimise(self, residual: Residual, start: np.ndarray) -> str:
        lmfit: Any = importlib.import_module("lmfit")
        names = [path.replace(".", "_") for path in residual.free]
        parameters = lmfit.Parameters()
        for name, value in zip(names, start, strict=True):
            parameters.add(name, value=float(value))
        of_vector = lambda given: residual(np.array([given[name].value for name in names]))
        minimiser = lmfit.Minimizer(of_vector, parameters, calc_covar=False)
        found = minimiser.leastsq(epsfcn=DIFFERENCE**2, xtol=_XTOL, ftol=_FTOL)
        return found.message


FITS = (SciPyFit(), LmFit())


def step_response(parameters: np.ndarray, record: Record) -> np.ndarray:
    """The platform after an ideal step [um], in closed form."""
    rate, damping, gain = parameters[:3]
    time, ring = np.maximum(record.time, 0.0), rate * np.sqrt(1.0 - damping**2)
    fade = np.exp(-damping * rate * time)
    rise = 1.0 - fade * (np.cos(ring * time) + damping * rate / ring * np.sin(ring * time))
    assert isinstance(record.drive, Step)
    return UM * gain * float(record.drive.voltage) * rise
