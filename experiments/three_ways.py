"""Virtual rigs of the thesis, their step tests good or bad, identified in three ways.

Joint: everything from everything.  Sequential: the stack from the step tests by least squares, then the friction.
Peaks: the stack from the peaks of the step tests, as in the thesis's appendix 1, then the friction.  The records
are the packaged study's, two sawtooth records of 5 Hz and up to three steps, made anew with its true
parameters and noise from a seed.  The fits are the package's own, started at the truth.
"""

import dataclasses
import functools
import json
import threading
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

import pdssjax
from pdssjax import Accuracy, Record, Study, Taylor, prepare_jax
from pdssjax.files import EXAMPLE
from pdssjax.inference import (
    Fit,
    Problem,
    joint,
    least_squares_covariance,
    pick_peaks,
    sequential,
    with_piezo_held,
)

WAYS = ("joint", "sequential", "peaks")
ACCURACY = Accuracy(method=Taylor(8), tolerance=1e-10, settle_tolerance=1e-10)
"""A hundredth of the noise and better."""
NOISE = 1.04e-8
"""Of the packaged records [m]: 0.01 um, and rounding to 0.01 um."""
BEFORE, AFTER = -0.005, 0.035
"""Ends of a step record [s]."""
KEPT = "step 64.2 V"
"""The step that is left where there is one only."""


@dataclasses.dataclass(frozen=True)
class Scenario:
    """How the step tests were made, and with what noise everything."""

    name: str
    interval: float = 50e-6
    """From sample to sample of a step record [s]."""
    one_step: bool = False
    """One step instead of three."""
    late: bool = False
    """The platform moves one sample later than the record says."""
    damping: float | None = None
    """The damping ratio is held at this, and is wrong."""
    noise: float = NOISE
    """Of every record [m]."""


SCENARIOS = (
    Scenario("50 us, three steps"),
    Scenario("10 us, three steps", interval=10e-6),
    Scenario("50 us, one step", one_step=True),
    Scenario("10 us, one step", interval=10e-6, one_step=True),
    Scenario("50 us, a sample late", late=True),
    Scenario("10 us, a sample late", interval=10e-6, late=True),
    Scenario("50 us, damping held at 0.2083", damping=0.2083),
    Scenario("50 us, five times the noise", noise=5 * NOISE),
)


@dataclasses.dataclass(frozen=True, eq=False)
class Rig:
    """A scenario, ready to be drawn from."""

    scenario: Scenario
    study: Study
    problem: Problem
    """Of records still to be made."""
    motions: tuple[Float[np.ndarray, " n"], ...]
    """What there is to be measured [m]."""

    @functools.cached_property
    def first(self) -> Float[np.ndarray, "3 3"]:
        """Covariance of what peaks tell of its records, on the fit's scale."""
        return pick_peaks(self.measured(0)[0]).covariance

    def measured(self, number: int) -> tuple[Study, Problem]:
        """Draw `number`: the study and its problem with noise; of the study's steps only those used."""
        random = np.random.default_rng([20, number])
        scale = self.scenario.noise
        drawn = [motion + scale * random.standard_normal(motion.size) for motion in self.motions]
        problem = with_measured(self.problem, drawn)
        used = [
            dataclasses.replace(record, measured=values)
            for record, values, noise in zip(self.study.records, drawn, self.problem.noise, strict=True)
            if np.isfinite(noise)
        ]
        return dataclasses.replace(self.study, records=tuple(used)), problem


def with_measured(problem: Problem, measured: list[Float[np.ndarray, " n"]]) -> Problem:
    """The problem of other samples at the same times."""
    return problem._replace(residual=eqx.tree_at(lambda r: r.comparison.measured, problem.residual, tuple(measured)))


def known_truth() -> dict[str, float]:
    """What the packaged records were made with [SI]."""
    return dict(_known_truth())


@functools.cache
def _known_truth() -> dict[str, float]:
    known = json.loads((EXAMPLE / "truth.json").read_text(encoding="utf-8"))["parameters"]
    return {path: known[path]["value"] for path in pdssjax.load_study(EXAMPLE / "study.toml").parameters}


