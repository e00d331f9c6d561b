"""One parameter of a study: free or fixed, its start and its bounds, and the condition under which it may hold.

A parameter such as "friction.f_ss_a@wet" holds in the records that have the condition "wet"; every other record takes
the number of the parameter without a condition.
"""

import dataclasses
import math
from collections.abc import Collection, Iterable, Mapping

import jax.numpy as jnp

from ..core import Quantity, Truth
from .models import Values

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
    """The model's declaration of the parameter."""
    value: float | None = None
    """The value of a fixed parameter; None: it is free."""
    start: float | None = None
    """Where the fit of a free parameter starts; None: to be found from the data."""
    low: float | None = None
    """Lower bound given; None: the legal range alone bounds it."""
    high: float | None = None
    """Upper bound given; None: the legal range alone bounds it."""
    standard_error: float | None = None
    """Standard error of the start, where the parameter was measured apart; None: only the records determine it."""
    source: str = ""
    """Where its number comes from, if not from the study's file."""

    @property
    def number(self) -> float | None:
        """The value of a fixed parameter or the start of a free one; None where it has neither."""
        return self.start if self.value is None else self.value

    @property
    def origin(self) -> str:
        """Where the number of the parameter comes from, in words."""
        if self.measured_apart is not None:
            return "measured apart"
        return self.source or ("value in the study" if self.start is None else "start in the study")

    def with_start(self, start: float | None, source: str = "") -> "Parameter":
        """The parameter with another `start`, moved to a bound that it lies beyond; None: to be found."""
        if start is not None:
            start = start if self.low is None else max(start, self.low)
            start = start if self.high is None else min(start, self.high)
        return dataclasses.replace(self, start=start, source=source)

    def bounds(self, start: float | None = None) -> tuple[float, float]:
        """The least and the greatest value, in `unit`: the bounds given, or else those of the legal range.

        With a `start` a positive quantity keeps within `REACH` of it, where no bound is given.
        """
        low, high = self.quantity.low, self.quantity.high
        high = high - 1e-6 * abs(high) if math.isfinite(high) else high  # the end itself is not legal
        if start is not None and self.quantity.positive:
            low, high = max(low, start / REACH), min(high, start * REACH)
        return low if self.low is None else self.low, high if self.high is None else self.high

    @property
    def measured_apart(self) -> tuple[float, float] | None:
        """The number and its standard error, of a free parameter that was measured apart."""
        if self.value is not None or self.start is None or self.standard_error is None:
            return None
        return self.start, self.standard_error

    @property
    def free(self) -> bool:
        """Whether a fit may change it."""
        return self.value is None


MARK = "@"
"""Between the path of a parameter and the condition under which it holds."""


def split_path(path: str) -> tuple[str, str]:
    """The path of the parameter, and the condition under which it holds; "" where it always does."""
    base, _, condition = path.partition(MARK)
    return base, condition


def paths_in(paths: Iterable[str], conditions: Collection[str]) -> dict[str, str]:
    """Which of the parameters with these `paths` hold in a record made under `conditions`: by path without one."""
    split = {path: split_path(path) for path in paths}
    usual = {base: path for path, (base, condition) in split.items() if not condition}
    return usual | {base: path for path, (base, condition) in split.items() if condition and condition in conditions}


def under_conditions(values: Values, holds: Mapping[str, Truth | bool]) -> Values:
    """The numbers of one record by paths without conditions.

    **Arguments:** for each condition of the `values`, whether it `holds` in the record; a condition that is not
    there does not.
    """
    found = {path: number for path, number in values.items() if MARK not in path}
    for path, number in values.items():
        base, condition = split_path(path)
        if condition in holds:
            found[base] = jnp.where(holds[condition], number, found[base])
    return found
