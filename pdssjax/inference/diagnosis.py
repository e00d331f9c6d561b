"""Diagnosis of a fit: contradicting records, determined combinations of parameters, and remedies.

Records that disagree with the others are found by score tests and one-step deletion at the joint optimum, without a
refit.  There the scores J_k' r_k of all records add up to zero.  If the same parameters hold in all of them, the score
of one is as large as noise makes it; if a record asks for other parameters it is larger (L. G. Godfrey,
Misspecification Tests in Econometrics, Cambridge 1988; for deletion R. D. Cook and S. Weisberg, Residuals and
Agreement in Regression, Chapman and Hall 1982).

The combinations of parameters that the data determine, and how well, are eigenvectors of the relative covariance: with
every parameter on a relative scale a direction v is the product of p_i^v_i.  Products along the eigenvectors are
independent of each other, and the square root of the eigenvalue is the relative standard error.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ..study import Agreement, Combination, Diagnosis, Record, Remedy
from .beyond_noise import SIGNIFICANT
from .least_squares import Fit
from .problem import Problem

_NOTICEABLE = 2.0
"""Standard errors by which records must move a parameter for their disagreement to count."""

_LEAST = 1e-10
"""Share of the information below which a direction is undetermined."""


class Score(NamedTuple):
    """Gradient and information of one record at the optimum, on the fit's scale."""

    gradient: Float[np.ndarray, " p"]
    """J' r of its whitened residuals."""
    information: Float[np.ndarray, "p p"]
    """J' J."""
    variance: Float[np.ndarray, "p p"]
    """Covariance of the gradient."""

    def along(self, directions: Float[np.ndarray, "p k"]) -> "Score":
        """The score in these `directions`."""
        gradient, *matrices = self
        return Score(directions.T @ gradient, *(directions.T @ matrix @ directions for matrix in matrices))


def score_of(residual: Float[np.ndarray, " n"], jacobian: Float[np.ndarray, "n p"]) -> Score:
    """The score of one record, from its whitened residuals and their Jacobian.

    The variance is that of residuals as large and as correlated (first order autoregression) as those of a fit to this
    record alone.  So misfit that no parameter removes does not count as a contradiction, nor a contradiction as misfit.
    """
    information = jacobian.T @ jacobian
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(scale, scale), rcond=_LEAST, hermitian=True)
    left = residual - jacobian @ (inverse / np.outer(scale, scale) @ (jacobian.T @ residual))
    squares = max(float(left @ left), 1e-300)
    correlation = min(max(float(left[1:] @ left[:-1]) / squares, 0.0), 0.99)
    variance_factor = max(squares / left.size, 1.0) * (1.0 + correlation) / (1.0 - correlation)
    return Score(jacobian.T @ residual, information, variance_factor * information)


def prior_score(residual: Float[np.ndarray, " n"], jacobian: Float[np.ndarray, "n p"]) -> Score:
    """The score of numbers measured apart, whose residuals have independent errors of standard deviation 1."""
    information = jacobian.T @ jacobian
    return Score(jacobian.T @ residual, information, information)


def agreement(
    scores: Sequence[Score],
    prior: Score,
    groups: Mapping[tuple[str, tuple[str, ...]], Bool[np.ndarray, " records"]],
    errors: Float[np.ndarray, " p"],
    paths: Sequence[str],
) -> tuple[Agreement, ...]:
    """How far each group of records disagrees with the others, and what leaving it out would change.

    **Arguments:** the `scores` of all records, and the `prior` one of what was measured apart, in the parameters at
    `paths`, with their standard `errors` on the fit's scale; `groups` by what is common and the records' names: which
    records belong to it, but never all.
    """
    whitening = _whitening(np.sum([score.information for score in (*scores, prior)], axis=0))
    whitened = [score.along(whitening) for score in (*scores, prior)]
    out = []
    for (what, names), inside in groups.items():
        sigmas, shift = _group_score(whitened, np.append(inside, False), whitening)
        shifts = {path: float(number) for path, number in zip(paths, shift / errors, strict=True)}
        out.append(Agreement(names, what, sigmas, shifts))
    return tuple(out)


