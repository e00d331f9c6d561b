"""SI values as people read them: display units, and digits that match the standard error."""

import math
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:  # listing the models loads no library
    import numpy as np
    from jaxtyping import Float

MICROMETRES = 1e6
"""Micrometres in a metre; every length in reports, plots and predictions is in micrometres."""

_UNITS = {
    "m": ("um", 1e6),
    "m/s": ("um/s", 1e6),
    "m/V": ("um/V", 1e6),
    **{f"m/V**{k}": (f"um/V^{k}", 1e6) for k in range(2, 10)},
    "s": ("ms", 1e3),
    "kg": ("g", 1e3),
    "N/m": ("N/um", 1e-6),
}


class Display(NamedTuple):
    """How a report or a plot shows what a record measures."""

    quantity: str
    """Label of an axis: "displacement"."""
    plural: str
    """Heading of a table: "lengths"."""
    unit: str
    """Shown in place of the SI unit, such as "um"."""
    scale: float
    """Factor from SI to `unit`."""

    def text(self, number: float) -> str:
        """A number [SI] as people read it, with its unit."""
        return f"{number * self.scale:.4g} {self.unit}"

    def decimals(self, *errors: float) -> int:
        """Decimal places that show each of the `errors` [SI] with two significant digits; four at least."""
        return max(4, *(decimals_for(error * self.scale) or 0 for error in errors))


LENGTH = Display("displacement", "lengths", *_UNITS["m"])
"""The display of displacements."""

VELOCITY = Display("velocity", "velocities", "mm/s", 1e3)
"""The display of velocities, as of a laser vibrometer."""


def display_unit(unit: str) -> tuple[str, float]:
    """The unit to show in place of the SI `unit`, and the factor from SI to it."""
    return _UNITS.get(unit, (unit, 1.0))


def with_micro_sign(text: str) -> str:
    """A unit, or a number with one, with µ in place of the u of terminals: "µm/V" of "um/V"."""
    return text.replace("um", "µm")


def decimals_for(error: float) -> int | None:
    """Decimal places that show `error` with two significant digits; None where there is no error."""
    if not (math.isfinite(error) and error > 0):
        return None
    return max(0, 1 - math.floor(math.log10(error)))


def rounded(value: float, decimals: int | None) -> str:
    """`value` with so many decimal places, or to six significant digits without any given."""
    if not math.isfinite(value):
        return "-"
    if decimals is None or decimals > 12:
        return f"{value:.6g}"
    return f"{value:.{decimals}f}"


def percent(part: float, whole: float) -> str:
    """`part` in per cent of `whole`, to three significant digits; "-" where that means nothing."""
    if not (math.isfinite(part) and math.isfinite(whole) and whole):
        return "-"
    share = 100.0 * abs(part / whole)
    return f"{share:.3g} %" if share < 1000.0 else f"{share:.0f} %"


def strongest_pairs(
    names: tuple[str, ...], correlation: "Float[np.ndarray, 'p p']", least: float
) -> list[tuple[str, str, float]]:
    """Pairs of parameters correlated by at least `least` in size, the strongest first."""
    pairs = [
        (names[i], names[j], float(correlation[i, j])) for i in range(len(names)) for j in range(i + 1, len(names))
    ]
    return sorted((p for p in pairs if abs(p[2]) >= least), key=lambda p: -abs(p[2]))