_ONE_AT_A_TIME = threading.Lock()


def rig_of(scenario: Scenario) -> Rig:
    """The rig of a scenario; made once, also by threads."""
    with _ONE_AT_A_TIME:
        return _made(scenario)


@functools.cache
def _made(scenario: Scenario) -> Rig:
    prepare_jax(dedicated=True)  # in another process, too
    study = pdssjax.load_study(EXAMPLE / "study.toml").with_starts(known_truth())
    records = tuple(_sampled(record, scenario) for record in study.records if record.role == "fit")
    study = dataclasses.replace(study, records=records)
    behind = scenario.interval if scenario.late else 0.0
    shifted = tuple(
        dataclasses.replace(record, time=record.time - behind * is_step(record)) for record in study.records
    )
    motions = dataclasses.replace(study, records=shifted).predict(known_truth(), ACCURACY)
    problem, _ = pdssjax.pose_problem(study, ACCURACY)
    if scenario.damping is not None:
        problem = _held(problem, "piezo.damping_ratio", scenario.damping)
    unused = [scenario.one_step and is_step(record) and record.name != KEPT for record in records]
    problem = problem._replace(noise=np.where(unused, np.inf, problem.noise))
    return Rig(scenario, study, problem, tuple(np.asarray(motion) for motion in motions))


def is_step(record: Record) -> bool:
    """Of the platform alone."""
    return record.measurement.platform_alone


def _sampled(record: Record, scenario: Scenario) -> Record:
    """A record as the scenario has it, still to be made."""
    time = record.time
    if is_step(record):
        time = scenario.interval * np.arange(round(BEFORE / scenario.interval), round(AFTER / scenario.interval))
    return dataclasses.replace(record, time=time, measured=np.zeros(time.size), noise=scenario.noise)


def _held(problem: Problem, path: str, value: float) -> Problem:
    """The problem with a parameter that can go nowhere."""
    transform = problem.residual.transform
    place = transform.paths.index(path)
    at = problem.encode(known_truth() | {path: value})[place]
    bounds = [np.where(np.arange(end.size) == place, at, end) for end in (transform.low, transform.high)]
    held = eqx.tree_at(lambda t: (t.low, t.high), transform, tuple(bounds))
    return problem._replace(residual=eqx.tree_at(lambda r: r.transform, problem.residual, held))


def draw(scenario: Scenario, number: int) -> dict[str, Any]:
    """Draw `number` of a scenario, identified in every way: what `outcome` says of each."""
    rig = rig_of(scenario)
    study, problem = rig.measured(number)
    starts = known_truth()
    if scenario.damping is not None:
        starts |= {"piezo.damping_ratio": scenario.damping}
    peaks = starts | pick_peaks(study).values
    if scenario.damping is not None:
        peaks |= {"piezo.damping_ratio": scenario.damping}
    quiet = lambda message: None
    fits = {
        "joint": joint(problem, starts, quiet),
        "sequential": sequential(problem, starts, quiet),
        "peaks": with_piezo_held(problem, problem.encode(peaks), quiet),
    }
    return {way: outcome(way, fit, problem, rig) for way, fit in fits.items()}


def outcome(way: str, fit: Fit, problem: Problem, rig: Rig) -> dict[str, Any]:
    """Relative errors, those that the stack's carry on, and the standard errors `said`, and `naive`; for JSON."""
    paths, found = problem.residual.transform.paths, problem.decode(fit.free)
    error = np.array([float(found[path]) / known_truth()[path] - 1.0 for path in paths])
    said, naive = standard_errors(way, fit, problem, rig)
    numbers = {"error": error, "carried": carried(fit, problem, error), "said": said, "naive": naive}
    return {name: [float(x) for x in values] for name, values in numbers.items()} | {"converged": bool(fit.success)}


