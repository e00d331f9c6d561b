"""Where a run ended on a kink of the sum of squares: whether that is a minimum, and the way along the kink to one.

Where the residual's slope changes, the sum of squares has a one-sided gradient on either side.  The point is a minimum
to first order where the slope rises across the kink and some mixture of the two gradients vanishes (F. H. Clarke,
Optimization and Nonsmooth Analysis, Wiley 1983, chapter 2).  As for any end of a run, a gradient vanishes where the
linear model with that Jacobian, within the bounds, predicts a decrease too small to matter.  The step that it predicts
for the mixture that promises least leads along the kink: were it to cross it, another mixture would promise less.
"""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from .iterations import Point, Run, begin, iterate, iterates
from .lm_state import STOPPED, Ending, LMState, Vector

_MOST_STEPS = 8
"""Steps along a kink."""

_BOX_ROOM = 1e-12
"""Least distance between bounds that `lsq_linear` accepts, by effect on the residual."""

_SHARES = tuple(0.5**power for power in range(11))
"""Fractions of a step along a kink that are tried: the kink may bend away from it."""

_HALVINGS, _COMPARED = 16, 4
"""Halvings of the stretch with the kink; the change of slope is compared with that `_COMPARED` halvings before."""


def along_kink(run: Run, y: Point, state: LMState) -> tuple[Point, LMState, float]:
    """Continue a run that ended in `Ending.KINK` along the kink, while that lowers the sum of squares.

    **Returns:** the point, its state, and the decrease of the sum of squares that is still predicted there.
    """
    bounds = {end: np.asarray(at) for end, at in run.bounds.items()}
    blank, least = begin(run, np.asarray(y), state.residual, state.aux), np.inf
    for _ in range(_MOST_STEPS):
        sides = [iterate(run, side, blank)[1] for side in state.across]
        (least, step), squares = least_promising(state, sides, y, bounds), _squares(state)
        if not float(run.solver.invisible) * squares < least < np.inf:
            break
        lower = _lower(run, y, step, squares, blank)
        if lower is None:
            break
        y, last = lower
        state = last._replace(evaluations=last.evaluations + state.evaluations + len(sides))
        if int(state.ending) != Ending.KINK:
            return y, state, float(state.predicted_reduction)
    return y, state, least


def _lower(
    run: Run, y: Point, step: Float[np.ndarray, " p"], squares: float, blank: LMState
) -> tuple[Point, LMState] | None:
    """The end, below `squares`, of a run that starts after a `step` along a kink or a part of one; None without any."""
    for share in _SHARES:
        to = jnp.asarray(np.clip(np.asarray(y) + share * step, run.bounds["lower"], run.bounds["upper"]))
        _, started, _ = iterate(run, to, blank)
        # The way of a whole step may lead down to the kink again; a part of it stays near enough.
        if share < 1.0 and not _squares(started) < squares:
            continue
        # No farther than that step: the whole way down this side of the kink is known to lead across it.
        near = started._replace(radius=share * np.linalg.norm(np.asarray(started.size) * step))
        further, last = beside_kink(run, *deque(iterates(run, to, near, 100), maxlen=1).pop())
        if _squares(last) < squares:
            return further, last
    return None


