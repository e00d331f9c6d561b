"""Polynomials that stand for residuals over the whole of a posterior, learned from linearisations.

    r(x0 + A w) ~ C t(z),    w = S z,    t = (1, z_i, z_i z_j, z_i z_j z_k, ...)

S makes the points that it is learned from as wide in every direction.  The coefficients C are least squares of values
and first derivatives at once (Hermite data), so that one linearisation tells 1 + q of the numbers of each sample.
Sums of squares need no samples: the triangular factor of C gives the same (`factor`).
"""

import functools
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .second_order import Curvature, Linearisation

MOST_TERMS = 1000
"""A polynomial with more is of a lower order."""

_FAR = 400.0
"""Excess of chi-square from which a point tells nothing of a posterior."""

_SLOPES = 0.5
"""Weight of a derivative beside a value."""


class ResidualPolynomial(eqx.Module):
    """Residuals of a fit, turned so that few numbers have their sum of squares."""

    centre: Float[np.ndarray, " p"]
    inverse: Float[np.ndarray, "q p"]
    """The map from x - x0 to z."""
    factor: Float[np.ndarray, "m k"]
    """Times the terms, it gives m numbers with the residuals' sum of squares."""
    degree: int = eqx.field(static=True)

    def __call__(self, x: Float[Array, " p"]) -> Float[Array, " m"]:
        """The turned residuals at numbers of the fit."""
        return jnp.asarray(self.factor) @ terms(jnp.asarray(self.inverse) @ (x - self.centre), self.degree)


def count_terms(directions: int, degree: int) -> int:
    """The number of terms of a polynomial."""
    return sum(len(_products(directions, order)) for order in range(degree + 1))


def degree_for(directions: int, most: int = 3) -> int:
    """The order that so many directions allow: `most`, or less where that has too many terms, but not below 2."""
    return most if most == 2 or count_terms(directions, most) <= MOST_TERMS else degree_for(directions, most - 1)


def terms(z: Float[Array, " q"], degree: int) -> Float[Array, " k"]:
    """All products of up to `degree` coordinates, those of fewer first."""
    found = [jnp.ones(1), z]
    for order in range(2, degree + 1):
        products = _products(z.size, order)
        shorter = {tuple(product): number for number, product in enumerate(_products(z.size, order - 1).tolist())}
        others = np.array([shorter[tuple(product)] for product in products[:, 1:].tolist()], int)
        found.append(z[products[:, 0]] * found[-1][others])
    return jnp.concatenate(found)


def of_second_order(optimum: Linearisation, curvature: Curvature, axes: Float[np.ndarray, "p q"]) -> ResidualPolynomial:
    """The polynomial that a `curvature` at an optimum stands for, along the `axes` of what moves."""
    bends = np.linalg.solve(curvature.scale, axes)
    second = np.einsum("nij,ia,jb->nab", curvature.second, bends, bends, optimize=True)
    pairs = _products(axes.shape[1], 2)
    halves = np.where(pairs[:, 0] == pairs[:, 1], 0.5, 1.0)
    columns = [optimum.residual[:, None], optimum.jacobian @ axes, halves * second[:, pairs[:, 0], pairs[:, 1]]]
    return ResidualPolynomial(optimum.at, np.linalg.pinv(axes), _triangle(np.concatenate(columns, axis=1)), 2)


class SampledPolynomial(NamedTuple):
    """A residual polynomial with every sample kept, so that its second derivatives go with any residuals."""

    centre: Float[np.ndarray, " p"]
    inverse: Float[np.ndarray, "q p"]
    """The map from x - x0 to z."""
    coefficients: Float[np.ndarray, "n k"]
    degree: int

    def turned(self) -> ResidualPolynomial:
        """The polynomial whose sum of squares is this one's."""
        return ResidualPolynomial(self.centre, self.inverse, _triangle(self.coefficients), self.degree)

    def curvature(self, at: Float[np.ndarray, " p"], scale: Float[np.ndarray, "p p"]) -> Curvature:
        """Second derivatives `at` a point, in coordinates w of x = `scale` w."""
        bends = np.asarray(_bends(jnp.asarray(self.inverse @ (at - self.centre)), self.degree))
        along = self.inverse @ scale
        bends = along.T @ bends @ along
        return Curvature((self.coefficients @ bends.reshape(bends.shape[0], -1)).reshape(-1, *bends.shape[1:]), scale)


