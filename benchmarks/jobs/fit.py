"""The joint fit of the packaged example: nine parameters, five records, from the same starts.

pdssjax also runs as the user has it, starts searched for.  The peers are SciPy's
`least_squares` over LSODA with differences.  They are given what a careful user would give
them: logarithms for positive parameters, offsets taken out in closed form, and the closed
form of the step responses.  Only the sawtooth records are integrated.
"""

import dataclasses
import functools
import time
from collections.abc import Callable

import numpy as np
from scipy.optimize import least_squares

import pdssjax
from pdssjax.records import Record
from pdssjax.study import Study

from ..measure import Effort, Entry, Outcome, interleave, seconds_of
from ..peers import peers
from ..peers.base import AbstractPeer
from ..problem import UM
from ..rig import example, started, stepped

JOB = "joint fit"
DIFFERENCE = 3e-3
"""Step of the differences, in the logarithms."""
_ORDER = (
    "piezo.natural_frequency piezo.damping_ratio piezo.gain effector.mass friction.sigma0_a friction.sigma0_b "
    "friction.sigma1_a friction.sigma1_b friction.f_ss_a friction.f_ss_b"
).split()
"""The peers' parameters, as `problem.NAMES` has them."""


def measure(effort: Effort) -> Outcome:
    """Chi-square and the time to it."""
    study = example()
    effort.report("joint fit: searching for starts")
    starts: dict[str, float] = {}
    search = seconds_of(lambda: starts.update(study.values()))
    again = seconds_of(example().values)
    ours = [
        _ours("pdssjax identify, starts searched for", lambda: example(), effort),
        _ours("pdssjax identify, from given starts", lambda: started(example(), starts), effort),
        _ours("the same, every cycle stepped", lambda: started(stepped(example()), starts), effort),
    ]
    best = ours[1][1]
    entries = [entry for entry, _ in ours]
    interleave(entries, effort)
    outcome = Outcome(entries)
    outcome.lines.append(f"joint fit: the search for starts takes {search:.2f} s at first and {again:.2f} s warm")
    if not effort.fits:
        return outcome
    for peer in (peer for peer in peers() if peer.fit_tolerance):
        if reason := peer.missing():
            outcome.lines.append(f"least_squares over {peer.name}: left out. {reason}")
            continue
        effort.report(f"joint fit: least_squares over {peer.name}")
        try:
            outcome.entries.append(_theirs(peer, study, starts, best))
        except ValueError as error:  # a Jacobian that is not finite
            outcome.lines.append(f"least_squares over {peer.name}: gave up. {error}")
    return outcome


def _ours(who: str, fresh: Callable[[], Study], effort: Effort) -> tuple[Entry, dict[str, tuple[float, float]]]:
    """A fit of a newly loaded study each time; also every parameter with its standard error."""
    effort.report(f"joint fit: {who}")
    estimates = []
    run = lambda: estimates.append(pdssjax.identify(fresh()))
    first = seconds_of(run)
    found = estimates[0]
    count = found.statistics
    note = f"chi-square {count.chi2:.3f}, {count.iterations} iterations, {count.evaluations} evaluations"
    entry = Entry(JOB, who, run, first_seconds=first, note=f"{note}; compilation within the first call", ours=True)
    return entry, {path: (p.value, p.standard_error) for path, p in found.parameters.items() if p.free}


def _theirs(peer: AbstractPeer, study: Study, starts: dict[str, float], best: dict[str, tuple[float, float]]) -> Entry:
    residual = _Residual(peer, study, starts)
    residual(residual.start)  # whatever is still to be compiled
    begun = time.perf_counter()
    found = least_squares(
        residual, residual.start, x_scale="jac", diff_step=DIFFERENCE, method="trf", xtol=1e-6, ftol=1e-7
    )
    seconds = time.perf_counter() - begun
    apart = max(
        abs(number - best[path][0]) / best[path][1] for path, number in residual.values(found.x).items() if path in best
    )
    note = f"chi-square {2 * found.cost:.3f}, {residual.calls} evaluations, {apart:.2g} standard errors from ours"
    entry = Entry(JOB, f"least_squares over {peer.name}", None, tolerance=peer.fit_tolerance or 0.0, note=note)
    entry.times.append(seconds)
    entry.wrong = apart > 1.0
    return entry


@dataclasses.dataclass
class _Residual:
    """Whitened residuals as SciPy wants them, a function of the logarithms of the free parameters."""

    peer: AbstractPeer
    study: Study
    starts: dict[str, float]
    calls: int = 0

    @functools.cached_property
    def free(self) -> list[str]:
        return [path for path, parameter in self.study.parameters.items() if parameter.free]

    @functools.cached_property
    def start(self) -> np.ndarray:
        return np.log([self.starts[path] for path in self.free])

    @functools.cached_property
    def records(self) -> list[Record]:
        return [record for record in self.study.records if record.role == "fit"]

    def values(self, logarithms: np.ndarray) -> dict[str, float]:
        return self.starts | dict(zip(self.free, np.exp(logarithms).tolist(), strict=True))

    def __call__(self, logarithms: np.ndarray) -> np.ndarray:
        self.calls += 1
        values = self.values(logarithms)
        parameters = np.array([values[path] for path in _ORDER])
        parts = []
        for record in self.records:
            if record.measures == "platform":
                motion = step_response(parameters, record)
            else:
                motion = self.peer.record(parameters, record, self.peer.fit_tolerance or 0.0)
            rest = UM * record.measured - motion
            parts.append((rest - rest.mean()) / (UM * (record.noise or 1.0)))
        return np.concatenate(parts)


def step_response(parameters: np.ndarray, record: Record) -> np.ndarray:
    """The platform after an ideal step [um], in closed form."""
    rate, damping, gain = parameters[:3]
    time, ring = np.maximum(record.time, 0.0), rate * np.sqrt(1.0 - damping**2)
    fade = np.exp(-damping * rate * time)
    rise = 1.0 - fade * (np.cos(ring * time) + damping * rate / ring * np.sin(ring * time))
    return UM * gain * float(record.drive.voltage) * rise
