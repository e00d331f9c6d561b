"""The extremes of a sweep, as plain text."""

from typing import TYPE_CHECKING

import numpy as np

from ...core import display_unit
from ...sweeps import FURTHER, GRAZING, POINT_FAILURES
from ._layout import aligned_table, heading

if TYPE_CHECKING:
    import xarray


def format_sweep(data: "xarray.Dataset") -> str:
    """The extremes of a sweep, and where they lie."""
    banded = "speed_sd" in data
    head = ["", "unit", "least", "most", *["+/- (95 %)"] * banded, "where it is largest"]
    rows = []
    for name in ("speed", "net_step", "efficiency", "stroke", "back_slip", *(name for name in FURTHER if name in data)):
        values = data[name]
        unit, scale = ("%", 100.0) if name == "efficiency" else display_unit(values.attrs["units"])
        if not bool(values.notnull().any()):
            rows.append([values.attrs["long_name"], unit, "-", "-", *["-"] * banded, "every point failed"])
            continue
        # By size: a speed backward is negative.
        place = values.isel(abs(values).argmax(dim=...))
        # Of a sample the dimension has no values of its own, but all that changes along it has.
        where = [_where(coordinate) for coordinate in place.coords.values() if "units" in coordinate.attrs]
        least, most = (f"{float(end) * scale:.5g}" for end in (values.min(), values.max()))
        half = [f"{_half_band(data, name) * scale:.2g}"] if banded else []
        rows.append([values.attrs["long_name"], unit, least, most, *half, ", ".join(where)])
    grazing = int((data.failure.values == GRAZING).sum())
    failed = int((data.failure.values != 0).sum()) - grazing
    text = heading(f"Sweep of {data.failure.size} points{_of_record(data)}") + aligned_table(
        "<<>>" + ">" * banded + "<", [head, *rows]
    )
    bent = int((data.speed_straight.values == 0).sum()) if "speed_straight" in data else 0
    if bent:
        text += f"    First order does not hold for the speed at {bent} of the points: ask for --bands draws there.\n"
    if data.sizes.get("drive_direction") == 2:
        text += _both_directions(data)
    if grazing:
        text += f"    At {grazing} points {POINT_FAILURES[GRAZING]}.\n"
    return text + (f"    {failed} points failed: {data.failure.attrs['meanings']}\n" if failed else "")


def _of_record(data: "xarray.Dataset") -> str:
    """Whose drive was varied, and which way it goes, as far as that is told and is no axis."""
    name, direction = data.attrs.get("record"), data.attrs.get("drive.direction")
    way = "" if direction is None else ", forward" if direction > 0 else ", backward"
    return f': the drive of "{name}"{way}' if name else ""


def _both_directions(data: "xarray.Dataset") -> str:
    """How the speeds backward compare with those forward, and how many points move the wrong way."""
    along = {way: (way * data.speed.sel(drive_direction=way)).values for way in (1.0, -1.0)}
    forward, backward = along.values()
    both = (forward > 0) & (backward > 0)
    told = ""
    if both.any():
        low, middle, high = np.quantile(backward[both] / forward[both], [0.0, 0.5, 1.0])
        told = f"    Backward is {middle:.3g} times as fast as forward in the median, {low:.3g} to {high:.3g} times"
        told += (
            ".\n" if both.all() else f", at the {int(both.sum())} of {both.size} points where both move as driven.\n"
        )
    for name, speed in (("forward", forward), ("backward", backward)):
        wrong = int((speed < 0).sum())
        told += f"    Driven {name} it moves the wrong way at {wrong} of {speed.size} points.\n" if wrong else ""
    return told


def _half_band(data: "xarray.Dataset", name: str) -> float:
    """Half the width of the band of a metric where it is largest."""
    at = np.unravel_index(int(np.nanargmax(np.abs(data[name].values))), data[name].shape)
    return 0.5 * float(data[f"{name}_high"].values[at] - data[f"{name}_low"].values[at])


def _where(coordinate: "xarray.DataArray") -> str:
    unit, scale = display_unit(coordinate.attrs["units"])
    return f"{coordinate.attrs['long_name']} = {float(coordinate) * scale:.5g} {'' if unit == '1' else unit}".rstrip()
