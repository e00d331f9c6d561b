"""How sure is a speed, given what the records say of the parameters: to first order, and by draws?

The packaged example is identified, and its forward speed asked for along two cuts of the map (`experiments.map`): over
the frequency at 30 V, and over the voltage at 80 Hz up to where it stops working.  Bands to first order take 37
simulations a point, draws of the parameters 4000; where the speed bends or breaks within what is not known the first
cannot be right, and says so.  Killed, it goes on where it was.

    python -m experiments.bands
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import xarray
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.common import BLUE, OUT, VERMILION, Row, print_table, save, styled
from experiments.example_fit import draws, identified
from pdssjax import Study, prepare_jax, sweep
from pdssjax.files import SweepStore
from pdssjax.sweeps import DEAD, Crossed, Grid, SigmaPoints, with_bands

NAME = "bands"
CUTS = {
    "frequency": {"drive.voltage": np.array([30.0]), "drive.frequency": np.geomspace(2.0, 400.0, 16)},
    "voltage": {"drive.voltage": np.linspace(4.0, 40.0, 13), "drive.frequency": np.array([80.0])},
}
"""Of the map, by what runs along them."""
DRAWS = 4000


def calculate(
    study: Study,
    estimate: Path,
    cuts: Mapping[str, Mapping[str, np.ndarray]] = CUTS,
    count: int = DRAWS,
    workers: int | None = None,
) -> dict[str, tuple[xarray.Dataset, xarray.Dataset]]:
    """By cut, its bands to first order and those by draws, without the dimension that does not run."""
    about = draws(study, estimate, count)
    found = {}
    for along, axes in cuts.items():
        pair = []
        for kind, points in (("linear", SigmaPoints(about)), ("draws", about)):
            store = SweepStore(OUT / NAME / f"{along}_{kind}.zarr", resume=True)
            data = sweep(study, Crossed(Grid(axes), points), cycles="steady", store=store, workers=workers)
            pair.append(with_bands(data).squeeze(drop=True))
        found[along] = (pair[0], pair[1])
    return found


def compare(found: Mapping[str, tuple[xarray.Dataset, xarray.Dataset]]) -> list[Row]:
    """How well the two agree, where first order is said to hold and where not."""
    rows = []
    for along, (linear, drawn) in found.items():
        works = ((linear.efficiency > DEAD) & (drawn.efficiency_low > DEAD)).values
        ratio = (linear.speed_sd / drawn.speed_sd).values
        holds = linear.speed_straight.values == 1
        width = (50.0 * (linear.speed_high - linear.speed_low) / abs(linear.speed)).values
        rows += [
            Row(f"along the {along}: half the 95 % band", None, _range(width[works]), "% of the speed"),
            Row("sd to first order by that of draws, where it holds", None, _range(ratio[works & holds]), "1"),
            Row("points where it is said not to hold", None, f"{int((~holds).sum())} of {holds.size}"),
            Row("the same ratio there", None, _range(ratio[~holds]), "1"),
        ]
    return rows


def draw(found: Mapping[str, tuple[xarray.Dataset, xarray.Dataset]]) -> Figure:
    """Both cuts with both bands; below, what half a band is of the speed."""
    figure = Figure(figsize=(8.6, 5.4), layout="constrained")
    axes = figure.subplots(2, len(found), sharex="col", height_ratios=[2, 1], squeeze=False)
    for column, (along, (linear, drawn)) in zip(axes.T, found.items(), strict=True):
        name, label = f"drive_{along}", {"frequency": "frequency (Hz)", "voltage": "voltage (V)"}[along]
        x = linear[name].values
        _banded(column[0], x, linear, drawn)
        column[0].set_title({"frequency": "at 30 V", "voltage": "at 80 Hz"}[along], loc="left")
        for data, colour, style in ((linear, BLUE, "-"), (drawn, VERMILION, "--")):
            half = 50.0 * (data.speed_high - data.speed_low) / abs(data.speed)
            column[1].plot(x, half.where(linear.efficiency > DEAD), style, color=colour)
        if along == "voltage":
            column[1].set_yscale("log")
        else:
            column[1].set_ylim(bottom=0.0)
        column[1].set_ylabel("half the band\n(% of the speed)")
        column[1].set_xlabel(label)
        column[0].set_ylabel("speed (µm/s)")
        if along == "frequency":
            column[0].set_yscale("log")
            column[0].set_xscale("log")
    axes[0, 0].legend(loc="best", fontsize=8)
    return figure


def _banded(axes: Axes, x: np.ndarray, linear: xarray.Dataset, drawn: xarray.Dataset) -> None:
    axes.fill_between(x, 1e6 * linear.speed_low, 1e6 * linear.speed_high, color=BLUE, alpha=0.3, lw=0)
    axes.plot(x, 1e6 * linear.speed, ".-", color=BLUE, label="identified, 95 % band to first order")
    for end in ("low", "high"):
        label = f"95 % of {DRAWS} draws" if end == "low" else None
        axes.plot(x, 1e6 * drawn[f"speed_{end}"], "--", color=VERMILION, lw=1.0, label=label)
    bent = (linear.speed_straight == 0).values
    axes.plot(x[bent], 1e6 * linear.speed.values[bent], "x", color="k", label="first order is said not to hold")


def _range(values: np.ndarray) -> str:
    known = values[np.isfinite(values)]
    return f"{known.min():.3g} to {known.max():.3g}" if known.size else "-"


def main() -> None:
    """Prints how well the two agree and draws both."""
    prepare_jax(dedicated=True)
    study, estimate = identified()
    found = calculate(study, estimate)
    note = "Draws: 4000 a point, the same at all points; their own standard deviation is known to 1 to 3 %."
    print_table("Bands of the identified example", compare(found), NAME, [note])
    with styled():
        save(draw(found), NAME)


if __name__ == "__main__":
    main()