def beside_kink(run: Run, y: Point, state: LMState) -> tuple[Point, LMState]:
    """The kink that stopped a run beside it, with the ending `Ending.KINK`; the run's own end where there is none.

    Along the proposed step the sum of squares falls up to the kink and rises beyond.  Steps across the kink gain
    nothing and shorter ones little.  Differences as long as a standard error may hide the kink, since most residuals
    keep their slopes.
    """
    if int(state.ending) not in STOPPED:
        return y, state
    blank, bounds = begin(run, np.asarray(y), state.residual, state.aux), run.bounds
    step = np.asarray(state.proposed_step)

    def kink_point(share: float, free: Vector, there: LMState) -> _KinkPoint:
        change = np.asarray(there.jacobian) @ step
        return _KinkPoint(share, free, there, change, float(change @ np.asarray(there.residual)))

    def evaluated(share: float) -> _KinkPoint:
        to = jnp.asarray(np.clip(np.asarray(y) + share * step, bounds["lower"], bounds["upper"]))
        return kink_point(share, to, iterate(run, to, blank)[1])

    before, beyond, count = kink_point(0.0, jnp.asarray(y), state), None, 0
    # Shares of the step, the nearest first.
    for share in (4.0**power for power in range(-10, 1)):
        point, count = evaluated(share), count + 1
        if point.slope >= 0.0:
            beyond = point
            break
        before = point
    if beyond is None or not before.slope < 0.0:
        return y, state
    rises = [beyond.slope - before.slope]
    for _ in range(_HALVINGS):
        middle, count = evaluated(0.5 * (before.share + beyond.share)), count + 1
        before, beyond = (middle, beyond) if middle.slope < 0.0 else (before, middle)
        rises.append(beyond.slope - before.slope)
    lower = min(before, beyond, key=lambda point: _squares(point.state))
    jump = np.linalg.norm(np.asarray(beyond.state.residual) - np.asarray(before.state.residual))
    steepest = max(np.linalg.norm(before.change), np.linalg.norm(beyond.change))
    # A residual that jumps by more than its slopes explain has no kink there.
    continuous = jump <= 2.0 * (beyond.share - before.share) * steepest
    if rises[-1] < 0.5 * rises[-1 - _COMPARED] or not continuous or _squares(lower.state) > _squares(state):
        return y, state
    counted = {"evaluations": state.evaluations + count, "iterations": state.iterations}
    ended = jnp.asarray(int(Ending.KINK))
    across = jnp.stack([beyond.free, before.free])
    return lower.free, lower.state._replace(ending=ended, checked=state.checked, across=across, **counted)


class _KinkPoint(NamedTuple):
    share: float
    """Fraction of the step."""
    free: Vector
    state: LMState
    change: Float[np.ndarray, " n"]
    """Predicted change of the residual over the whole step, by the Jacobian at this point."""
    slope: float
    """Half of that of the sum of squares."""


def _squares(state: LMState) -> float:
    return float(np.sum(np.asarray(state.residual) ** 2))


def least_promising(
    state: LMState, sides: Sequence[LMState], y: Point, options: dict[str, Float[np.ndarray, " p"]]
) -> tuple[float, Float[np.ndarray, " p"]]:
    """The mixture of the Jacobians on both `sides` of the kink at `y` whose best step within the bounds promises least.

    **Arguments:** the states at `y` and at the two points that the first has `across` the kink.

    **Returns:** the decrease of the sum of squares that it predicts, infinite on a ridge, where the slope falls across
    the kink; and its step, which leads along the kink.
    """
    from scipy.optimize import fminbound, lsq_linear  # few runs need it, and its import takes a third of a second

    y, (ahead, behind) = np.asarray(y, float), np.asarray(state.across, float)
    here, there = (np.asarray(side.jacobian, float) for side in sides)
    residual, *beside = (np.asarray(of.residual, float) for of in (state, *sides))
    if not all(np.all(np.isfinite(values)) for values in (here, there, *beside)):
        return np.inf, np.zeros_like(y)
    if (here.T @ beside[0] - there.T @ beside[1]) @ (ahead - behind) < 0.0:
        return np.inf, np.zeros_like(y)
    low, high = (np.asarray(options[end], float) for end in ("lower", "upper"))
    size = np.maximum(np.linalg.norm(here, axis=0), np.linalg.norm(there, axis=0))
    free = (low < high) & (size > 0)
    size = size[free]
    # All that sums of squares need of the two Jacobians and the residual.
    stacked = np.column_stack([here[:, free] / size, there[:, free] / size, residual])
    triangle = np.asarray(np.linalg.qr(stacked, mode="r"))
    first, second, right = triangle[:, : size.size], triangle[:, size.size : -1], triangle[:, -1]
    box = (low - y)[free] * size - _BOX_ROOM, (high - y)[free] * size + _BOX_ROOM

    def predicted(share: float) -> tuple[float, Float[np.ndarray, " p"]]:
        found = lsq_linear((1.0 - share) * first + share * second, -right, bounds=box)
        return float(right @ right - 2.0 * found.cost), found.x

    inside = np.asarray(fminbound(lambda share: predicted(share)[0], 0.0, 1.0, xtol=1e-9)).item()
    gain, scaled = min((predicted(share) for share in (0.0, inside, 1.0)), key=lambda of: of[0])
    step = np.zeros_like(y)
    step[free] = scaled / size
    return max(0.0, gain), step
