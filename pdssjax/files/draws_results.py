"""Writes the draws of a bootstrap or a posterior, all of them, in SI.

A posterior goes to posterior.nc, in the groups that ArviZ expects: `arviz.from_netcdf("posterior.nc")` opens it, as
`xarray.open_datatree` does.  A bootstrap goes to bootstrap.csv, a column a parameter.
"""

import importlib.util
from pathlib import Path

import numpy as np

from ..study import Draws


def write_draws(draws: Draws, units: dict[str, str], folder: Path) -> None:
    """Put all draws into `folder`; `units` by path of the parameter."""
    if draws.kind == "bootstrap":
        head = ",".join(f"{path} [{units[path]}]" if units[path] else path for path in draws.names)
        np.savetxt(folder / "bootstrap.csv", draws.values[0], "%.10g", ",", header=head, comments="")
    else:
        _write_posterior(draws, units, folder / "posterior.nc")


def _write_posterior(draws: Draws, units: dict[str, str], file: Path) -> None:
    import xarray

    chains, each, _ = draws.values.shape
    coordinates = {"chain": np.arange(chains), "draw": np.arange(each)}
    about = {"inference_library": "pdssjax", "description": draws.description, "seed": draws.seed}
    posterior = xarray.Dataset(
        {
            path: (("chain", "draw"), draws.values[:, :, i], {"units": units[path]})
            for i, path in enumerate(draws.names)
        },
        coordinates,
        about,
    )
    if any(importlib.util.find_spec(package) is None for package in ("h5netcdf", "h5py")):
        # Without groups, which the older format has not; ArviZ takes the dataset once xarray has opened it.
        posterior.to_netcdf(file, engine="scipy")
        return
    numbers = {name: (("chain", "draw"), _plain(values)) for name, values in draws.statistics.items()}
    statistics = xarray.Dataset(numbers, coordinates, about)
    tree = xarray.DataTree.from_dict({"/posterior": posterior, "/sample_stats": statistics})
    tree.to_netcdf(file, engine="h5netcdf")


def _plain(values: np.ndarray) -> np.ndarray:
    """A type that every reader of the format knows: truth values as they are in ArviZ's own files."""
    return np.asarray(values, np.int8) if values.dtype == bool else values
