"""The evaluations that all runs of one fit may take together."""

from ...study import Values
from ..effort import Effort
from ..least_squares import Fit, FitMethod, Progress, quiet
from ..problem import Problem


class Budget:
    """Counts the evaluations of every run that it watches, and ends the comparison with other starts.

    Once they are spent a run takes a single step, so that the best so far stands.
    """

    def __init__(self, effort: Effort):
        self.effort, self.spent, self.refused = effort, 0, 0

    def counted(self, run: FitMethod) -> FitMethod:
        """`run`, as long as evaluations are left."""

        def limited(problem: Problem, starts: Values, report: Progress, limit: int = self.effort.iterations) -> Fit:
            if self.spent >= self.effort.evaluations:
                self.refused += 1
                return run(problem, starts, quiet, 1)
            fit = run(problem, starts, report, limit)
            self.spent += fit.evaluations
            return fit

        return limited

    @property
    def word(self) -> str:
        """What a user reads where runs were refused."""
        told = f"; after {self.spent} evaluations no other start was fitted"
        return told + self.effort.advice