@functools.partial(jax.jit, static_argnums=1)
def _bends(z: Float[Array, " q"], degree: int) -> Float[Array, "k q q"]:
    return jax.hessian(lambda z: terms(z, degree))(z)


@functools.partial(jax.jit, static_argnums=1)
def _hermite_row(z: Float[Array, " q"], degree: int) -> Float[Array, "1+q k"]:
    """The terms and their derivatives, the latter with their weight."""
    slopes = jax.jacfwd(lambda z: terms(z, degree))(z)
    return jnp.concatenate([terms(z, degree)[None], _SLOPES * slopes.T])


def learned_polynomial(
    optimum: Linearisation,
    points: Sequence[Linearisation],
    axes: Float[np.ndarray, "p q"],
    factor: float,
    most: int = 3,
) -> SampledPolynomial:
    """The polynomial that explains residuals and Jacobians at an `optimum` and at `points` best.

    **Arguments:** `axes` of what moves, as many standard deviations long as is the linear model's; the `factor` by
    which variances exceed those of the noise given; the `most` that the order may be, above the third only where
    points determine it.  Points that cannot be simulated, or lie far above the optimum, take no part, as long as
    enough others are there.
    """
    from scipy.linalg import solve_triangular  # an eighth of a second that most runs do not need

    moving = axes.shape[1]
    ordered = sorted([optimum, *(p for p in points if np.isfinite(p.chi2))], key=lambda point: point.chi2)
    excess = np.array([(point.chi2 - optimum.chi2) / factor for point in ordered])
    count = max(int(np.sum(excess < _FAR)), min(count_points(moving), len(ordered)))
    used, excess = ordered[:count], excess[:count]
    determined = [degree for degree in range(4, most + 1) if count_points(moving, degree) <= len(used)]
    degree = degree_for(moving, max([3, *determined]))
    inverse = np.linalg.pinv(axes)
    offsets = np.stack([point.at - optimum.at for point in used]) @ inverse.T
    widths = np.linalg.cholesky(offsets.T @ offsets / len(used) + 1e-6 * np.eye(moving))
    z = np.linalg.solve(widths, offsets.T).T
    # A point this far above what is usual counts half as much.
    weights = 1.0 / np.sqrt(1.0 + np.maximum(excess - moving, 0.0) / 20.0)
    rows = np.stack([np.asarray(_hermite_row(jnp.asarray(each), degree)) for each in z]) * weights[:, None, None]
    # Draws what no point tells of bends to zero.
    ridge = np.sqrt(len(used)) * np.where(np.arange(rows.shape[2]) > moving, 1e-3, 1e-9)
    matrix = np.concatenate([rows.reshape(-1, ridge.size), np.diag(ridge)])
    basis, triangle = np.linalg.qr(matrix)
    solve = solve_triangular(triangle, basis[: -ridge.size].T).reshape(ridge.size, len(used), 1 + moving)
    coefficients = np.zeros((optimum.residual.size, ridge.size))
    for number, point in enumerate(used):  # one at a time: all Jacobians side by side are many
        data = np.concatenate([point.residual[:, None], _SLOPES * (point.jacobian @ (axes @ widths))], axis=1)
        coefficients += weights[number] * data @ solve[:, number].T
    return SampledPolynomial(optimum.at, np.linalg.solve(widths, inverse), coefficients, degree)


def count_points(directions: int, degree: int | None = None) -> int:
    """The number of linearisations that determine a polynomial of a `degree`; None: what its directions allow."""
    return count_terms(directions, degree or degree_for(directions)) // (1 + directions) + 1


def _products(directions: int, order: int) -> Int[np.ndarray, "terms order"]:
    """The coordinates in each product of `order` of them."""
    found = list(itertools.combinations_with_replacement(range(directions), order))
    return np.array(found, int).reshape(len(found), order)


def _triangle(columns: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "m k"]:
    return np.asarray(np.linalg.qr(columns, mode="r"))
