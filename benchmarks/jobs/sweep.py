"""A sweep of 1000 points, 20 to 80 V and 2 to 50 Hz: four cycles each and the flank that follows, on one core.

pdssjax in blocks of points side by side, the others one point after the other, each at the loosest
tolerance that keeps every sample of every point within 1e-3 um.  Fresh processes tell how time and
memory grow with the points.
"""

import dataclasses
import functools
import json
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

import pdssjax

from ..contest import contest
from ..grid import Grid, grid
from ..measure import Curve, Effort, Entry, Outcome, Rung, interleave, seconds_of
from ..peers import peers
from ..peers.base import AbstractPeer, Prepared
from ..peers.c_floor import CFloor, simulate_grid
from ..peers.pdssjax_taylor import SWEEPING
from ..problem import PARAMETERS
from ..rig import at_truth, example

JOB = "sweep, 1000 points"
TARGET = 1e-3
"""Largest error allowed at any sample of any point [um]."""
_POINTS = (1000, 100_000)
_CHECKED = 8
"""One voltage in so many is checked: long double takes its time."""
_FRESH = """
import json, resource, sys, time
from pdssjax import prepare_jax
prepare_jax(dedicated=True)
import numpy as np
import pdssjax
from pdssjax.files import EXAMPLE
study = pdssjax.load_study(EXAMPLE / "study.toml")
over = lambda n: {"drive.voltage": np.linspace(20, 80, n // 25), "drive.frequency": np.linspace(2, 50, 25)}
truth = json.loads((EXAMPLE / "truth.json").read_text())["parameters"]
study = study.with_values({path: truth[path]["value"] for path in study.parameters})
pdssjax.sweep(study, over(50), workers=1)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
begun = time.perf_counter()
pdssjax.sweep(study, over(int(sys.argv[1])), workers=1)
seconds = time.perf_counter() - begun
unit = 1 if sys.platform == "darwin" else 1024
after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps({"seconds": seconds, "before": before * unit, "peak": after * unit}))
"""


@functools.cache
def right(what: Grid) -> np.ndarray:
    """The end-effector at every sample [um], by pdssjax at a tolerance of 1e-9 um, shape (points, samples)."""
    return SWEEPING[-1].sweep(what).run(PARAMETERS, 1e-9)


def measure(effort: Effort) -> Outcome:
    """Everyone at equal accuracy, `pdssjax.sweep` as called, and its growth."""
    what = grid()
    effort.report(f"{JOB}: reference")
    reference = right(what)
    outcome = Outcome([], lines=[_checked(what, reference)])
    fast = [_Whole(peer) for peer in peers() if peer.sweep_tolerances and peer.sweep_share == 1]
    slow = [_Whole(peer) for peer in peers() if peer.sweep_tolerances and peer.sweep_share > 1]
    met = contest(
        JOB,
        [(peer, peer.tolerances) for peer in fast],
        prepare=lambda peer: peer.trajectory(what),  # pyright: ignore[reportArgumentType]
        error=lambda found: _error(found, reference),
        targets={f"{TARGET:g} um": TARGET},
        parameters=PARAMETERS,
        effort=effort,
    )
    outcome.entries += met.entries
    outcome.curves += met.curves
    outcome.lines += met.lines
    for peer in slow:
        entry, curve = _shared(peer.peer, what, effort)
        outcome.entries.append(entry)
        outcome.curves.append(curve)
    outcome.entries.append(_as_called(what, reference, effort))
    outcome.lines += _ratios(outcome.entries)
    grown = _growth(effort)
    outcome.facts["sweep"] = grown
    outcome.entries += [
        Entry("sweep, fresh process", f"pdssjax.sweep, {n} points", None, times=[row["seconds"]], ours=True)
        for n, row in zip(_POINTS, grown, strict=True)
    ]
    outcome.lines.append(
        "pdssjax.sweep on one core: "
        + "; ".join(
            f"{n} points {row['seconds']:.2f} s, peak memory {row['peak'] / 1e6:.0f} MB "
            f"({(row['peak'] - row['before']) / 1e6:.0f} MB above 50 points)"
            for n, row in zip(_POINTS, grown, strict=True)
        )
    )
    return outcome


