"""The parameters of a study: which are free, where they start, what bounds them."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .errors import InputError
from .quantity import Quantity
from .tables import Table, check_range

REACH = 1e3
"""Factor by which a positive parameter may leave its start where the study sets no bound."""


@dataclasses.dataclass(frozen=True)
class Parameter:
    """One entry of a study's [parameters]; numbers are in the SI unit `unit`."""

    path: str
    """Model and field, such as "piezo.gain"."""
    unit: str
    """SI unit; "" for a pure number."""
    quantity: Quantity
    """What the model declares of it."""
    value: float | None = None
    """The value of a fixed parameter; None: it is free."""
    start: float | None = None
    """Where the fit of a free parameter starts; None: to be found from the data."""
    low: float | None = None
    """Lower bound given; None: the legal range alone bounds it."""
    high: float | None = None
    """Upper bound given; None: the legal range alone bounds it."""
    source: str = ""
    """Where its number comes from, if not from the study's file."""

    @property
    def number(self) -> float | None:
        """Its value or its start; None where it has neither."""
        return self.start if self.value is None else self.value

    @property
    def origin(self) -> str:
        """Where its number comes from, in words."""
        return self.source or ("value in the study" if self.start is None else "start in the study")

    @property
    def free(self) -> bool:
        """Whether a fit may change it."""
        return self.value is None


def read_parameter(path: str, table: Table, quantity: Quantity) -> Parameter:
    """The parameter `path` as the `table` of its entry describes it: free unless it has a value.

    **Raises:** `InputError` if a number is outside the quantity's legal range, the start
    outside its bounds, the bounds crossed, or a value given together with any of them.
    """
    table.only(["value", "start", "min", "max"])
    fixed = "value" in table.entries
    if fixed and len(table.entries) > 1:
        extra = next(key for key in table.entries if key != "value")
        raise InputError(f'{table.where}: found "value" together with "{extra}", expected one or the other.')
    if fixed:
        return Parameter(path, quantity.unit, quantity, value=table.quantity("value", quantity))
    start = table.quantity("start", quantity) if "start" in table.entries else None
    low, high = _bound(table, "min", quantity, quantity.low), _bound(table, "max", quantity, quantity.high)
    _check_order(table, quantity, start, low, high)
    return Parameter(path, quantity.unit, quantity, start=start, low=low, high=high)


def _bound(table: Table, key: str, quantity: Quantity, end: float) -> float | None:
    """A bound given; None also where it only repeats the `end` of the legal range."""
    bound = table.number(key, quantity.unit, None)
    if bound is None or bound == end:
        return None
    check_range(bound, quantity, table.at(key))
    return bound


def _check_order(table: Table, quantity: Quantity, start: float | None, low: float | None, high: float | None) -> None:
    unit = f" {quantity.unit}".rstrip()
    if low is not None and high is not None and low >= high:
        raise InputError(f"{table.at('min')}: found {low:g}{unit}, expected less than the max, {high:g}{unit}.")
    if start is not None and low is not None and start < low:
        raise InputError(f"{table.at('start')}: found {start:g}{unit}, expected at least the min, {low:g}{unit}.")
    if start is not None and high is not None and start > high:
        raise InputError(f"{table.at('start')}: found {start:g}{unit}, expected at most the max, {high:g}{unit}.")


class Scale(eqx.Module):
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


def scale(parameters: Mapping[str, Parameter], starts: Mapping[str, float]) -> Scale:
    """The scale of the free `parameters` of a study, sized after their `starts`."""
    free = [p for p in parameters.values() if p.free]
    logarithmic = np.array([p.quantity.positive for p in free], bool)
    sizes = [abs(starts[p.path]) or _typical(p) for p in free]
    unit = np.where(logarithmic, 1.0, sizes)
    low, high = (np.array(ends) for ends in zip(*(_ends(p, starts[p.path]) for p in free), strict=True))
    with np.errstate(divide="ignore"):
        bounds = [np.where(logarithmic, np.log(np.where(logarithmic, end, 1.0)), end / unit) for end in (low, high)]
    return Scale(tuple(p.path for p in free), logarithmic, unit, *bounds)


def _ends(parameter: Parameter, start: float) -> tuple[float, float]:
    """The bounds given, or else the legal range; a positive quantity stays within reach of its start."""
    declared = parameter.quantity
    low, high = declared.low, declared.high
    if declared.positive:
        low, high = max(low, start / REACH), min(high * (1.0 - 1e-6), start * REACH)
    return low if parameter.low is None else parameter.low, high if parameter.high is None else parameter.high


def _typical(parameter: Parameter) -> float:
    """A size for a parameter that starts from zero."""
    return max(abs(bound) for bound in (parameter.low, parameter.high, 1e-3) if bound is not None)
