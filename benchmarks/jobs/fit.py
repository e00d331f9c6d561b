"""The joint fit of the packaged example: nine parameters, five records, from the same starts.

pdssjax also runs as the user has it, starts searched for.  The peers are SciPy's
`least_squares` and lmfit's `leastsq` over LSODA with differences (`peer_fits`), warm, and broken
off once they have taken so many times as long as ours, unless the benchmark is patient.
"""

import math
from collections.abc import Callable

import pdssjax
from pdssjax.study import Study

from ..measure import Effort, Entry, Outcome, interleave, seconds_of
from ..peer_fits import FITS, Fitted, Residual
from ..peers import peers
from ..peers.base import AbstractPeer
from ..rig import example, started, stepped

JOB = "joint fit"
BROKEN_OFF = {"numbalsoda": 16.0}
"""How many times as long as ours a peer's fit may take."""
_BROKEN_OFF = 55.0
"""The same for every other peer."""


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
    entries = [entry for entry, *_ in ours]
    interleave(entries, effort)
    outcome = Outcome(entries)
    outcome.lines.append(f"joint fit: the search for starts takes {search:.2f} s at first and {again:.2f} s warm")
    if not effort.fits:
        return outcome
    able = [(peer, fit) for peer in peers() if peer.fit_tolerance for fit in FITS]
    # lmfit over the quickest of them is enough, and SciPy's LSODA with the quicker of its fields.
    able = [(peer, fit) for peer, fit in able if fit.name == "least_squares" or peer.name == "numbalsoda"]
    able = [(peer, fit) for peer, fit in able if peer.name != "SciPy LSODA"]
    for peer, fit in able:
        who = f"{fit.name} over {peer.name}"
        if reason := peer.missing() or fit.missing():
            outcome.lines.append(f"{who}: left out. {reason}")
            continue
        seconds = math.inf if effort.patient else BROKEN_OFF.get(peer.name, _BROKEN_OFF) * entries[1].median
        effort.report(f"joint fit: {who}, {seconds:.0f} s at most")
        found = fit.run(Residual(peer, study, starts), seconds)
        outcome.entries.append(_entry(who, peer, found, best))
        outcome.lines.append(f"{who}: {found.says()}; pdssjax has {ours[1][2]:.3f}")
    return outcome


def _ours(who: str, fresh: Callable[[], Study], effort: Effort) -> tuple[Entry, dict[str, tuple[float, float]], float]:
    """A fit of a newly loaded study each time; also every parameter with its standard error, and chi-square."""
    effort.report(f"joint fit: {who}")
    estimates = []
    run = lambda: estimates.append(pdssjax.identify(fresh()))
    first = seconds_of(run)
    found = estimates[0]
    count = found.statistics
    note = f"chi-square {count.chi2:.3f}, {count.iterations} iterations, {count.evaluations} evaluations"
    entry = Entry(JOB, who, run, first_seconds=first, note=f"{note}; compilation within the first call", ours=True)
    free = {path: (p.value, p.standard_error) for path, p in found.parameters.items() if p.free}
    return entry, free, float(count.chi2)


def _entry(who: str, peer: AbstractPeer, found: Fitted, best: dict[str, tuple[float, float]]) -> Entry:
    apart = max(abs(number - best[path][0]) / best[path][1] for path, number in found.values.items() if path in best)
    note = f"chi-square {found.chi2:.3f}, {found.calls} evaluations, {apart:.2g} standard errors from ours"
    entry = Entry(JOB, who, None, tolerance=peer.fit_tolerance or 0.0, note=note, times=[found.seconds])
    entry.cut, entry.wrong = found.cut, not found.cut and not apart <= 1.0
    return entry