def _whitening(everything: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p k"]:
    """Directions of the parameters in which all records together have information 1, without undetermined ones."""
    scale = np.sqrt(np.maximum(np.diag(everything), 1e-300))
    values, vectors = np.linalg.eigh(everything / np.outer(scale, scale))
    kept = values > _LEAST * max(values[-1], 1e-300)
    return vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None]


def _group_score(
    scores: Sequence[Score], inside: Bool[np.ndarray, " records"], whitening: Float[np.ndarray, "p k"]
) -> tuple[float, Float[np.ndarray, " p"]]:
    """A group's score as a normal deviate, and the shift of each parameter without the group; NaN if undetermined."""
    fraction = np.sum([s.information for s, is_in in zip(scores, inside, strict=True) if is_in], axis=0)
    # The scores of a fit that ended a little beside its optimum do not add up to zero: their sum is distributed.
    total = np.sum([s.gradient for s in scores], axis=0)
    score = np.sum([s.gradient for s, is_in in zip(scores, inside, strict=True) if is_in], axis=0) - fraction @ total
    size = whitening.shape[1]
    variance = np.zeros((size, size))
    for each, is_in in zip(scores, inside, strict=True):
        part = is_in * np.eye(size) - fraction
        variance += part @ each.variance @ part.T
    values, vectors = np.linalg.eigh(np.eye(size) - fraction)
    known = values > _LEAST
    shift = whitening @ (vectors[:, known] / values[known] @ (vectors[:, known].T @ score))
    # The part of a parameter along undetermined directions may be a thousandth of its standard error.
    unknown = np.abs(whitening @ vectors[:, ~known]) > 1e-3 * np.linalg.norm(whitening, axis=1)[:, None]
    return _sigmas(score, variance), np.where(np.any(unknown, axis=1), np.nan, shift)


def _sigmas(score: Float[np.ndarray, " k"], variance: Float[np.ndarray, "k k"]) -> float:
    """How unlikely so large a score is, as a normal deviate (E. B. Wilson and M. M. Hilferty, PNAS 17(12), 1931).

    Scores are in units of the information of all records.  Directions are left out of which the group has a millionth
    of the information, or all but a millionth.
    """
    values, vectors = np.linalg.eigh(variance)
    kept = values > 1e-6
    freedom = int(np.sum(kept))
    if not freedom:
        return 0.0
    statistic = float(np.sum((vectors[:, kept].T @ score) ** 2 / values[kept]))
    spread = 2.0 / (9.0 * freedom)
    return float(((statistic / freedom) ** (1.0 / 3.0) - (1.0 - spread)) / np.sqrt(spread))


TAKES_PART = 0.15
"""Exponent, against the largest, below which a parameter is left out of a product."""

HALVED = 0.5
"""Share of its error below which a parameter has gained from what is known of another."""


def combinations(relative: Float[np.ndarray, "p p"], paths: tuple[str, ...]) -> tuple[Combination, ...]:
    """The principal combinations of a covariance of relative changes, the worst determined first.

    **Arguments:** parameters without information have NaN rows and columns, and are left out.
    """
    known = np.flatnonzero(np.isfinite(np.diag(relative)))
    if not known.size:
        return ()
    values, vectors = np.linalg.eigh(relative[np.ix_(known, known)])
    found = []
    for value, vector in zip(values[::-1], vectors.T[::-1], strict=True):
        exponents = vector / vector[np.argmax(np.abs(vector))]
        parts = {paths[i]: float(e) for i, e in zip(known, exponents, strict=True) if abs(e) >= TAKES_PART}
        ranked = dict(sorted(parts.items(), key=lambda part: -abs(part[1])))
        # The error is that of the product without the parameters left out.
        powers = np.array([ranked.get(paths[i], 0.0) for i in known])
        spread = powers @ relative[np.ix_(known, known)] @ powers
        found.append(Combination(ranked, float(np.sqrt(max(spread, value, 0.0)))))
    return tuple(found)