@dataclasses.dataclass(frozen=True)
class _Whole(AbstractPeer):
    """A peer whose run is the sweep."""

    peer: AbstractPeer

    @property
    def tolerances(self) -> tuple[float, ...]:  # pyright: ignore[reportIncompatibleVariableOverride]
        return self.peer.sweep_tolerances

    @property
    def name(self) -> str:
        return self.peer.name

    def missing(self) -> str | None:
        return self.peer.missing()

    def trajectory(self, problem) -> Prepared:
        return self.peer.sweep(problem)  # pyright: ignore[reportArgumentType]


def _shared(peer: AbstractPeer, what: Grid, effort: Effort) -> tuple[Entry, Curve]:
    """A slow peer on a part of the grid, at ever tighter tolerances until it is accurate; times are of the whole."""
    share = what.thinned(peer.sweep_share)
    reference = right(what).reshape(len(what.voltages), len(what.frequencies), -1)[:: peer.sweep_share]
    reference = reference.reshape(len(share.points), -1)
    effort.report(f"{JOB}: {peer.name}, one voltage in {peer.sweep_share}")
    ready, curve = peer.sweep(share), Curve(JOB, peer.name, [])
    for tolerance in peer.sweep_tolerances:
        begun = time.perf_counter()
        error = _error(ready.run(PARAMETERS, tolerance), reference)
        seconds = (time.perf_counter() - begun) * len(what.points) / len(share.points)
        curve.rungs.append(Rung(tolerance, error, seconds))
        if error <= TARGET:
            break
    last = curve.rungs[-1]
    note = f"{len(share.points)} points, multiplied" + ("; less accurate" if last.error > TARGET else "")
    entry = Entry(JOB, peer.name, None, f"{TARGET:g} um", last.tolerance, last.error)
    return dataclasses.replace(entry, compile_seconds=ready.compile_seconds, times=[last.seconds], note=note), curve


def _as_called(what: Grid, reference: np.ndarray, effort: Effort) -> Entry:
    """`pdssjax.sweep` at its default accuracy; its error is that of the net step."""
    effort.report(f"{JOB}: as called")
    study = at_truth(example())
    over = {"drive.voltage": np.array(what.voltages), "drive.frequency": np.array(what.frequencies)}
    call = lambda: pdssjax.sweep(study, over, workers=1, cycles=what.cycles)
    entry = Entry(JOB, "pdssjax.sweep, as called", call, "default", ours=True)
    entry.first_seconds = seconds_of(call)
    apart = 1e6 * np.asarray(call()["net_step"]).ravel() - what.net_steps(reference)
    entry.error, entry.note = float(np.max(np.abs(apart))), "error of the net step; compilation within the first call"
    interleave([entry], effort)
    return entry


def _checked(what: Grid, reference: np.ndarray) -> str:
    """How far the reference is from the hand-written stepper, which shares no line with it."""
    if reason := CFloor().missing():
        return f"{JOB}: the reference could not be checked. {reason}"
    part = reference.reshape(len(what.voltages), len(what.frequencies), -1)[::_CHECKED]
    share = what.thinned(_CHECKED)
    found = simulate_grid(PARAMETERS, share, 1e-12, order=30, precise=True)
    apart = _error(found, part.reshape(found.shape))
    return f"{JOB}: reference {apart:.0e} um from the C stepper in long double, worst of {len(share.points)} points"


def _ratios(entries: list[Entry]) -> list[str]:
    floor = [e.median for e in entries if e.who == CFloor().name]
    ours = [e for e in entries if e.ours]
    return [f"{JOB}: {e.who} takes {e.median / floor[0]:.2g} times the C floor" for e in ours if floor]


def _error(found: np.ndarray, reference: np.ndarray) -> float:
    worst = np.max(np.abs(found - reference))
    return float("inf") if np.isnan(worst) else float(worst)


def _growth(effort: Effort) -> list[dict[str, float]]:
    """Time and peak memory of `pdssjax.sweep` in a process of its own, for each number of points."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for points in _POINTS:
            effort.report(f"sweep: {points} points in a fresh process")
            done = subprocess.run(
                [sys.executable, "-c", _FRESH, str(points)],
                env=os.environ | {"PDSSJAX_CACHE": folder},
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode:
                raise RuntimeError(f"the sweep of {points} points failed: {done.stderr[-2000:]}")
            rows.append(json.loads(done.stdout))
    return rows
