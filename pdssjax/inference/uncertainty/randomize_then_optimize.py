"""Independent draws from a density of least squares: randomize the residuals, then solve for the parameters.

    u ~ N(0, v I),    Q' r(x) = u    gives x with the density    q(x) ~ |det Q' J(x)| exp(-|Q' r(x)|^2 / (2 v))

Q is an orthonormal basis of the columns of the Jacobian J at the optimum (J. M. Bardsley, A. Solonen, H. Haario and M.
Laine, SIAM J. Scientific Computing 36(4), 2014).  A valley that is narrow and bent in the parameters is neither in the
coordinates Q' r: what is left is the intrinsic curvature of the residuals, which is mostly small beside that from the
choice of parameters (D. M. Bates and D. G. Watts, J. Royal Statistical Society B 42(1), 1980).

The equation is solved by Newton's method along the straight way from the optimum to u.  Where the determinant changes
its sign on the way the residuals fold over, and beyond there is no solution that belongs to the optimum: such a u is
replaced by another, which leaves q as it is where there is one.  What lies there, and what no polynomial knows, is
reached by the linear model's normal distribution, widened: draws are of a mixture of both, so that weights over q stay
bounded (T. Hesterberg, Technometrics 37(2), 1995).

A parameter with its optimum at a bound has a row of its own in the equation, which keeps it inside (`at_bounds`); Q is
then of the directions in which it does not move.
"""

import threading
from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ...core import InputError, Scalar
from ..parameter_transform import Box
from .at_bounds import AtBounds
from .residual_polynomial import ResidualPolynomial

_HOMOTOPY_POINTS = 32
"""Points on the straight line from the optimum to u."""

_NEWTON_STEPS, _LAST_NEWTON_STEPS = 2, 4
"""Iterations of Newton's method at each, and further ones at the end."""

_TOLERANCE = 1e-8
"""Tolerance of the equation, relative to 1 + |u|."""

_RETURN_TOLERANCE = 1e-6
"""Distance from a solution to the point that u came from, relative to 1 + |w|, up to which they are one point."""

_XLA_LOCK = threading.Lock()
"""Two threads that solve hundreds of equations each were seen to wait for each other within XLA for ever."""

_BATCH = 128
"""Equations solved at a time."""

_TRIALS = 50
"""Trials after which too few have a solution between the bounds."""


class NothingToDraw(InputError):
    """Hardly any draw lies between the bounds."""


class Widths(NamedTuple):
    """Widths of a mixture: ratios of its variances to those of the residuals."""

    solved: tuple[float, ...]
    """Widths for randomized residuals, as many draws of each."""
    linear: float
    """Width of the linear model's normal distribution."""
    share: float
    """Fraction of the draws that come from the linear model."""


class Proposals(NamedTuple):
    """Draws from q, and how probable each is there and by the polynomial."""

    free: Float[np.ndarray, "*draws p"]
    """Parameters on the scale of the fit."""
    randomized: Float[np.ndarray, "*draws q"]
    """The polynomial's Q' r there."""
    log_proposed: Float[np.ndarray, "*draws"]
    """log q, but for a constant."""
    log_learned: Float[np.ndarray, "*draws"]
    """Logarithm of the density that the polynomial stands for, but for a constant."""
    solved: Bool[np.ndarray, "*draws"]
    """Whether the equation has a solution."""


class RandomizedResiduals(eqx.Module):
    """The randomized residuals of a polynomial, along axes from its centre."""

    polynomial: ResidualPolynomial
    """Stands for the residuals around its centre."""
    axes: Float[np.ndarray, "p q"]
    """Axes along which parameters move: x = x0 + A w."""
    held: AtBounds
    """Parameters with their optimum at a bound."""
    variance: Float[np.ndarray, ""] | float
    """Variance of each residual."""

    def equation(self) -> "Equation":
        """The equation of the polynomial's randomized residuals along the axes.

        Its first rows are those of the parameters `held` at bounds, sqrt(v) e of each.
        """
        polynomial, held, axes = self.polynomial, self.held, self.axes
        count, deviation, middle = held.rates.size, jnp.sqrt(jnp.asarray(self.variance)), held.middle()
        slopes_at_optimum = jax.jacfwd(lambda w: polynomial(self.at(w)))(jnp.zeros(axes.shape[1]))
        basis = tangents(slopes_at_optimum @ held.free_directions())
        projection = eqx.tree_at(lambda p: p.factor, polynomial, basis.T @ jnp.asarray(polynomial.factor))
        # Solved with rho s in place of e, which is minus infinity at the bound.
        level = lambda w: jnp.concatenate([deviation * held.scaled(w), projection(self.at(w))])
        along = lambda w: jnp.concatenate([deviation * held.normal_of(held.scaled(w)), projection(self.at(w))])
        slopes = jax.jacfwd(level)

        def improved(w: Float[Array, " q"], target: Float[Array, " q"], times: int) -> Float[Array, " q"]:
            return lax.fori_loop(0, times, lambda _, w: w - jnp.linalg.solve(slopes(w), level(w) - target), w)

        def solve(u: Float[Array, " q"]) -> tuple[Float[Array, " q"], Scalar, Bool[Array, ""]]:
            e = u[:count] / deviation
            begin, target = level(middle), jnp.concatenate([deviation * held.scaled_of(e), u[count:]])

            def go_on(w: Float[Array, " q"], share: Scalar) -> tuple[Float[Array, " q"], Scalar]:
                w = improved(w, begin + share * (target - begin), _NEWTON_STEPS)
                return w, jnp.linalg.slogdet(slopes(w))[0]

            w, signs = lax.scan(go_on, middle, jnp.arange(1, _HOMOTOPY_POINTS + 1) / _HOMOTOPY_POINTS)
            w = improved(w, target, _LAST_NEWTON_STEPS)
            sign, volume = jnp.linalg.slogdet(slopes(w))
            left = jnp.linalg.norm(level(w) - target)
            solved = (left < _TOLERANCE * (1.0 + jnp.linalg.norm(target))) & jnp.all(signs == sign)
            return w, volume + jnp.sum(held.log_slope(e)), solved

        return Equation(solve, along, jax.jacfwd(along))

    def at(self, w: Float[Array | np.ndarray, " q"]) -> Float[Array, " p"]:
        """x0 + A w."""
        return jnp.asarray(self.polynomial.centre) + self.axes @ jnp.asarray(w)


