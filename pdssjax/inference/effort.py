"""The effort of a fit: starts tried, evaluations allowed, and the slow steps after which it ends."""

from typing import NamedTuple

from ..core import InputError, nearest


class Effort(NamedTuple):
    """One setting for all trade-offs between time and the least chi-square."""

    name: str
    starts: float
    """Starts that a doubtful fit is compared with, and points at which starts are searched for, in parts of the usual
    numbers."""
    evaluations: int
    """Model evaluations of all runs together, after which no other start is fitted."""
    iterations: int
    """Linearisations of one run."""
    slow_steps: int
    """Slow steps in a row after which a run ends: it creeps along a valley."""
    slow_gain: float
    """Decrease of chi-square, in units of the reduced chi-square, below which a step is slow."""
    compares: bool = True
    """Whether a poor fit is compared with fits from other starts, and its errors by all error models are found; if
    False, only a fit without a record of the platform alone is compared."""

    def some(self, count: int) -> int:
        """The number of starts tried where usually `count` are; one at least."""
        return max(1, round(self.starts * count))

    @property
    def advice(self) -> str:
        """The end of a message on a fit that could go on with more effort; "" at the highest effort."""
        return "" if self.name == "thorough" else f'; it ends here with effort "{self.name}", "thorough" goes on'


# A decrease of chi-square by 0.05 is a quarter of a standard error.  The example takes 113 evaluations.
USUAL = Effort("usual", starts=1.0, evaluations=4000, iterations=200, slow_steps=12, slow_gain=0.05)

EFFORTS = {
    "quick": Effort("quick", starts=0.25, evaluations=400, iterations=60, slow_steps=6, slow_gain=0.2),
    "usual": USUAL,
    "thorough": Effort("thorough", starts=2.0, evaluations=40_000, iterations=1000, slow_steps=40, slow_gain=0.005),
}
"""The settings by the name that a user gives."""


def effort_of(name: str | Effort) -> Effort:
    """The effort of a `name`, or the one that is given; **raises** `InputError` where there is none."""
    if isinstance(name, Effort):
        return name
    if name not in EFFORTS:
        raise InputError(f'effort: found "{name}"; {nearest(name, EFFORTS)}')
    return EFFORTS[name]
