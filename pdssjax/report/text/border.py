"""The border that a sweep looked for, as plain text."""

from typing import TYPE_CHECKING

import numpy as np

from ...core import display_unit
from ._layout import aligned_table, heading

if TYPE_CHECKING:
    import xarray

_MOST = 60
"""Rows that are printed; all are in the file."""


def format_border(data: "xarray.Dataset") -> str:
    """The border at every point of the grid of a `find_border`, and what was asked."""
    asked = data.attrs
    unit, scale = display_unit(data.border.attrs["units"])
    rows = []
    for place in list(np.ndindex(data.border.shape))[:_MOST]:
        here = data.isel(dict(zip(data.border.dims, place, strict=True)))
        border = float(here.border) * scale
        found = f"{border:.5g}" if np.isfinite(border) else "none"
        rows.append([*(_number(here[name]) for name in data.border.dims), found, f"{float(here.passes):.0f}"])
    head = [*(_named(data[name]) for name in data.border.dims), _named(data.border), "passes"]
    text = heading(f"Border along {asked['path']}") + aligned_table("<" * data.border.ndim + ">>", [head, *rows])
    if data.border.size > _MOST:
        text += f"    ... and {data.border.size - _MOST} more\n"
    text += f"    Border of {asked['of']}, told to {asked['tolerance'] * scale:g} {unit}"
    text += f" between {asked['low'] * scale:g} and {asked['high'] * scale:g} {unit}; {asked['points']} points.\n"
    none = int(np.isnan(data.border.values).sum())
    text += f"    At {none} of {data.border.size} there is none in that range.\n" if none else ""
    often = int((data.passes.values > 1).sum())
    if often:
        text += f"    At {often} of {data.border.size} it is passed more than once: this is the lowest place.\n"
    return text


def _named(values: "xarray.DataArray") -> str:
    unit, _ = display_unit(values.attrs["units"])
    return values.attrs["long_name"] if unit in ("", "1") else f"{values.attrs['long_name']} ({unit})"


def _number(value: "xarray.DataArray") -> str:
    return f"{float(value) * display_unit(value.attrs['units'])[1]:.5g}"
