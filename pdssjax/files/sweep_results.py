"""Writes a sweep: its dataset and its map."""

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

    A sweep of both directions has `directions.png`, too.
    """
    from ..report.figures import directions_figure, sweep_figure

    with staging_folder(folder) as staging:
        write_numbers(json.loads(data.attrs["parameters"]), staging)
        if store == "zarr":
            data.to_zarr(staging / "sweep.zarr", consolidated=False)
        else:
            data.to_netcdf(staging / "sweep.nc", engine="scipy")
        sweep_figure(data).savefig(staging / "sweep.png")
        if data.sizes.get("drive_direction") == 2:
            directions_figure(data).savefig(staging / "directions.png")


def check_store(store: str) -> None:
    """Refuse a format of `write_sweep` that cannot be written here."""
    if store == "zarr" and importlib.util.find_spec("zarr") is None:
        raise InputError('option --store: found zarr, which is not installed; expected netcdf, or "pip install zarr".')
