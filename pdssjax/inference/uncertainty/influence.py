"""The influence of the samples on a least-squares estimate, to first order, from which all its covariances follow.

Where the samples are off by e, the estimate is off by H^-1 J' e.  H = J' J + S, S = sum r d2r, is the whole second
derivative of half the sum of squares: where the model does not explain the data, its residuals r do not average out,
and without their curvature S the errors are wrong (H. White, Econometrica 50(1), 1982).  By how much is in
docs/decisions/13-error-models.md.

With the pseudo-inverse L U' of J, U' U = 1 and L L' = (J' J)^-1, it is H^-1 J' = L (1 + L' S L)^-1 U'.  The columns of
L are principal directions, each as long as its standard error: along them S is found by differences of the Jacobian
that neither rounding nor a narrow valley spoils.

In a fit in two steps parameters a are fitted to the first step's samples, and held while b are fitted to the second's.
An error of a moves b by -H_b^-1 J_b' J_a da to first order (K. M. Murphy and R. H. Topel, Journal of Business and
Economic Statistics 3(4), 1985).  `TwoSteps` has that as the influence of the first step's samples on b, so that any
error model may follow.  A stack that was read off peaks is a first step whose samples are its readings.

The thesis identifies the stack first and takes it for exact; its section 6.2 asks what its errors do to the friction.
`amplification_of` answers it: the relative change of each b by a relative change of each a.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from ...study import Amplification
from ..covariance import NO_INFORMATION, scaled_least_squares
from ..evidence import Evidence
from ..least_squares import Fit, Method, Progress, evaluated, quiet
from ..parameter_transform import Box
from ..problem import Problem
from ..stack_first.peak_picking import PATHS, PickedStack
from ..stack_parameters import platform_alone_records, stack_parameters, stack_residuals

LEAST_CURVATURE, MOST_CURVATURE = 0.2, 5.0
"""Limits of the curvature of the sum of squares, as a share of that of J' J; beyond, the sum of squares is too far from
quadratic for any covariance."""

LONGEST = 0.1
"""Longest step along a principal direction, in any parameter, on the fit's scale: ten per cent of a positive one."""


def influence_of(
    jacobian: Float[np.ndarray, "n p"], curvature: Float[np.ndarray, "p k"] | None = None
) -> Float[np.ndarray, "n p"]:
    """H^-1 J', transposed: the effect of each sample on each parameter, all of them fitted at once.

    **Arguments:** `curvature` S L, along the principal directions; None: none.  A direction without information is
    left out.
    """
    left, spread = pseudo_inverse(jacobian)
    if curvature is None:
        return left @ spread.T
    return left @ np.linalg.solve(relative_curvature(spread, curvature), spread.T)


def principal_directions(jacobian: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "p k"]:
    """L: as columns, the steps that change the whitened residuals by 1, in directions at right angles there."""
    return pseudo_inverse(jacobian)[1]


def curvature_of(
    jacobian_at: Callable[[Float[np.ndarray, " p"]], Float[np.ndarray, "n p"]],
    free: Float[np.ndarray, " p"],
    residual: Float[np.ndarray, " n"],
    jacobian: Float[np.ndarray, "n p"],
    directions: Float[np.ndarray, "p k"],
    groups: Sequence[slice],
    bounds: Box,
) -> list[Float[np.ndarray, "p k"]]:
    """S along `directions`, of each group of samples, by differences of the Jacobian.

    **Arguments:** `jacobian_at`, the Jacobian at a point; `residual` and `jacobian` at the point `free`; `bounds`,
    lower and upper, that no step crosses.

    **Returns:** a matrix a group; column j is (J(free + h v_j) - J)' r / h, with h = 1 or less; 0 where the Jacobian
    is not finite there.
    """
    out = [np.zeros(directions.shape) for _ in groups]
    for j, direction in enumerate(directions.T):
        step = min(1.0, LONGEST / float(np.max(np.abs(direction))))
        step = _inside(free, direction, step, bounds)
        there = jacobian_at(free + step * direction)
        if not np.isfinite(there).all():
            continue
        for matrix, rows in zip(out, groups, strict=True):
            matrix[:, j] = (there[rows] - jacobian[rows]).T @ residual[rows] / step
    return out


