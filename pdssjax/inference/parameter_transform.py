"""The transform of free parameters to the numbers of a fit, which are of order one.

On its own scale each parameter is a logarithm or a ratio to a typical size.  The fit has these numbers, except where a
constraint ties a parameter to another (`study.Link`): there it has the distance, on the own scale, from equality.  So
the constraint is a bound at 0, and the numbers on the own scales are a matrix times those of the fit.
"""

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.tree_util import register_dataclass
from jaxtyping import Array, Bool, Float

from ..core import ScalarLike
from ..study import Constraint, Link, Parameter, Values, bounded_by_constraints, chained
from .covariance import set_unknown

Box = tuple[Float[np.ndarray, " p"], Float[np.ndarray, " p"]]
"""Lower and upper bounds of the free numbers, on the fit's scale."""


# Plain pytrees: each access to a method of an `equinox.Module` takes 20 us, and a fit decodes at every point.
@register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Ties:
    """The numbers of the parameters on their own scales as a function of those of the fit: mixing @ free + shift."""

    mixing: Float[np.ndarray, "p p"]
    """Of unit determinant."""
    shift: Float[np.ndarray, " p"]
    links: tuple[Link, ...] = dataclasses.field(metadata={"static": True})
    """The constraints between free parameters."""


@register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class ParameterTransform:
    """Map between the free parameters [SI] and the fit's numbers: of order one, bounded by `low` and `high`.

    A positive quantity is fitted by its logarithm; a signed one, or one that may be zero,
    by its ratio to a typical size.
    """

    paths: tuple[str, ...] = dataclasses.field(metadata={"static": True})
    logarithmic: Bool[np.ndarray, " p"]
    unit: Float[np.ndarray, " p"]
    """Size of one unit of a linear parameter; 1 for a logarithmic one."""
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]
    """Bounds, on the fit's scale."""
    ties: Ties | None = None
    """The constraints between free parameters; None: the fit's numbers are those on the parameters' own scales."""

    def encode(self, values: Values) -> Float[np.ndarray, " p"]:
        """Values in SI to the fit's scale."""
        given = np.array([float(values[path]) for path in self.paths])
        own = np.where(self.logarithmic, np.log(np.where(self.logarithmic, given, 1.0)), given / self.unit)
        return self.from_own(own)

    def decode(self, free: Float[Array | np.ndarray, " p"]) -> dict[str, ScalarLike]:
        """The fit's numbers to values in SI; differentiable."""
        if isinstance(free, Tracer):
            own = free if self.ties is None else jnp.asarray(self.ties.mixing) @ free + self.ties.shift
            number = jnp.where(self.logarithmic, jnp.exp(jnp.where(self.logarithmic, own, 0.0)), own * self.unit)
        else:
            number = self.in_si(self.own(np.asarray(free, float)))
        return {path: number[i] for i, path in enumerate(self.paths)}

    def directions(self, free: Float[np.ndarray, " p"]) -> Float[np.ndarray, "p p"]:
        """The derivatives of each value in SI, a row, by all numbers of the fit."""
        slope = self.slope(free)[:, None]
        return slope * (np.eye(len(self.paths)) if self.ties is None else self.ties.mixing)

    def own(self, free: Float[np.ndarray, "*many p"]) -> Float[np.ndarray, "*many p"]:
        """The fit's numbers as those of each parameter on its own scale."""
        return free if self.ties is None else free @ self.ties.mixing.T + self.ties.shift

    def from_own(self, own: Float[np.ndarray, "*many p"]) -> Float[np.ndarray, "*many p"]:
        """The inverse of `own`."""
        return own if self.ties is None else (own - self.ties.shift) @ np.linalg.inv(self.ties.mixing).T

    def own_effect(self, effect: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n p"]:
        """The effect of each residual on the fit's numbers as that on the parameters' own scales."""
        return effect if self.ties is None else effect @ self.ties.mixing.T

    def own_jacobian(self, jacobian: Float[np.ndarray, "n p"]) -> Float[np.ndarray, "n p"]:
        """The Jacobian of residuals in the parameters' own scales."""
        return jacobian if self.ties is None else jacobian @ np.linalg.inv(self.ties.mixing)

    def tied_to(self, which: Bool[np.ndarray, " p"]) -> Bool[np.ndarray, " p"]:
        """The parameters `which`, and all that constraints tie to them."""
        return which if self.ties is None else (np.abs(self.ties.mixing) @ which) > 0.0

    def own_covariance(self, matrix: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p p"]:
        """A covariance of the fit's numbers as that on the parameters' own scales.

        NaN of parameters without a variance, such as those at a bound, and of those that are tied to one.
        """
        if self.ties is None:
            return matrix
        found = self.ties.mixing @ np.nan_to_num(matrix) @ self.ties.mixing.T
        set_unknown(found, self.tied_to(np.isnan(np.diag(matrix))))
        return found

    def in_si(self, own: Float[np.ndarray, "*many p"]) -> Float[np.ndarray, "*many p"]:
        """Numbers on the parameters' own scales to values in SI, many points at once, by NumPy."""
        return np.where(self.logarithmic, np.exp(np.where(self.logarithmic, own, 0.0)), own * self.unit)

    def slope(self, free: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """d value / d (number on its own scale) of each parameter."""
        return np.where(self.logarithmic, self.in_si(self.own(free)), self.unit)

    def along(self, path: str) -> "ParameterTransform":
        """The transform in which the number of the parameter `path` is that on its own scale.

        If the parameter is tied to another, directly or through others, the first of that chain has the distance for
        its number instead, and its bounds are lost.
        """
        parents = {} if self.ties is None else {link.child: link.parent for link in self.ties.links}
        if self.ties is None or path not in parents:
            return self
        first = path
        while first in parents:
            first = parents[first]
        here, there = self.paths.index(path), self.paths.index(first)
        # In place of the numbers `here` and `there`, the own one of `here` and the distance that `here` was.
        one, moved = np.eye(len(self.paths)), np.zeros(len(self.paths))
        to = one.copy()
        to[here], to[there], moved[here] = self.ties.mixing[here], one[here], self.ties.shift[here]
        mixing = self.ties.mixing @ np.linalg.inv(to)
        low, high = self.low.copy(), self.high.copy()
        low[there], high[there], low[here], high[here] = low[here], high[here], -np.inf, np.inf
        ties = Ties(mixing, self.ties.shift - mixing @ moved, self.ties.links)
        return dataclasses.replace(self, ties=ties, low=low, high=high)

    def among(self, paths: Collection[str]) -> Bool[np.ndarray, " p"]:
        """Which of the free parameters are among the `paths`."""
        return np.array([path in paths for path in self.paths])

    def at_bound(self, free: Float[np.ndarray, " p"]) -> Bool[np.ndarray, " p"]:
        """Which of the numbers lie at an end of their range."""
        return (free <= self.low) | (free >= self.high)

    def bounds_where(
        self, fitted: Bool[np.ndarray, " p"], free: Float[np.ndarray, " p"]
    ) -> dict[str, Float[np.ndarray, " p"]]:
        """ "lower" and "upper" for a solver that moves what is `fitted` and holds the others at `free`."""
        low, high = (np.where(fitted, end, free) for end in (self.low, self.high))
        return {"lower": low, "upper": high}


def transform_of(
    parameters: Mapping[str, Parameter],
    starts: Mapping[str, float],
    constraints: Sequence[Constraint] = (),
    where: str = "",
) -> ParameterTransform:
    """The scale of the free `parameters` of a study, sized after their `starts`.

    **Raises:** `InputError` that names the file (`where`) and the key of one of the `constraints` that cannot be kept.
    """
    parameters = bounded_by_constraints(parameters, constraints, where)
    links = chained(parameters, constraints, where)
    free = [p for p in parameters.values() if p.free]
    logarithmic = np.array([p.quantity.positive for p in free], bool)
    typical = lambda p: max(abs(bound) for bound in (p.low, p.high, 1e-3) if bound is not None)
    sizes = [p.standard_error or abs(starts[p.path]) or typical(p) for p in free]
    unit = np.where(logarithmic, 1.0, sizes)
    low, high = (np.array(ends) for ends in zip(*(p.bounds(starts[p.path]) for p in free), strict=True))
    with np.errstate(divide="ignore"):
        least, most = [
            np.where(logarithmic, np.log(np.where(logarithmic, end, 1.0)), end / unit) for end in (low, high)
        ]
    alone = ParameterTransform(tuple(p.path for p in free), logarithmic, unit, least, most)
    return _tied(alone, links, alone.encode(starts)) if links else alone


_ROOM = 1.0
"""Least range of a parameter from a constraint, on its own scale: a factor of e, or its size."""


def _tied(alone: ParameterTransform, links: Sequence[Link], starts: Float[np.ndarray, " p"]) -> ParameterTransform:
    """The transform with the `links`; parameters start at `starts` on their own scales.

    A tied parameter may go as far from the constraint as its bounds allow with the other one at its start.
    """
    mixing, shift = np.eye(starts.size), np.zeros(starts.size)
    low, high = alone.low.copy(), alone.high.copy()
    for link in links:
        child, parent = alone.paths.index(link.child), alone.paths.index(link.parent)
        if alone.logarithmic[child]:
            share, constant = 1.0, float(np.log(link.factor))
        else:
            share, constant = link.factor * alone.unit[parent] / alone.unit[child], 0.0
        mixing[child] += share * mixing[parent]
        shift[child] = share * shift[parent] + constant
        equal = share * starts[parent] + constant
        if link.is_upper:
            low[child], high[child] = min(alone.low[child] - equal, -_ROOM), 0.0
        else:
            low[child], high[child] = 0.0, max(alone.high[child] - equal, _ROOM)
    return dataclasses.replace(alone, ties=Ties(mixing, shift, tuple(links)), low=low, high=high)
