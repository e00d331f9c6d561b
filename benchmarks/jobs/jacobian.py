"""The same record with its Jacobian: ten columns, d x_e / d log(parameter)."""

from ..contest import contest
from ..measure import Effort, Outcome
from ..peers import peers
from ..problem import PARAMETERS, Problem, reference

JOB = "Jacobian"
TARGETS = (1e-3, 1e-5)
"""Largest relative errors allowed in any column."""


def measure(effort: Effort) -> Outcome:
    """Everyone at equal accuracy; those who never reach it are marked as wrong."""
    problem = Problem()
    right = reference(problem)
    able = [(peer, peer.jacobian_tolerances) for peer in peers() if peer.jacobian_tolerances]
    return contest(
        JOB,
        able,
        prepare=lambda peer: peer.jacobian(problem),
        error=right.jacobian_error,
        targets={f"{target:g}": target for target in TARGETS},
        parameters=PARAMETERS,
        effort=effort,
    )