def _inside(free: Float[np.ndarray, " p"], direction: Float[np.ndarray, " p"], step: float, bounds: Box) -> float:
    """`step`, its negative, or a shorter one, so that no bound is crossed; tiny where all of them cross one."""
    for _ in range(40):
        for way in (step, -step):
            there = free + way * direction
            moved = direction != 0.0
            if np.all((there >= bounds[0])[moved]) and np.all((there <= bounds[1])[moved]):
                return way
        step *= 0.5
    return step


def pseudo_inverse(jacobian: Float[np.ndarray, "n p"]) -> tuple[Float[np.ndarray, "n k"], Float[np.ndarray, "p k"]]:
    """Factors U and L of the pseudo-inverse J+ = L U'; the columns of L are the principal directions."""
    norms = np.linalg.norm(jacobian, axis=0)
    norms = np.where(norms > 0, norms, np.inf)
    left, singular, rows = np.linalg.svd(jacobian / norms, full_matrices=False)
    known = singular > NO_INFORMATION * np.max(singular, initial=0.0)
    return left[:, known], (rows[known] / singular[known, None] / norms).T


def relative_curvature(
    spread: Float[np.ndarray, "p k"], curvature: Float[np.ndarray, "p k"]
) -> Float[np.ndarray, "k k"]:
    """1 + L' S L: H where J' J is the identity, its eigenvalues between `LEAST_CURVATURE` and `MOST_CURVATURE`."""
    relative = spread.T @ curvature
    values, axes = np.linalg.eigh(0.5 * (relative + relative.T))
    return axes * np.clip(1.0 + values, LEAST_CURVATURE, MOST_CURVATURE) @ axes.T


class TwoSteps(NamedTuple):
    """The Jacobians of the steps of a fit, each zero in the rows that it does not use, and what is fitted in each."""

    first: Float[np.ndarray, "n p"]
    second: Float[np.ndarray, "n p"]
    earlier: Int[np.ndarray, " q"]
    """Places of the parameters fitted in the first step."""
    later: Int[np.ndarray, " r"]

    def with_first_exact(self) -> "TwoSteps":
        """The steps where the second takes the result of the first for exact."""
        second = self.second.copy()
        second[:, self.earlier] = 0.0
        return self._replace(second=second)

    def influence(
        self, curvatures: tuple[Float[np.ndarray, "p k"], Float[np.ndarray, "p k"]] | None = None
    ) -> Float[np.ndarray, "n p"]:
        """The effect of each sample on each parameter.

        **Arguments:** `curvatures` S of the first and of the second step's residuals, along the `directions`; None:
        none.
        """
        found = np.zeros(self.first.shape)
        base, along = pseudo_inverse(self.first[:, self.earlier])
        left, spread = pseudo_inverse(self.second[:, self.later])
        count, inverse = along.shape[1], spread.T
        late = None
        if curvatures is not None:
            early, late = curvatures
            # Of the first step's samples on its principal directions.
            base = base @ np.linalg.inv(relative_curvature(along, early[self.earlier, :count]))
            inverse = np.linalg.solve(relative_curvature(spread, late[self.later, count:]), spread.T)
        found[:, self.earlier] = base @ along.T
        shift = (self.second[:, self.earlier] @ along).T @ left
        if late is not None:
            shift = shift + late[self.later, :count].T @ spread
        found[:, self.later] = (left - base @ shift) @ inverse
        return found

    def directions(self) -> Float[np.ndarray, "p k"]:
        """The principal directions of the first step, then those of the second, each in what it fits."""
        parts, count = [], self.first.shape[1]
        for jacobian, places in ((self.first, self.earlier), (self.second, self.later)):
            parts.append(_among(principal_directions(jacobian[:, places]), places, count))
        return np.hstack(parts)