def best_remedy(relative: Float[np.ndarray, "p p"], paths: tuple[str, ...]) -> Remedy | None:
    """The one parameter of which knowledge from elsewhere would lower the errors of others most.

    If p_j were known exactly, the variance of p_i would fall by C_ij^2 / C_jj.

    **Returns:** None where no parameter with an error of more than 5 % would lose half of that.
    """
    known = np.flatnonzero(np.isfinite(np.diag(relative)) & (np.diag(relative) > 0.0))
    matrix = relative[np.ix_(known, known)]
    errors = np.sqrt(np.diag(matrix))
    best, gained = None, 0.0
    for j in range(known.size):
        left = np.sqrt(np.maximum(errors**2 - matrix[:, j] ** 2 / matrix[j, j], 0.0))
        gains = [i for i in range(known.size) if i != j and errors[i] > 0.05 and left[i] < HALVED * errors[i]]
        gain = sum(float(np.log(errors[i] / max(left[i], 1e-3 * errors[i]))) for i in gains)
        if gain > gained:
            gained = gain
            best = Remedy(paths[known[j]], {paths[known[i]]: (float(errors[i]), float(left[i])) for i in gains})
    return best


def diagnose(problem: Problem, fit: Fit, covariance: Float[np.ndarray, "p p"]) -> Diagnosis:
    """Combinations that the data determine, what would help, and records that disagree.

    **Arguments:** the `covariance` on the fit's scale, NaN where a parameter has no information or is held.
    """
    transform = problem.residual.transform
    found = problem.decode(fit.free)
    values = np.array([abs(float(found[path])) for path in transform.paths])
    relative = np.where(values > 0.0, np.abs(transform.slope(fit.free)) / np.where(values > 0.0, values, 1.0), np.nan)
    changes = transform.own_covariance(covariance) * np.outer(relative, relative)
    parts = records_agreement(problem, fit, covariance)
    return Diagnosis(combinations(changes, transform.paths), best_remedy(changes, transform.paths), parts)


def records_agreement(problem: Problem, fit: Fit, covariance: Float[np.ndarray, "p p"]) -> tuple[Agreement, ...]:
    """How far records, and groups of them, disagree with the others at the joint optimum next to the `fit`.

    **Arguments:** as of `diagnose`.
    """
    known = np.flatnonzero(np.isfinite(np.diag(covariance)))
    groups = record_groups(problem.records)
    if not (groups and known.size):
        return ()
    residual, jacobian = np.asarray(fit.state.residual), np.asarray(fit.state.jacobian)[:, known]
    scores = [score_of(residual[rows], jacobian[rows]) for rows in problem.rows]
    prior = prior_score(residual[problem.rows_apart], jacobian[problem.rows_apart])
    errors = np.sqrt(np.diag(covariance))[known]
    return agreement(scores, prior, groups, errors, [problem.residual.transform.paths[i] for i in known])


def contradicting(found: Sequence[Agreement]) -> list[Agreement]:
    """The groups of records that ask for other parameters than the rest, beyond chance and by two standard errors."""
    return [group for group in found if group.sigmas > SIGNIFICANT and abs(group.largest()[1]) > _NOTICEABLE]


def record_groups(records: Sequence[Record]) -> dict[tuple[str, tuple[str, ...]], Bool[np.ndarray, " records"]]:
    """Every record by itself, and those that have their direction or kind in common; by what, and their names."""
    count = len(records)
    gathered = {("record", str(i)): [i] for i in range(count)}
    for i, record in enumerate(records):
        gathered.setdefault(("kind", record.measures), []).append(i)
        if record.drive is not None and (flanks := record.drive.flanks()) is not None:
            direction = "forward" if float(flanks.slope) > 0.0 else "backward"  # of the slow flank
            gathered.setdefault(("direction", direction), []).append(i)
    groups = {}
    for (what, _), members in gathered.items():
        if len(members) < count and (what == "record" or len(members) > 1):
            names = tuple(records[i].name for i in members)
            groups[what, names] = np.isin(np.arange(count), members)
    return groups
