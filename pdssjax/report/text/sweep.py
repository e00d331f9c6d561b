"""A sweep as plain text: its plan, the extremes of what was found, and the border that was looked for."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...core import display_unit
from ...sweeps import ALONG, FURTHER, GRAZING, POINT_FAILURES
from ._layout import aligned_table, counted, heading, note

if TYPE_CHECKING:
    import xarray

    from ...sweeps import PlannedSweep


def format_plan(planned: "PlannedSweep", size: int) -> str:
    """Points, blocks and room on the disk (`size` [bytes]) of a sweep that has not been run."""
    plan, count = planned.plan, len(planned.points)
    skipped = count - len(plan.order)
    rows = [
        ["points", str(count), f"{skipped} of them skipped" if skipped else ""],
        ["blocks", str(plan.blocks), f"of {plan.lanes} points, a chunk of the store each"],
        ["room on the disk", f"{size / 1e6:.3g} MB", "at most"],
    ]
    return heading("What this sweep takes") + aligned_table("<><", rows)


def format_sweep(data: "xarray.Dataset") -> str:
    """The extremes of a sweep, each with its band and the place where it lies, and what failed."""
    shown = ("speed", "net_step", "efficiency", "stroke", "back_slip", *(name for name in FURTHER if name in data))
    # What varies from point to point, also along the dimension of a sample.
    banded, places = "speed_sd" in data, [axis for axis in data.coords.values() if "units" in axis.attrs]
    band = [["+/-"], ["95 %"]] if banded else [[], []]
    heads = [[""] * 4 + band[0] + [axis.attrs["long_name"] for axis in places]]
    place_units = [display_unit(axis.attrs["units"])[0] for axis in places]
    heads += [["", "unit", "", "value"] + band[1] + [f"({u})" if u not in ("", "1") else "" for u in place_units]]
    rows = [row for name in shown for row in _extremes(data, name, places, banded)]
    record, direction = data.attrs.get("record"), data.attrs.get("drive.direction")
    way = "" if direction is None else f", {direction_word(direction)}"
    drive = f': the drive of "{record}"{way}' if record else ""
    text = heading(f"Sweep of {counted(data.failure.size, 'point')}{drive}")
    text += aligned_table("<<<>" + ">" * (banded + len(places)), [*filter(any, heads), *rows])
    if errors := data.attrs.get("errors"):
        plain = {"with-misfit": "the errors with misfit", "standard": "the standard errors"}
        plain |= {kind: f"the draws of the {kind}" for kind in ("bootstrap", "posterior")}
        text += f"    +/-: half the 95 % band, by {plain.get(errors, f'the {errors} errors')} of the estimate.\n"
    bent = int((data.speed_straight.values == 0).sum()) if "speed_straight" in data else 0
    if bent:
        text += f"    First order does not hold for the speed at {bent} of the points: ask for --bands draws there.\n"
    if data.sizes.get(ALONG) == 2:
        text += _both_directions(data)
    codes, counts = np.unique(data.failure.values, return_counts=True)
    failures = {int(code): int(count) for code, count in zip(codes, counts, strict=True) if code}
    # Points whose cycle grazes have their metrics.
    if grazing := failures.pop(GRAZING, 0):
        text += note(f"At {grazing} points {POINT_FAILURES[GRAZING]}.")
    if failures:
        text += f"    {sum(failures.values())} points failed:\n"
    return text + "".join(note(f"{n} with failure {code}: {POINT_FAILURES[code]}", 8) for code, n in failures.items())


def _extremes(data: "xarray.Dataset", name: str, places: "Sequence[xarray.DataArray]", banded: bool) -> list[list[str]]:
    """Rows of a metric, at its largest and its smallest value; one row where both look alike."""
    values = data[name]
    unit, scale = ("%", 100.0) if name == "efficiency" else display_unit(values.attrs["units"])
    head = [values.attrs["long_name"], unit]
    anywhere = lambda word: [word] + [""] * (len(places) - 1) if places else []
    if not bool(values.notnull().any()):
        return [[*head, "", "-", *["-"] * banded, *anywhere("nowhere")]]
    extremes = []
    for end in (values.argmax, values.argmin):
        at = end(dim=...)
        numbers = [f"{float(values.isel(at)) * scale:.5g}"]
        if banded:
            half = 0.5 * (data[f"{name}_high"] - data[f"{name}_low"]).isel(at)
            numbers.append(f"{float(half) * scale:.2g}")
        extremes.append((numbers, [_number(axis.isel({d: at[d] for d in axis.dims})) for axis in places]))
    (most, there), (least, elsewhere) = extremes
    if most == least:
        return [[*head, "", *most, *(there if values.size == 1 else anywhere("everywhere"))]]
    return [[*head, "most", *most, *there], ["", "", "least", *least, *elsewhere]]


def _both_directions(data: "xarray.Dataset") -> str:
    """Compare the speeds backward with those forward, and count the points that move the wrong way."""
    along = {way: (way * data.speed.sel(drive_direction=way)).values for way in (1.0, -1.0)}
    forward, backward = along.values()
    both = (forward > 0) & (backward > 0)
    text = ""
    if both.any():
        low, middle, high = np.quantile(backward[both] / forward[both], [0.0, 0.5, 1.0])
        where = "" if both.all() else f", at the {int(both.sum())} of {both.size} points where both move as driven"
        text = f"    Backward is {middle:.3g} times as fast as forward in the median, "
        text += f"{low:.3g} to {high:.3g} times{where}.\n"
    for name, speed in (("forward", forward), ("backward", backward)):
        wrong = int((speed < 0).sum())
        text += f"    Driven {name} it moves the wrong way at {wrong} of {speed.size} points.\n" if wrong else ""
    return text


def direction_word(direction: float) -> str:
    """The word for a `direction` of the drive, 1 or -1."""
    return "forward" if direction > 0 else "backward"


def _number(coordinate: "xarray.DataArray") -> str:
    if coordinate.name == ALONG:
        return direction_word(float(coordinate))
    return f"{float(coordinate) * display_unit(coordinate.attrs['units'])[1]:.5g}"


def format_border(data: "xarray.Dataset") -> str:
    """The border at every point of the grid of a `find_border`, and what was asked."""
    asked = data.attrs
    unit, scale = display_unit(data.border.attrs["units"])
    rows = []
    for place in list(np.ndindex(data.border.shape))[:60]:  # the file has all of them
        here = data.isel(dict(zip(data.border.dims, place, strict=True)))
        border = float(here.border) * scale
        found = f"{border:.5g}" if np.isfinite(border) else "none"
        rows.append([*(_number(here[name]) for name in data.border.dims), found, f"{float(here.passes):.0f}"])
    head = [*(_named(data[name]) for name in data.border.dims), _named(data.border), "passes"]
    text = heading(f"Border along {asked['path']}") + aligned_table("<" * data.border.ndim + ">>", [head, *rows])
    if data.border.size > len(rows):
        text += f"    ... and {data.border.size - len(rows)} more\n"
    text += f"    Border of {asked['of']}, to within {asked['tolerance'] * scale:g} {unit},"
    text += f" between {asked['low'] * scale:g} and {asked['high'] * scale:g} {unit}; {asked['points']} points.\n"
    none = int(np.isnan(data.border.values).sum())
    text += f"    At {none} of {data.border.size} points there is no border in that range.\n" if none else ""
    often = int((data.passes.values > 1).sum())
    if often:
        text += f"    At {often} of {data.border.size} points it is passed more than once; the lowest is shown.\n"
    return text


def _named(values: "xarray.DataArray") -> str:
    unit, _ = display_unit(values.attrs["units"])
    return values.attrs["long_name"] if unit in ("", "1") else f"{values.attrs['long_name']} ({unit})"