class Mixture(RandomizedResiduals):
    """A mixture of distributions to draw from; with other numbers nothing is compiled anew."""

    widths: Widths


def propose(mixture: Mixture, bounds: Box, count: int, random: np.random.Generator) -> Proposals:
    """`count` independent draws of parameters between the `bounds`.

    **Raises:** `NothingToDraw` where nearly no randomized residual has a solution between the bounds.
    """
    (low, high), widths = bounds, mixture.widths
    directions = mixture.axes.shape[1]
    found: list[Proposals] = []
    accepted = tried = 0
    for _ in range(_TRIALS):
        normal = random.standard_normal((_BATCH, directions))
        wide, linear = random.choice(widths.solved, _BATCH), random.random(_BATCH) < widths.share
        targets = np.where(linear, np.sqrt(widths.linear), np.sqrt(mixture.variance * wide))[:, None] * normal
        with _XLA_LOCK:
            some = _proposals(mixture, targets, linear)
            some = jax.tree.map(np.asarray, some)
        good = some.solved & np.all((some.free >= low) & (some.free <= high), axis=1)
        found.append(jax.tree.map(lambda values, good=good: values[good], some))
        accepted, tried = accepted + int(np.sum(good)), tried + _BATCH
        if accepted >= count:
            return Proposals(*(np.concatenate(parts)[:count] for parts in zip(*found, strict=True)))
    raise NothingToDraw(
        f"posterior: found parameters between the bounds for {accepted} of {tried} randomized residuals, expected "
        f"{count}; the records say too little about them, or the optimum lies at bounds. Fix some, or give bounds."
    )


@eqx.filter_jit
def _proposals(
    mixture: Mixture, targets: Float[Array | np.ndarray, "n q"], linear: Bool[Array | np.ndarray, " n"]
) -> Proposals:
    """Draws for several `targets`: u, or w for those that are `linear`."""
    equation = mixture.equation()

    def proposal(target: Float[Array, " q"], linear: Bool[Array, ""]) -> Proposals:
        w, _, solved = equation.solve(target)
        w = jnp.where(linear, target, w)
        proposed, x = log_proposed(mixture, w), mixture.at(w)
        learned = -0.5 * jnp.sum(mixture.polynomial(x) ** 2) / mixture.variance
        drawn = x, equation.along(w), proposed, learned, (solved | linear) & jnp.isfinite(proposed)
        return Proposals(*drawn)  # pyright: ignore[reportArgumentType]

    return jax.vmap(proposal)(jnp.asarray(targets), jnp.asarray(linear))


@eqx.filter_jit
def log_proposed(mixture: Mixture, w: Float[Array | np.ndarray, " q"]) -> Scalar:
    """log q at a point along the axes, but for a constant."""
    widths, variance, at = mixture.widths, mixture.variance, jnp.asarray(w)
    log_normal = lambda u, variances: -0.5 * jnp.sum(u**2) / variances - 0.5 * u.size * jnp.log(variances)
    log_solved, log_linear = jnp.log((1.0 - widths.share) / len(widths.solved)), jnp.log(widths.share)
    # A point may have been drawn only where the way to its u ends there.
    u, volume, solved = mixture.equation().back(at)
    found = [log_solved + volume + log_normal(u, variance * width) for width in widths.solved]
    by_solver = jnp.where(solved, jnp.stack(found), -jnp.inf)
    return jax.nn.logsumexp(jnp.append(by_solver, log_linear + log_normal(at, widths.linear)))


def tangents(slopes: Float[Array | np.ndarray, "m q"]) -> Float[Array, "m q"]:
    """Q: the columns of `slopes` made orthonormal, one after the other."""
    if not slopes.shape[1]:
        return jnp.asarray(slopes)
    basis, triangle = jnp.linalg.qr(jnp.asarray(slopes))
    # Of a polynomial as of the model that it stands for: without the signs that a library chooses.
    return basis * jnp.sign(jnp.diag(triangle))


class Equation(NamedTuple):
    """Q' r(x0 + A w) = u, with a row of its own for each parameter at a bound."""

    solve: Callable[[Float[Array, " q"]], tuple[Float[Array, " q"], Scalar, Bool[Array, ""]]]
    """A function from u to w, log |det du/dw| there, and whether there is a solution."""
    along: Callable[[Float[Array, " q"]], Float[Array, " q"]]
    """The left side at w."""
    slopes: Callable[[Float[Array, " q"]], Float[Array, "q q"]]
    """The derivatives of the equation, shape (q, q)."""

    def back(self, w: Float[Array, " q"]) -> tuple[Float[Array, " q"], Scalar, Bool[Array, ""]]:
        """The u at w, log |det du/dw|, and whether u leads there again: not so beyond a fold."""
        u = self.along(w)
        again, volume, solved = self.solve(u)
        return u, volume, solved & (jnp.linalg.norm(again - w) < _RETURN_TOLERANCE * (1.0 + jnp.linalg.norm(w)))
