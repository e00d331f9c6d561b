"""One record: eight cycles of 64 V at 5 Hz, 1601 samples of the end-effector."""

from ..contest import contest
from ..measure import Effort, Outcome
from ..peers import peers
from ..problem import PARAMETERS, Problem, reference

JOB = "trajectory"
TARGETS = (1e-3, 1e-5)
"""Largest errors allowed [um]."""


def measure(effort: Effort) -> Outcome:
    """Everyone at equal accuracy."""
    problem = Problem()
    right = reference(problem)
    able = [(peer, peer.tolerances) for peer in peers() if peer.tolerances]
    return contest(
        JOB,
        able,
        prepare=lambda peer: peer.trajectory(problem),
        error=right.error,
        targets={f"{target:g} um": target for target in TARGETS},
        parameters=PARAMETERS,
        effort=effort,
    )
