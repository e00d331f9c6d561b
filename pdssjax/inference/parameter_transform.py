"""The free parameters as a fit sees them: one number each, of order one."""

from collections.abc import Collection, Mapping

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ..core import Scalar
from ..study import Parameter, Values


class ParameterTransform(eqx.Module):
    """The free parameters as the fit sees them: one number each, of order one, unbounded below.

    A positive quantity is fitted by its logarithm; a signed one, or one that may be zero,
    by its ratio to a typical size.
    """

    paths: tuple[str, ...] = eqx.field(static=True)
    logarithmic: Bool[np.ndarray, " p"]
    unit: Float[np.ndarray, " p"]
    """Size of one unit of a linear parameter; 1 for a logarithmic one."""
    low: Float[np.ndarray, " p"]
    high: Float[np.ndarray, " p"]
    """Bounds, on the fit's scale."""

    def encode(self, values: Values) -> Float[np.ndarray, " p"]:
        """Values in SI to the fit's scale."""
        given = np.array([float(values[path]) for path in self.paths])
        return np.where(self.logarithmic, np.log(np.where(self.logarithmic, given, 1.0)), given / self.unit)

    @eqx.filter_jit
    def decode(self, free: Float[Array | np.ndarray, " p"]) -> dict[str, Scalar]:
        """The fit's numbers to values in SI; differentiable."""
        number = jnp.where(self.logarithmic, jnp.exp(jnp.where(self.logarithmic, free, 0.0)), free * self.unit)
        return {path: number[i] for i, path in enumerate(self.paths)}

    def in_si(self, free: Float[np.ndarray, "*many p"]) -> Float[np.ndarray, "*many p"]:
        """Many points at once, by NumPy."""
        return np.where(self.logarithmic, np.exp(np.where(self.logarithmic, free, 0.0)), free * self.unit)

    def slope(self, free: Float[np.ndarray, " p"]) -> Float[np.ndarray, " p"]:
        """d value / d free."""
        return np.where(self.logarithmic, np.exp(np.where(self.logarithmic, free, 0.0)), self.unit)

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


def transform_of(parameters: Mapping[str, Parameter], starts: Mapping[str, float]) -> ParameterTransform:
    """The scale of the free `parameters` of a study, sized after their `starts`."""
    free = [p for p in parameters.values() if p.free]
    logarithmic = np.array([p.quantity.positive for p in free], bool)
    sizes = [p.standard_error or abs(starts[p.path]) or _typical(p) for p in free]
    unit = np.where(logarithmic, 1.0, sizes)
    low, high = (np.array(ends) for ends in zip(*(p.bounds(starts[p.path]) for p in free), strict=True))
    with np.errstate(divide="ignore"):
        bounds = [np.where(logarithmic, np.log(np.where(logarithmic, end, 1.0)), end / unit) for end in (low, high)]
    return ParameterTransform(tuple(p.path for p in free), logarithmic, unit, *bounds)


def _typical(parameter: Parameter) -> float:
    """A size for a parameter that starts from zero."""
    return max(abs(bound) for bound in (parameter.low, parameter.high, 1e-3) if bound is not None)
