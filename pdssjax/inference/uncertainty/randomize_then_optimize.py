"""Independent draws from a density of least squares: randomize the residuals, then solve for the parameters.

    u ~ N(0, v I),    Q' r(x) = u    gives x with the density    q(x) ~ |det Q' J(x)| exp(-|Q' r(x)|^2 / (2 v))

Q is an orthonormal basis of the columns of the Jacobian J at the optimum (J. M. Bardsley, A. Solonen, H. Haario and
M. Laine, SIAM J. Scientific Computing 36(4), 2014).  A valley that is narrow and bent in the parameters is neither in
the coordinates Q' r: what is left is the intrinsic curvature of the residuals, which is mostly small beside that from
the choice of parameters (D. M. Bates and D. G. Watts, J. Royal Statistical Society B 42(1), 1980).

The equation is solved by Newton's method along the straight way from the optimum to u.  Where the determinant changes
its sign on the way the residuals fold over, and beyond there is no solution that belongs to the optimum: such a u is
replaced by another, which leaves q as it is where there is one.  What lies beyond a fold, or far outside of what the
polynomial knows, comes from the linear model's normal distribution, widened: draws are of a mixture of both, so that
weights over q stay bounded (T. Hesterberg, Technometrics 37(2), 1995).
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from ...core import InputError, Scalar, ScalarLike
from .residual_polynomial import ResidualPolynomial

_WAY = 32
"""Points on the way from the optimum to u."""

_NEWTON, _LAST = 2, 4
"""Iterations of Newton's method at each, and further ones at the end."""

_SOLVED = 1e-8
"""What may be left of the equation, beside 1 + |u|."""

_SAME = 1e-6
"""Distance of a solution, beside 1 + |w|, at which it is the point that u was taken from."""

_SIDE_BY_SIDE = 128
"""Equations solved at a time."""

_TRIALS = 50
"""Of these, after which too few have a solution between the bounds."""


class Widths(NamedTuple):
    """Of a mixture: by how much variances exceed those of the residuals."""

    solved: tuple[float, ...]
    """Of randomized residuals, as many draws of each."""
    linear: float
    """Of the linear model's normal distribution."""
    share: float
    """Of the draws that come from the linear model."""


class Proposals(NamedTuple):
    """Draws from q, and how probable each is there and by the polynomial."""

    free: Float[np.ndarray, "draws p"]
    """On the scale of the fit."""
    log_proposed: Float[np.ndarray, " draws"]
    """log q, but for a constant."""
    log_learned: Float[np.ndarray, " draws"]
    """The same of the density that the polynomial stands for."""


class _Solution(NamedTuple):
    x: Float[Array | np.ndarray, "*n p"]
    log_proposed: Float[Array | np.ndarray, "*n"]
    log_learned: Float[Array | np.ndarray, "*n"]
    solved: Bool[Array | np.ndarray, "*n"]


def propose(
    polynomial: ResidualPolynomial,
    axes: Float[np.ndarray, "p q"],
    variance: float,
    widths: Widths,
    bounds: tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]],
    count: int,
    seed: tuple[int, ...],
) -> Proposals:
    """`count` independent draws of parameters between the `bounds`.

    **Arguments:** the `polynomial` that stands for the residuals around its centre; the `axes` along which parameters
    move; the `variance` of each residual, and the `widths` of what to draw.

    **Raises:** `InputError` where nearly no randomized residual has a solution between the bounds.
    """
    random, (low, high) = np.random.default_rng(seed), bounds
    found: list[_Solution] = []
    have = tried = 0
    for _ in range(_TRIALS):
        normal = random.standard_normal((_SIDE_BY_SIDE, axes.shape[1]))
        wide, linear = random.choice(widths.solved, _SIDE_BY_SIDE), random.random(_SIDE_BY_SIDE) < widths.share
        targets = np.where(linear, np.sqrt(widths.linear), np.sqrt(variance * wide))[:, None] * normal
        some = _proposals(polynomial, axes, jnp.asarray(variance), jax.tree.map(np.asarray, widths), targets, linear)
        some = jax.tree.map(np.asarray, some)
        good = some.solved & np.all((some.x >= low) & (some.x <= high), axis=1)
        found.append(jax.tree.map(lambda values, good=good: values[good], some))
        have, tried = have + int(np.sum(good)), tried + _SIDE_BY_SIDE
        if have >= count:
            whole = _Solution(*(np.concatenate(parts)[:count] for parts in zip(*found, strict=True)))
            return Proposals(np.asarray(whole.x), np.asarray(whole.log_proposed), np.asarray(whole.log_learned))
    raise InputError(
        f"posterior: found parameters between the bounds for {have} of {tried} randomized residuals, expected "
        f"{count}; the records say too little about them, or the optimum lies at bounds. Fix some, or give bounds."
    )


