"""The free parameters as a fit sees them: one number each, of order one."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from ..study import Parameter


class ParameterTransform(eqx.Module):
    """The free parameters as the fit sees them: one number each, of order one, unbounded below.

    A positive quantity is fitted by its logarithm; a signed one, or one that may be zero,
    by its ratio to a typical size.
    """

    paths: tuple[str, ...] = eqx.field(static=True)
    logarithmic: np.ndarray
    unit: np.ndarray
    """Size of one unit of a linear parameter; 1 for a logarithmic one."""
    low: np.ndarray
    high: np.ndarray
    """Bounds, on the fit's scale."""

    def encode(self, values: Mapping[str, Any]) -> np.ndarray:
        """Values in SI to the fit's scale, shape (parameters,)."""
        given = np.array([float(values[path]) for path in self.paths])
        return np.where(self.logarithmic, np.log(np.where(self.logarithmic, given, 1.0)), given / self.unit)

    @eqx.filter_jit
    def decode(self, free: Any) -> dict[str, Any]:
        """The fit's numbers, shape (parameters,), to values in SI; differentiable."""
        number = jnp.where(self.logarithmic, jnp.exp(jnp.where(self.logarithmic, free, 0.0)), free * self.unit)
        return {path: number[i] for i, path in enumerate(self.paths)}

    def slope(self, free: Any) -> np.ndarray:
        """d value / d free, shape (parameters,)."""
        return np.where(self.logarithmic, np.exp(np.where(self.logarithmic, free, 0.0)), self.unit)


def transform_of(parameters: Mapping[str, Parameter], starts: Mapping[str, float]) -> ParameterTransform:
    """The scale of the free `parameters` of a study, sized after their `search`."""
    free = [p for p in parameters.values() if p.free]
    logarithmic = np.array([p.quantity.positive for p in free], bool)
    sizes = [abs(starts[p.path]) or _typical(p) for p in free]
    unit = np.where(logarithmic, 1.0, sizes)
    low, high = (np.array(ends) for ends in zip(*(p.bounds(starts[p.path]) for p in free), strict=True))
    with np.errstate(divide="ignore"):
        bounds = [np.where(logarithmic, np.log(np.where(logarithmic, end, 1.0)), end / unit) for end in (low, high)]
    return ParameterTransform(tuple(p.path for p in free), logarithmic, unit, *bounds)


def _typical(parameter: Parameter) -> float:
    """A size for a parameter that starts from zero."""
    return max(abs(bound) for bound in (parameter.low, parameter.high, 1e-3) if bound is not None)
