"""Axes of a grid, written as FROM:TO:COUNT."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ..core import InputError, Quantity, nearest, to_si

_EXPECTED = 'expected FROM:TO:COUNT such as "20:80:40", FROM:TO:COUNT:log for equal ratios, or one value'


def read_axis(path: str, text: str, legal: Mapping[str, Quantity]) -> Float[np.ndarray, " values"]:
    """The values [SI] of the axis `path`, as `text` says: "20 V:80 V:40", or a single value.

    **Raises:** `InputError` for an unknown path, a text that is no range, or a unit that does not fit.
    """
    # Quantities of the drive need not be parameters of the study.
    unit = legal[path].unit if path in legal else {"drive.voltage": "V", "drive.frequency": "Hz"}.get(path)
    if unit is None:
        raise InputError(
            f'sweep: found the unknown path "{path}"; {nearest(path, [*legal, "drive.voltage", "drive.frequency"])}'
        )
    where = f'sweep: path "{path}"'
    parts = [part.strip() for part in text.split(":")]
    if len(parts) == 1:
        return np.array([_number(parts[0], unit, where)])
    if len(parts) not in (3, 4) or not parts[2].isdigit() or int(parts[2]) < 1 or parts[3:] not in ([], ["log"]):
        raise InputError(f'{where}: found "{text}", {_EXPECTED}.')
    low, high = (_number(part, unit, where) for part in parts[:2])
    if parts[3:] and not (low > 0 and high > 0):
        raise InputError(f'{where}: found "{text}", expected ends above 0 for equal ratios.')
    spaced = np.geomspace if parts[3:] else np.linspace
    return spaced(low, high, int(parts[2]))


def _number(text: str, unit: str, where: str) -> float:
    try:
        return to_si(float(text), unit, where)
    except ValueError:
        return to_si(text, unit, where)