@eqx.filter_jit
def _proposals(
    polynomial: ResidualPolynomial,
    axes: Float[Array | np.ndarray, "p q"],
    variance: ScalarLike,
    widths: Widths,
    targets: Float[Array | np.ndarray, "n q"],
    linear: Bool[Array | np.ndarray, " n"],
) -> _Solution:
    """Draws for several `targets`: u, or w for those that are `linear`; x = x0 + A w."""
    place = lambda w: jnp.asarray(polynomial.centre) + axes @ w
    solve, along, _ = randomized_equation(polynomial, axes)
    log_normal = lambda u, variances: -0.5 * jnp.sum(u**2) / variances - 0.5 * u.size * jnp.log(variances)
    shares = jnp.log(1.0 - widths.share) - jnp.log(len(widths.solved)), jnp.log(widths.share)

    def drawn(target: Float[Array, " q"], linear: Bool[Array, ""]) -> _Solution:
        goal = jnp.where(linear, along(target), target)
        w, volume, solved = solve(goal)
        # A draw of the linear model might have come from the solver too, where that ends there.
        solved &= ~linear | (jnp.linalg.norm(w - target) < _SAME * (1.0 + jnp.linalg.norm(target)))
        w = jnp.where(linear, target, w)
        by_solver = [shares[0] + volume + log_normal(goal, variance * width) for width in widths.solved]
        by_solver = [jnp.where(solved, height, -jnp.inf) for height in by_solver]
        proposed = jax.nn.logsumexp(jnp.stack([*by_solver, shares[1] + log_normal(w, widths.linear)]))
        learned = -0.5 * jnp.sum(polynomial(place(w)) ** 2) / variance
        return _Solution(place(w), proposed, learned, solved | linear)

    return jax.vmap(drawn)(jnp.asarray(targets), jnp.asarray(linear))


class Equation(NamedTuple):
    """Q' r(x0 + A w) = u."""

    solve: Callable[..., Any]
    """From u to w, with log |det Q' J| there and whether there is a solution."""
    along: Callable[..., Any]
    """Q' r at w."""
    slopes: Callable[..., Any]
    """Its derivatives, shape (q, q)."""


def randomized_equation(polynomial: ResidualPolynomial, axes: Float[Array | np.ndarray, "p q"]) -> Equation:
    """The equation of a `polynomial` along the `axes` of what moves."""
    place = lambda w: jnp.asarray(polynomial.centre) + axes @ w
    origin = jnp.zeros(axes.shape[1])
    basis, _ = jnp.linalg.qr(jax.jacfwd(lambda w: polynomial(place(w)))(origin))
    projection = eqx.tree_at(lambda p: p.factor, polynomial, basis.T @ jnp.asarray(polynomial.factor))
    along = lambda w: projection(place(w))
    slopes = jax.jacfwd(along)

    def improved(w: Float[Array, " q"], u: Float[Array, " q"], times: int) -> Float[Array, " q"]:
        return lax.fori_loop(0, times, lambda _, w: w - jnp.linalg.solve(slopes(w), along(w) - u), w)

    def solve(u: Float[Array, " q"]) -> tuple[Float[Array, " q"], Scalar, Bool[Array, ""]]:
        begin = along(origin)

        def go_on(w: Float[Array, " q"], share: Scalar) -> tuple[Float[Array, " q"], Scalar]:
            w = improved(w, begin + share * (u - begin), _NEWTON)
            return w, jnp.linalg.slogdet(slopes(w))[0]

        w, signs = lax.scan(go_on, origin, jnp.arange(1, _WAY + 1) / _WAY)
        w = improved(w, u, _LAST)
        sign, volume = jnp.linalg.slogdet(slopes(w))
        left = jnp.linalg.norm(along(w) - u)
        return w, volume, (left < _SOLVED * (1.0 + jnp.linalg.norm(u))) & jnp.all(signs == sign)

    return Equation(solve, along, slopes)
