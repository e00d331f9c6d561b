"""Whether what the walks leave can come of the stack as it was read off peaks.

The stack is held where it was read, and wrong by its errors; the walks show that as they show a law that lacks
something.  So they are judged by what they would leave had the stack been free to move as far as its errors let it.
To first order that is the least of

    |r + J d|^2 + d_s' C^-1 d_s

over steps d of all parameters, d_s those of what was read, with its covariance C.  A stack that would have to be off
by more than chance gives its errors explains nothing.
"""

import numpy as np

from ...integration import Accuracy
from ...study import Study
from ..least_squares import Fit, quiet
from ..poor_fit import highest_by_chance, is_poor
from ..problem import Problem
from ..search.best_point import Point
from ..stack_parameters import of_platform_alone, of_stack
from .held_stack import rejoined
from .peak_picking import PATHS, PickedStack


def due_to_stack(study: Study, stack: PickedStack, accuracy: Accuracy, fit: Fit, problem: Problem) -> bool:
    """The walks are explained but for the errors of the `stack` held in this `fit` of a `study`."""
    numbers = {**problem.residual.fixed, **problem.decode(fit.free)}
    starts = {path: float(number) for path, number in numbers.items()}
    whole = rejoined(study, Point(fit, problem, starts, 1), accuracy, quiet)
    return not is_poor(*with_stack_freed(whole.fit, whole.problem, stack))


def with_stack_freed(fit: Fit, problem: Problem, stack: PickedStack) -> tuple[Fit, Problem]:
    """Of a whole study, at the end of a fit with the `stack` held: the walks alone, with what they then leave."""
    paths, platform = problem.residual.transform.paths, of_platform_alone(problem.records)
    rows = np.concatenate(
        [np.arange(r.start, r.stop) for r, alone in zip(problem.rows, platform, strict=True) if not alone]
    )
    residual, jacobian = np.asarray(fit.state.residual)[rows], np.asarray(fit.state.jacobian)[rows]
    read = problem.residual.transform.among(PATHS)
    moves = (read | ~of_stack(problem)) & ~problem.residual.transform.at_bound(fit.free)
    places = [PATHS.index(path) for path in paths if path in PATHS]
    known = np.zeros((len(places), len(paths)))
    known[:, read] = np.linalg.cholesky(np.linalg.inv(stack.covariance[np.ix_(places, places)])).T
    columns = np.vstack([jacobian, known]) * moves
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0, size, 1.0)
    step = -np.linalg.lstsq(columns / size, np.append(residual, np.zeros(len(places))), rcond=1e-9)[0] / size
    walks = tuple(record for record, alone in zip(problem.records, platform, strict=True) if not alone)
    off = float(np.sum((known @ step) ** 2))
    if off < len(places) * highest_by_chance(len(places)):
        residual = residual + jacobian @ (step * moves)
    state = fit.state._replace(residual=residual, jacobian=jacobian)
    return fit._replace(state=state), problem._replace(records=walks, noise=problem.noise[~platform])
