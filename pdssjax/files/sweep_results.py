"""Writes a sweep, or the border that one looked for: the dataset and its figures."""

import importlib.util
import json
from pathlib import Path
from typing import TYPE_CHECKING

from ..core import InputError
from .prediction_results import write_numbers
from .results_folder import staging_folder

if TYPE_CHECKING:
    import xarray


def write_sweep(data: "xarray.Dataset", folder: Path, store: str) -> None:
    """Put a sweep's `xarray.Dataset` into `folder` as sweep.nc or sweep.zarr, with its map and `parameters.json`.

    A sweep of both directions has `directions.png`, too.  A single point has no map, one of each direction no figure
    beside it.
    """
    from ..report.figures import directions_figure, sweep_figure
    from ..sweeps import ALONG

    with staging_folder(folder) as staging:
        _put(data, staging, "sweep", store)
        if data.sizes:
            sweep_figure(data).savefig(staging / "sweep.png")
        if data.sizes.get(ALONG) == 2 and len(data.sizes) > 1:
            directions_figure(data).savefig(staging / "directions.png")


def write_border(data: "xarray.Dataset", folder: Path, store: str) -> None:
    """Put what `find_border` found into `folder` as border.nc or border.zarr, drawn, with `parameters.json`."""
    from ..report.figures import border_figure

    with staging_folder(folder) as staging:
        _put(data, staging, "border", store)
        border_figure(data).savefig(staging / "border.png")


def _put(data: "xarray.Dataset", staging: Path, name: str, store: str) -> None:
    write_numbers(json.loads(data.attrs["parameters"]), staging)
    if store == "zarr":
        # Only format 2 specifies consolidated metadata; without, whoever opens the store is warned.
        data.to_zarr(staging / f"{name}.zarr", zarr_format=2, consolidated=True)
    else:
        data.to_netcdf(staging / f"{name}.nc", engine="scipy")


def check_store(store: str) -> None:
    """Refuse a format of `write_sweep` that cannot be written here."""
    if store == "zarr" and importlib.util.find_spec("zarr") is None:
        raise InputError('option --store: found zarr, which is not installed; expected netcdf, or "pip install zarr".')


def read_sweep(folder: Path) -> "xarray.Dataset":
    """The dataset that `write_sweep` put into `folder`, in memory.

    **Raises:** `InputError` where there is none, or one that cannot be read.
    """
    import xarray

    engines = {"sweep.nc": "scipy", "sweep.zarr": "zarr"}
    held = [name for name in engines if (folder / name).exists()]
    if not held:
        raise InputError(f"{folder}: found no {' or '.join(engines)}, expected the results of pdssjax sweep.")
    try:
        with xarray.open_dataset(folder / held[0], engine=engines[held[0]]) as data:
            return data.load()
    except Exception as error:  # what reads them raises errors of many types
        raise InputError(f"{folder / held[0]}: cannot be read ({error}), expected a sweep.") from None
