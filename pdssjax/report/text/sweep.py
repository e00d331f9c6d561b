"""The extremes of a sweep, as plain text."""

from typing import TYPE_CHECKING

from ...core import display_unit
from ._layout import aligned_table, heading

if TYPE_CHECKING:
    import xarray


def format_sweep(data: "xarray.Dataset") -> str:
    """The extremes of a sweep, and where they lie."""
    head = ["", "unit", "least", "most", "where it is most"]
    rows = []
    for name in ("speed", "net_step", "efficiency", "stroke", "back_slip"):
        values = data[name]
        unit, scale = ("%", 100.0) if name == "efficiency" else display_unit(values.attrs["units"])
        if not bool(values.notnull().any()):
            rows.append([values.attrs["long_name"], unit, "-", "-", "every point failed"])
            continue
        place = values.isel(values.argmax(dim=...))
        where = [_where(place[name]) for name in values.dims]
        least, most = (f"{float(end) * scale:.5g}" for end in (values.min(), values.max()))
        rows.append([values.attrs["long_name"], unit, least, most, ", ".join(where)])
    failed = int((data.failure.values != 0).sum())
    text = heading(f"Sweep of {data.failure.size} points") + aligned_table("<<>><", [head, *rows])
    return text + (f"    {failed} points failed: {data.failure.attrs['meanings']}\n" if failed else "")


def _where(coordinate: "xarray.DataArray") -> str:
    unit, scale = display_unit(coordinate.attrs["units"])
    return f"{coordinate.attrs['long_name']} = {float(coordinate) * scale:.5g} {'' if unit == '1' else unit}".rstrip()
