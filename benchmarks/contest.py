"""Everyone does the same, each at the loosest tolerance that is accurate enough."""

from collections.abc import Callable, Sequence

import numpy as np

from .measure import Effort, Entry, Outcome, climb, interleave, seconds_of
from .peers.base import AbstractPeer, Prepared

HOPELESS = 0.1
"""Whose best error, over all tolerances tried, is larger is wrong, not merely inaccurate."""


def contest(
    job: str,
    able: Sequence[tuple[AbstractPeer, Sequence[float]]],
    *,
    prepare: Callable[[AbstractPeer], Prepared],
    error: Callable[[np.ndarray], float],
    targets: dict[str, float],
    parameters: np.ndarray,
    effort: Effort,
) -> Outcome:
    """Times those who are `able`, with the tolerances each may choose from, at each of the `targets`."""
    outcome, prepared, first = Outcome([]), {}, {}
    for peer, tolerances in able:
        if reason := peer.missing():
            outcome.lines.append(f"{peer.name}: left out. {reason}")
            continue
        effort.report(f"{job}: {peer.name}")
        ready = prepared[peer.name] = prepare(peer)
        first[peer.name] = seconds_of(lambda r=ready, t=tolerances[0]: r.run(parameters, t))
        outcome.curves.append(climb(job, peer.name, lambda t, r=ready: r.run(parameters, t), error, tolerances))
    for curve in outcome.curves:
        curve.wrong = min(rung.error for rung in curve.rungs) > HOPELESS
    for rank, (name, target) in enumerate(targets.items()):
        present = []
        for curve in outcome.curves:
            rung = curve.reaching(target)
            # The wrong ones are shown once, at the loosest tolerance they were tried at.
            if rung is None and curve.wrong and rank == 0:
                rung = curve.rungs[0]
            if rung is not None:
                ready = prepared[curve.who]
                entry = Entry(
                    job=job,
                    who=curve.who,
                    call=lambda r=ready, t=rung.tolerance: r.run(parameters, t),
                    target=name,
                    tolerance=rung.tolerance,
                    error=rung.error,
                    wrong=curve.wrong,
                    compile_seconds=ready.compile_seconds,
                    first_seconds=first[curve.who],
                    ours=curve.who.startswith("pdssjax"),
                )
                present.append(entry)
        effort.report(f"{job} at {name}: {len(present)} in turns")
        interleave(present, effort)
        outcome.entries += present
    return outcome