def carried(fit: Fit, problem: Problem, error: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
    """The amplification matrix times the relative `error` of the stack; that itself in the stack's places."""
    piezo = np.array([path.startswith("piezo.") for path in problem.residual.transform.paths])
    moved = amplification(problem, np.asarray(fit.state.jacobian), piezo) @ error[piezo]
    out = error.copy()
    out[~piezo] = moved
    return out


def amplification(
    problem: Problem, jacobian: Float[np.ndarray, "n p"], piezo: Bool[np.ndarray, " p"]
) -> Float[np.ndarray, "later earlier"]:
    """Relative change of the others per relative change of the stack's, in records that show more than the platform."""
    walks = np.repeat([not is_step(r) for r in problem.records], [r.time.size for r in problem.records])
    earlier, later = np.flatnonzero(piezo), np.flatnonzero(~piezo)
    _, whole = propagated(jacobian[walks], np.eye(earlier.size), later, earlier)
    return whole[np.ix_(later, earlier)]


def propagated(
    jacobian: Float[np.ndarray, "n p"], first: Float[np.ndarray, "q q"], later: np.ndarray, earlier: np.ndarray
) -> tuple[Float[np.ndarray, "p p"], Float[np.ndarray, "p p"]]:
    """Covariance of a fit in two steps: naive, and with the first step's errors carried on.

    **Arguments:** `jacobian` of the second step's residuals in all parameters; `first`, the covariance of those at the
    places `earlier`, fitted before and then held, while those at the places `later` were fitted.  An error e of the
    first moves the second by -(J2' J2)^-1 J2' J1 e (first order).
    """
    naive = least_squares_covariance(jacobian[:, later], np.zeros(later.size, bool)).matrix
    shift = -np.linalg.lstsq(jacobian[:, later], jacobian[:, earlier], rcond=None)[0]
    p = jacobian.shape[1]
    plain, whole = np.zeros((p, p)), np.zeros((p, p))
    for matrix, block in ((plain, naive), (whole, naive + shift @ first @ shift.T)):
        matrix[np.ix_(earlier, earlier)] = first
        matrix[np.ix_(later, later)] = block
    whole[np.ix_(later, earlier)] = shift @ first
    whole[np.ix_(earlier, later)] = (shift @ first).T
    return plain, whole


def standard_errors(
    way: str, fit: Fit, problem: Problem, rig: Rig
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]:
    """Corrected and naive, as `pdssjax.identify` gives them: on the fit's scale, a logarithm, so relative."""
    jacobian, residual = np.asarray(fit.state.jacobian), np.asarray(fit.state.residual)
    transform = problem.residual.transform
    held = transform.low == transform.high
    used = np.isfinite(problem.noise)
    rows = lambda records: np.repeat(records & used, [record.time.size for record in problem.records])
    steps = np.array([is_step(record) for record in problem.records])
    if way == "joint":
        deviation = np.sqrt(np.diag(least_squares_covariance(jacobian, held).matrix) * _factor(residual, used, fit))
        return deviation, deviation
    piezo = np.array([path.startswith("piezo.") for path in transform.paths])
    earlier, later = np.flatnonzero(piezo & ~held), np.flatnonzero(~piezo)
    if way == "peaks":
        walks = rows(~steps)
        factor = _factor(residual[walks], used & ~steps, fit)
        first = rig.first[np.ix_(earlier, earlier)] / factor
    else:
        factor = _factor(residual, used, fit)
        first = least_squares_covariance(jacobian[rows(steps)][:, earlier], np.zeros(earlier.size, bool)).matrix
    plain, whole = propagated(jacobian[rows(~steps)], first, later, earlier)
    said, naive = (np.sqrt(np.diag(matrix) * factor) for matrix in (whole, plain))
    return np.where(held, np.nan, said), np.where(held, np.nan, naive)


def _factor(residual: Float[np.ndarray, " n"], used: np.ndarray, fit: Fit) -> float:
    """By how much variances grow with residuals above the noise; offsets are free."""
    samples = int(np.count_nonzero(residual))
    return max(1.0, float(residual @ residual) / max(samples - fit.free.size - int(used.sum()), 1))
