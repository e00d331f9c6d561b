"""How fast at which voltage and frequency, where does it stop working, and how sure is that?

The packaged example is identified from its five records (three steps, two sawtooth records at 5 Hz), and then asked for
the steady cycle under any sawtooth from 2 to 150 V and 2 to 400 Hz, in both directions; the bands are to first order,
from the estimate's covariance.  Killed, it goes on where it was.

    python -m experiments.map
"""

from pathlib import Path

import matplotlib.colors
import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.common import OUT, VERMILION, Row, print_table, save, styled
from experiments.example_fit import draws, identified
from pdssjax import Study, prepare_jax, sweep
from pdssjax.files import SweepStore
from pdssjax.sweeps import DEAD, Crossed, Grid, SigmaPoints, find_border, with_bands

NAME = "map"
VOLTAGES, FREQUENCIES = np.geomspace(2.0, 150.0, 38), np.geomspace(2.0, 400.0, 47)
COARSE_VOLTAGES, COARSE_FREQUENCIES = np.geomspace(2.0, 150.0, 13), np.geomspace(2.0, 400.0, 15)
"""Of the bands, each of whose points stands for 19 simulations."""
ASKED = (30.0, 80.0)
"""The user's question [V, Hz]."""
THESIS = ((64.2, 5.0), (64.2, 20.0))
"""Where the thesis ran it [V, Hz]."""
LEVELS = [1e-6, 1e-5, 1e-4, 1e-3, 1e-2]
"""Speeds of the contours [m/s]."""
COLOURS = matplotlib.colors.LogNorm(1e-1, 1e4)
"""Of the speeds [um/s]."""


def calculate(
    study: Study,
    estimate: Path,
    grid: tuple[np.ndarray, np.ndarray] = (VOLTAGES, FREQUENCIES),
    coarse: tuple[np.ndarray, np.ndarray] = (COARSE_VOLTAGES, COARSE_FREQUENCIES),
    workers: int | None = None,
) -> tuple[xarray.Dataset, xarray.Dataset]:
    """The map of both directions, and that of the bands forward."""
    ways = {"drive.direction": np.array([1.0, -1.0])}
    over = lambda axes: {"drive.voltage": np.asarray(axes[0]), "drive.frequency": np.asarray(axes[1])}
    kept = lambda part: SweepStore(OUT / NAME / f"{part}.zarr", resume=True)
    both = sweep(study, over(grid) | ways, cycles="steady", store=kept("both"), workers=workers)
    about = Crossed(Grid(over(coarse)), SigmaPoints(draws(study, estimate)))
    return both, with_bands(sweep(study, about, cycles="steady", store=kept("bands"), workers=workers))


def answer(study: Study, estimate: Path, both: xarray.Dataset, banded: xarray.Dataset) -> str:
    """The user's question in numbers."""
    voltage, frequency = ASKED
    here = Grid({"drive.voltage": np.array([voltage]), "drive.frequency": np.array([frequency])})
    asked = with_bands(sweep(study, Crossed(here, SigmaPoints(draws(study, estimate))), cycles="steady"))
    back = sweep(study, here.axes | {"drive.direction": np.array([-1.0])}, cycles="steady")
    at = {"drive.frequency": np.array([frequency])}
    ends = [
        find_border(study, "drive.voltage", (0.5, 60.0), over, tolerance=0.05, coarse=30, cycles="steady")
        for over in (at, at | {"drive.direction": np.array([-1.0])})
    ]
    forward, backward = ((way * both.speed.sel(drive_direction=way)).values for way in (1.0, -1.0))
    most = np.unravel_index(int(np.nanargmax(forward)), forward.shape)
    half = 0.5e6 * float((asked.speed_high - asked.speed_low).squeeze())
    sure = (0.5 * (banded.speed_high - banded.speed_low) / abs(banded.speed)).where(banded.efficiency > 0.05)
    held = banded.speed_straight.where(banded.efficiency > 0.05)
    at, along = f"{voltage:g} V, {frequency:g} Hz", -1e6 * float(back.speed.squeeze())
    rows = [
        Row(f"speed at {at}, forward", None, f"{1e6 * float(asked.speed.squeeze()):.2f} +/- {half:.2f}", "um/s"),
        Row(f"speed at {at}, backward", None, along, "um/s", "it moves forward" if along < 0 else ""),
        Row(f"it works at {frequency:g} Hz from, forward", None, float(ends[0].border.squeeze()), "V"),
        Row(f"it works at {frequency:g} Hz from, backward", None, float(ends[1].border.squeeze()), "V"),
        Row("fastest on the map, forward", None, 1e6 * forward[most], "um/s", _at(both, most)),
        Row("backward by forward, where both move as driven, median", None, float(_ratio(forward, backward)), "1"),
        Row("95 % band of the speed, half, median of the map", None, 100.0 * float(sure.median()), "%"),
        Row("the same, worst", None, 100.0 * float(sure.max()), "%"),
        Row("points whose band first order does not give", None, f"{int((held == 0).sum())} of {int(held.count())}"),
        Row("points whose motion does not repeat", None, int((both.cycles_to_repeat == 0).sum()), "1"),
    ]
    return print_table("A map of the identified example", rows, NAME, ["Bands where the efficiency is above 5 %."])


