"""Likelihood intervals: how far each parameter can go while the others make the best of it.

The 95 % interval of a parameter holds the values at which chi-square, minimised over all other parameters, stays
below its minimum plus a threshold.  Its ends are found without a curve (`end_search`), all of them side by side:
what one linearisation tells of how the residuals bend serves every search (`shared_curvature`).
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor

import numpy as np
from jaxtyping import Array, Float

from ..draws import each_done
from ..parameter_transform import Box
from .end_search import End, EndSearch, PointRequests, SharedCurvature, probe_places, standard_errors
from .quadratic_end import Aim
from .second_order import Linearisation

Evaluate = Callable[
    [Float[Array | np.ndarray, " p"]], tuple[Float[Array | np.ndarray, " n"], Float[Array | np.ndarray, "n p"]]
]
"""Whitened residual and its Jacobian at a point; not finite where the model cannot be evaluated."""

Which = tuple[int, float]
"""Index of a parameter, and the side of its interval: -1.0 or 1.0."""

Threshold = float | Float[np.ndarray, " p"]
"""Excess of chi-square over its minimum at an end: one for all parameters, or one for each."""

REACH = 7.0
"""How far a parameter is followed before it counts as flat, on the fit's scale: a factor of a thousand."""


def linearise(evaluate: Evaluate, at: Float[np.ndarray, " p"]) -> Linearisation:
    """`evaluate` at a point, as arrays of NumPy."""
    residual, jacobian = evaluate(at)
    return Linearisation(np.array(at, float), np.asarray(residual), np.asarray(jacobian))


def linearise_all(
    evaluate: Evaluate, places: Sequence[Float[np.ndarray, " p"]], executor: Executor | None = None
) -> list[Linearisation]:
    """`evaluate` at several points, side by side in the threads of the `executor`."""
    work = lambda number: linearise(evaluate, places[number])
    found = dict(each_done(work, range(len(places)), executor))
    return [found[number] for number in range(len(places))]


def learn_curvature(
    evaluate: Evaluate,
    optimum: Linearisation,
    threshold: Threshold,
    bounds: Box,
    factor: float = 1.0,
    executor: Executor | None = None,
) -> SharedCurvature:
    """Learn the curvature that the ends around an `optimum` share, by one evaluation per parameter.

    **Arguments:** as of `interval_ends`; the `factor` by which variances exceed those of the noise given.
    """
    sizes, scale = standard_errors(optimum, threshold, REACH)
    places = probe_places(optimum.at, sizes, scale, bounds)
    return SharedCurvature(optimum, linearise_all(evaluate, places, executor), scale, factor)


def interval_ends(
    evaluate: Evaluate,
    optimum: Linearisation,
    which: Sequence[Which],
    threshold: Threshold,
    bounds: Box,
    shared: SharedCurvature,
    reach: float = REACH,
    executor: Executor | None = None,
    report: Callable[[int], None] = lambda done: None,
) -> list[End]:
    """The likelihood ends at the sides of parameters that `which` names.

    **Arguments:** the `optimum` of the sum of squares between `bounds`; the `threshold` by which chi-square may
    exceed its minimum; what is known of its curvature (`learn_curvature`); how far a parameter is followed before it
    counts as flat, `reach` on the fit's scale; `report` is told how many ends have been found.
    """
    low, high = (np.asarray(end, float) for end in bounds)
    # What runs away is held there: its effect has died out long before.
    near, far = np.maximum(low, optimum.at - reach), np.minimum(high, optimum.at + reach)
    sizes = standard_errors(optimum, threshold, reach)[0]
    searches: dict[Which, PointRequests] = {}
    thresholds = np.broadcast_to(threshold, optimum.at.shape)
    for index, side in which:
        excess = float(thresholds[index])
        aim = Aim(index, side, optimum.chi2 + excess, near, far, sizes)
        bound = float((high if side > 0 else low)[index])
        searches[index, side] = EndSearch(optimum, aim, bound, reach, excess, shared).run()
    ends: dict[Which, End] = {}
    requested = {name: next(search) for name, search in searches.items()}
    while requested:
        found = dict(zip(requested, linearise_all(evaluate, list(requested.values()), executor), strict=True))
        shared.learn(list(found.values()))
        requested = {}
        for name, point in found.items():
            try:
                requested[name] = searches[name].send(point)
            except StopIteration as stop:
                ends[name] = stop.value
        report(len(ends))
    return [ends[name] for name in which]
