"""The joint fit of the packaged example: nine parameters, five records, all from the same starts.

Twice: from the starts that pdssjax finds in the records, and from starts 5 % beside the optimum.  The peers are
SciPy's `least_squares` and lmfit's `leastsq` over LSODA with differences (`peer_fits`), warm.  From far
away chi-square is rugged, they end in another optimum or are broken off once they have taken so many times as
long as ours, unless the benchmark is patient; from nearby all find the same one, and run to their end.
"""

import math
from collections.abc import Callable

import pdssjax
from pdssjax import Study

from ..measure import Curve, Effort, Entry, Outcome, Rung, interleave, seconds_of
from ..peer_fits import FITS, Fitted, Residual
from ..peers import peers
from ..peers.base import AbstractPeer
from ..rig import example, stepped

JOB = "joint fit"
NEAR = "joint fit, starts 5 % off"
BROKEN_OFF = 20.0
"""How many times as long as ours a peer's fit may take from the far starts."""
_OFF = 0.05

Found = dict[str, tuple[float, float]]
"""Every free parameter with its standard error [SI]."""


def measure(effort: Effort) -> Outcome:
    """Chi-square and the time to it."""
    effort.report("joint fit: searching for starts")
    starts: dict[str, float] = {}
    search = seconds_of(lambda: starts.update(pdssjax.initial_guess(example())))
    again = seconds_of(lambda: pdssjax.initial_guess(example()))
    searched, _ = _ours(JOB, "pdssjax identify, starts searched for", lambda: example(), effort)
    given, best = _ours(JOB, "pdssjax identify, from given starts", lambda: example().with_starts(starts), effort)
    every, _ = _ours(JOB, "the same, every cycle stepped", lambda: stepped(example()).with_starts(starts), effort)
    signs = {path: 1.0 if place % 2 else -1.0 for place, path in enumerate(best)}
    near = starts | {path: value * (1.0 + _OFF * signs[path]) for path, (value, _) in best.items()}
    close, best_close = _ours(NEAR, "pdssjax identify", lambda: example().with_starts(near), effort)
    interleave([searched, given, every, close], effort)
    outcome = Outcome([searched, given, every, close])
    outcome.lines.append(f"joint fit: the search for starts takes {search:.2f} s at first and {again:.2f} s warm")
    if effort.fits:
        most = math.inf if effort.patient else BROKEN_OFF * given.median
        _peers(outcome, JOB, starts, best, most, effort)
        _peers(outcome, NEAR, near, best_close, math.inf, effort)
        # Ours is what the others' distance is measured from.
        outcome.curves.append(Curve(NEAR, close.who, [Rung(math.nan, math.nan, close.median)]))
    return outcome


def _peers(outcome: Outcome, job: str, starts: dict[str, float], best: Found, most: float, effort: Effort) -> None:
    """Adds the fits of the others from the same `starts`, each broken off after `most` seconds."""
    study = example()
    able = [(peer, fit) for peer in peers() if peer.fit_tolerance for fit in FITS]
    # lmfit over the quickest of them is enough, and SciPy's LSODA with the quicker of its fields.
    able = [(peer, fit) for peer, fit in able if fit.name == "least_squares" or peer.name == "numbalsoda"]
    for peer, fit in [(peer, fit) for peer, fit in able if peer.name != "SciPy LSODA"]:
        who = f"{fit.name} over {peer.name}"
        if reason := peer.missing() or fit.missing():
            outcome.lines.append(f"{who}: left out. {reason}")
            continue
        effort.report(f"{job}: {who}" + (f", {most:.0f} s at most" if math.isfinite(most) else ""))
        found = fit.run(Residual(peer, study, starts), most)
        entry = _entry(job, who, peer, found, best)
        outcome.entries.append(entry)
        if job == NEAR:
            outcome.curves.append(Curve(job, who, [Rung(entry.tolerance, _apart(found, best), found.seconds)]))
        outcome.lines.append(f"{job}, {who}: {found.says()}")


def _ours(job: str, who: str, fresh: Callable[[], Study], effort: Effort) -> tuple[Entry, Found]:
    """A fit of a newly loaded study each time, and what it finds."""
    effort.report(f"{job}: {who}")
    estimates = []
    run = lambda: estimates.append(pdssjax.identify(fresh()))
    first = seconds_of(run)
    found = estimates[0]
    count = found.statistics
    note = f"chi-square {count.chi2:.3f}, {count.iterations} iterations, {count.evaluations} evaluations"
    entry = Entry(job, who, run, first_seconds=first, note=f"{note}; compilation within the first call", ours=True)
    return entry, {path: (p.value, p.standard_error) for path, p in found.parameters.items() if p.free}


def _apart(found: Fitted, best: Found) -> float:
    """The largest distance of a parameter from ours, in standard errors."""
    return max(abs(number - best[path][0]) / best[path][1] for path, number in found.values.items() if path in best)


def _entry(job: str, who: str, peer: AbstractPeer, found: Fitted, best: Found) -> Entry:
    apart = _apart(found, best)
    note = f"chi-square {found.chi2:.3f}, {found.calls} evaluations, {apart:.2g} standard errors from ours"
    entry = Entry(job, who, None, tolerance=peer.fit_tolerance or 0.0, note=note, times=[found.seconds])
    entry.cut, entry.wrong = found.cut, not found.cut and not apart <= 1.0
    return entry