def draw(both: xarray.Dataset, banded: xarray.Dataset) -> Figure:
    """Speeds in both directions, and how well they are known."""
    figure = Figure(figsize=(11.5, 3.7), layout="constrained")
    axes = figure.subplots(1, 3, sharex=True, sharey=True)
    for panel, way, name in zip(axes, (1.0, -1.0), ("forward", "backward"), strict=False):
        part = both.sel(drive_direction=way)
        x, y, speed = part.drive_frequency, part.drive_voltage, 1e6 * abs(part.speed.values)
        works = part.efficiency.values > DEAD
        panel.pcolormesh(x, y, np.where(works, speed, np.nan), norm=COLOURS, rasterized=True, shading="nearest")
        lines = panel.contour(x, y, np.where(works, speed, np.nan), levels=[1e6 * v for v in LEVELS], colors="w")
        panel.clabel(lines, fmt=lambda value: f"{value:g}", fontsize=7)
        _dead(panel, part)
        panel.set_title(f"speed {name}", loc="left")
    figure.colorbar(axes[0].collections[0], ax=axes[:2], label="speed (µm/s)")
    half = (50.0 * (banded.speed_high - banded.speed_low) / abs(banded.speed)).where(banded.efficiency > DEAD)
    norm = matplotlib.colors.LogNorm(0.1, 100.0)
    x, y = banded.drive_frequency, banded.drive_voltage
    image = axes[2].pcolormesh(x, y, half, norm=norm, cmap="magma_r", rasterized=True, shading="nearest")
    bent = ((banded.speed_straight == 0) & (banded.efficiency > DEAD)).values
    rows, columns = np.nonzero(bent)
    axes[2].plot(x[columns], y[rows], "x", color="k", markersize=4, label="first order does not hold")
    axes[2].set_title("how sure: half the 95 % band of the speed forward", loc="left")
    figure.colorbar(image, ax=axes[2], label="of the speed (%)")
    _dead(axes[2], both.sel(drive_direction=1.0))
    for panel in axes:
        panel.plot(*np.array(THESIS).T[::-1], "*", color="w", markeredgecolor="k", markersize=9, label="thesis")
        panel.plot(ASKED[1], ASKED[0], "o", color="none", markeredgecolor="k", markersize=7, label="30 V, 80 Hz")
        panel.set_xscale("log")
        panel.set_yscale("log")
        panel.set_yticks([2, 5, 10, 20, 50, 100], labels=["2", "5", "10", "20", "50", "100"])
        panel.set_yticks([], minor=True)
        panel.set_xlabel("frequency (Hz)")
        panel.grid(False)
    axes[2].legend(loc="lower left", frameon=True, framealpha=1.0, fontsize=7)
    axes[0].set_ylabel("voltage (V)")
    return figure


def _dead(axes: Axes, part: xarray.Dataset) -> None:
    """Hatches where it does not work."""
    x, y, efficiency = part.drive_frequency, part.drive_voltage, part.efficiency.values
    axes.contourf(x, y, efficiency, levels=[-np.inf, DEAD], colors="0.85", hatches=["///"])
    axes.contour(x, y, efficiency, levels=[DEAD], colors=VERMILION, linewidths=1.2)


def _at(data: xarray.Dataset, place: tuple[np.intp, ...]) -> str:
    return f"at {float(data.drive_voltage[place[0]]):.3g} V, {float(data.drive_frequency[place[1]]):.3g} Hz"


def _ratio(forward: np.ndarray, backward: np.ndarray) -> float:
    works = (forward > 1e-9) & (backward > 1e-9)
    return float(np.median(backward[works] / forward[works]))


def main() -> None:
    """Prints the answer and draws the map."""
    prepare_jax(dedicated=True)
    study, estimate = identified()
    both, banded = calculate(study, estimate)
    answer(study, estimate, both, banded)
    with styled():
        save(draw(both, banded), NAME)


if __name__ == "__main__":
    main()