class FittedPoint:
    """The optimum of a fit of p parameters to n residuals, and how its estimate follows them.

    **Arguments:** with a `stack` that was read off peaks, its readings are further rows below the residuals.
    """

    def __init__(self, method: Method, evidence: Evidence, stack: PickedStack | None = None):
        self.method, self.evidence, self.stack = method, evidence, stack
        self.problem, self.fit = problem, fit = evidence.problem, evidence.fit
        self.residual, self.jacobian = np.asarray(fit.state.residual), np.asarray(fit.state.jacobian)
        held = problem.residual.transform.at_bound(fit.free)
        self.fitted: Bool[np.ndarray, " p"] = ~held & (np.linalg.norm(self.jacobian, axis=0) > 0)
        """The parameters that the records move: not held at a bound."""
        self.known = evidence.given_covariance.identifiable
        """Which of the parameters the records determine."""

    def influence(self, curvatures: Sequence[Float[np.ndarray, "p k"]] | None = None) -> Float[np.ndarray, "n p"]:
        """The effect of each residual on each parameter, on the fit's scale; zero of parameters that are not known.

        **Arguments:** `curvatures` of each record's residuals along the principal directions; None: none.
        """
        if self.method != "joint":
            alone = platform_alone_records(self.problem.records)
            both = None if curvatures is None else (_total(curvatures, alone), _total(curvatures, ~alone))
            return self.steps.influence(both)
        out, kept = np.zeros(self.jacobian.shape), self.fitted
        total = None if curvatures is None else np.sum(curvatures, axis=0)[kept]
        out[:, kept] = influence_of(self.jacobian[:, kept], total)
        return out * self.known

    def curvatures(self, report: Progress) -> list[Float[np.ndarray, "p k"]]:
        """For each record, the sum of its residuals times their second derivatives, along the principal directions."""
        report("second derivatives, for errors where the model does not explain all")
        if self.method == "sequential":
            directions = self.steps.directions()
        else:
            directions = _among(principal_directions(self.jacobian[:, self.fitted]), self.fitted, self.fitted.size)

        def jacobian_at(free: Float[np.ndarray, " p"]) -> Float[np.ndarray, "n p"]:
            return np.asarray(evaluated(self.problem, free, quiet).state.jacobian)

        rows, bounds = self.problem.rows, self.problem.bounds
        return curvature_of(jacobian_at, self.fit.free, self.residual, self.jacobian, directions, rows, bounds)

    @property
    def steps(self) -> "TwoSteps":
        """The two steps of a fit that found the stack first."""
        first, stack = stack_residuals(self.problem)[:, None], stack_parameters(self.problem)
        earlier, later = np.flatnonzero(stack & self.known), np.flatnonzero(~stack & self.known)
        early, late = self.jacobian * first, self.jacobian * ~first
        if self.stack is not None:
            paths = self.problem.residual.transform.paths
            earlier = np.array([i for i in earlier if paths[i] in PATHS], int)
            readings = self.stack.prior.rows([path if i in earlier else "" for i, path in enumerate(paths)])
            early, late = np.concatenate([0.0 * late, readings]), np.concatenate([late, 0.0 * readings])
        return TwoSteps(early, late, earlier, later)


def _total(
    matrices: Sequence[Float[np.ndarray, "p k"]], used: Bool[np.ndarray, " records"]
) -> Float[np.ndarray, "p k"]:
    return sum((m for m, use in zip(matrices, used, strict=True) if use), np.zeros_like(matrices[0]))


def _among(
    directions: Float[np.ndarray, "q k"], places: Bool[np.ndarray, " p"] | Int[np.ndarray, " q"], count: int
) -> Float[np.ndarray, "p k"]:
    """Directions of the parameters at the `places` as those of all, so many as `count`."""
    whole = np.zeros((count, directions.shape[1]))
    whole[places] = directions
    return whole


def amplification_of(problem: Problem, fit: Fit, identifiable: Bool[np.ndarray, " p"]) -> Amplification | None:
    """Amplification of errors of the stack into all other parameters, in records not of the platform alone.

    **Arguments:** which of the free parameters are `identifiable`, shape (parameters,); the others are left out.

    **Returns:** relative changes; None where there is no stack to fit, nothing else, or no such record.
    """
    transform = problem.residual.transform
    found = problem.decode(fit.free)
    values = np.array([float(found[path]) for path in transform.paths])
    known = identifiable & (values != 0.0)
    stack, used = stack_parameters(problem), ~stack_residuals(problem)
    earlier, later = np.flatnonzero(stack & known), np.flatnonzero(~stack & known)
    if not (earlier.size and later.size and used.any()):
        return None
    jacobian = np.asarray(fit.state.jacobian)[used]
    relative = transform.slope(fit.free) / np.where(values == 0.0, np.inf, values)
    mixing = transform.own_effect(np.eye(values.size)).T
    # The second step ends where J_b' r = 0, so that a change of the held parameters moves those fitted later.
    sensitivity = -scaled_least_squares(jacobian[:, later], jacobian[:, earlier])
    matrix = mixing[np.ix_(later, later)] @ sensitivity @ np.linalg.inv(mixing[np.ix_(earlier, earlier)])
    paths = np.array(transform.paths)
    return Amplification(
        tuple(map(str, paths[later])),
        tuple(map(str, paths[earlier])),
        relative[later, None] * matrix / relative[earlier],
    )
