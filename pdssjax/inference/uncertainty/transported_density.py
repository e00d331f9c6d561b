"""A posterior's density in coordinates in which it is nearly a standard normal distribution.

    Q' r^(x0 + A w) = sqrt(v) e,        density of e:    p(x) exp(-|r(x)|^2 / (2 v)) |det dx/de|

r^ is the polynomial that stands for the residuals, r the model, p the prior, Q as in `randomize_then_optimize`:
whatever the polynomial is, the density is the model's (M. D. Parno and Y. M. Marzouk, SIAM/ASA J. Uncertainty
Quantification 6(2), 2018, for a map in front of a sampler).  Where the polynomial folds over there is no e.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ...core import Scalar
from .at_bounds import AtBounds
from .posterior_model import Model
from .profile_likelihood import Evaluate
from .randomize_then_optimize import Equation, randomized_equation
from .residual_polynomial import ResidualPolynomial


class Place(NamedTuple):
    """A point of the posterior, in both kinds of coordinates."""

    w: Float[Array, " q"]
    volume: Scalar
    """log |det du/dw| of the polynomial."""
    pull: Float[Array, " q"]
    """Its derivatives by w."""
    slopes: Float[Array, "q q"]
    """du/dw."""
    solved: Bool[Array, ""]


class TransportMap(eqx.Module):
    """From e to w, and back."""

    polynomial: ResidualPolynomial
    axes: Float[np.ndarray, "p q"]
    held: AtBounds
    variance: float

    def equation(self) -> Equation:
        """That whose u is sqrt(v) e."""
        return randomized_equation(self.polynomial, self.axes, self.held, self.variance)

    def at(self, w: Float[Array | np.ndarray, " q"]) -> Float[Array, " p"]:
        """x0 + A w."""
        return jnp.asarray(self.polynomial.centre) + self.axes @ jnp.asarray(w)

    @eqx.filter_jit
    def place(self, e: Float[Array, " q"]) -> Place:
        equation = self.equation()
        w, volume, solved = equation.solve(jnp.sqrt(self.variance) * e)
        pull = jax.grad(lambda w: jnp.linalg.slogdet(equation.slopes(w))[1])(w)
        return Place(w, volume, pull, equation.slopes(w), solved)

    @eqx.filter_jit
    def back(self, w: Float[Array | np.ndarray, " q"]) -> tuple[Float[Array, " q"], Bool[Array, ""]]:
        """The e of a point, and whether it leads there again: not so beyond a fold."""
        u, _, solved = self.equation().back(jnp.asarray(w))
        return u / jnp.sqrt(self.variance), solved


class TransportedDensity(eqx.Module):
    """The posterior's density of e."""

    map: TransportMap
    evaluate: Evaluate
    slopes: Float[np.ndarray, " p"]
    """Of the logarithm of the prior."""
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]

    def potential(self, e: Float[Array, " q"]) -> tuple[Scalar, Float[Array, " q"]]:
        """-log density but for a constant, and its derivatives; infinite where there is nothing."""
        place, variance = self.map.place(e), self.map.variance
        x = self.map.at(place.w)
        residual, jacobian = self.evaluate(x)
        value = 0.5 * jnp.sum(residual**2) / variance + place.volume - self.slopes @ (x - self.map.polynomial.centre)
        by_w = self.map.axes.T @ (jacobian.T @ residual / variance - self.slopes) + place.pull
        slope = jnp.sqrt(variance) * jnp.linalg.solve(place.slopes.T, by_w)
        there = place.solved & jnp.all((x >= self.low) & (x <= self.high)) & jnp.isfinite(value)
        there &= jnp.all(jnp.isfinite(slope))
        return jnp.where(there, value, jnp.inf), jnp.where(there, slope, 0.0)


def transported(model: Model, polynomial: ResidualPolynomial) -> TransportedDensity:
    """The posterior of a `model` by the map that a `polynomial` makes."""
    by_polynomial = TransportMap(polynomial, model.axes, model.held, model.factor)
    return TransportedDensity(by_polynomial, model.evaluate, model.prior_slopes, *model.bounds)
