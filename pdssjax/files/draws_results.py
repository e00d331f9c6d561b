"""Writes the draws of a bootstrap or a posterior, all of them, in SI, and reads them again.

A posterior goes to posterior.nc, in the groups that ArviZ expects: `arviz.from_netcdf("posterior.nc")` opens it, as
`xarray.open_datatree` does.  A bootstrap goes to bootstrap.csv, a column a parameter.
"""

import importlib.util
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..core import InputError
from ..study import Draws
from .reading_process import Pairs, answers

FILES = {"bootstrap": "bootstrap.csv", "posterior": "posterior.nc"}
"""In a folder of results, by the kind of the draws."""


def write_draws(draws: Draws, units: dict[str, str], folder: Path) -> None:
    """Put all draws into `folder`; `units` by path of the parameter."""
    if draws.kind == "bootstrap":
        head = ",".join(f"{path} [{units[path]}]" if units[path] else path for path in draws.names)
        file = folder / FILES["bootstrap"]
        np.savetxt(file, draws.values[0], "%.10g", ",", header=head, comments="", encoding="utf-8")
    else:
        _write_posterior(draws, units, folder / FILES["posterior"])


def read_draws(estimate: Path, kind: str) -> tuple[tuple[str, ...], Float[np.ndarray, "draws p"]]:
    """The paths of the parameters that were drawn, and all draws [SI], beside an `estimate`, an estimate.json.

    **Arguments:** `kind` is "bootstrap" or "posterior".

    **Raises:** `InputError` where there are none, or the file cannot be read.
    """
    place = estimate.parent / FILES[kind]
    if not place.exists():
        raise InputError(
            f"{place}: there is no such file, expected the draws of `pdssjax identify --intervals {kind}` beside the "
            "estimate."
        )
    try:
        return (_read_bootstrap if kind == "bootstrap" else _read_posterior)(place)
    except (OSError, ValueError, TypeError, KeyError) as error:
        told = str(error).strip().partition("\n")[0]
        raise InputError(f"{place}: cannot be read ({told}), expected the draws of pdssjax identify.") from None


def _read_bootstrap(file: Path) -> tuple[tuple[str, ...], Float[np.ndarray, "draws p"]]:
    with file.open(encoding="utf-8") as lines:
        names = tuple(column.partition(" [")[0] for column in lines.readline().strip().split(","))
        return names, np.loadtxt(lines, delimiter=",", ndmin=2)


def _read_posterior(file: Path) -> tuple[tuple[str, ...], Float[np.ndarray, "draws p"]]:
    names, columns = zip(*answers(posterior_of, file), strict=True)
    return names, np.stack(columns, axis=1)


def posterior_of(file: Path) -> Pairs:
    """The path of each parameter in a posterior, and its draws; asked of another process."""
    import xarray

    with file.open("rb") as begin:
        grouped = begin.read(4) == b"\x89HDF"
    engine, group = ("h5netcdf", "posterior") if grouped else ("scipy", None)
    with xarray.open_dataset(file, engine=engine, group=group) as data:
        for name in data.data_vars:
            yield str(name), np.asarray(data[name], float).ravel()


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
