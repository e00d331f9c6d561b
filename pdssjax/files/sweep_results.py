"""Writes a sweep, or the border that one looked for: the dataset and its figures."""

import hashlib
import importlib.util
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core import InputError
from .record_results import write_numbers
from .results_folder import staging_folder

if TYPE_CHECKING:
    import xarray


def write_sweep(data: "xarray.Dataset", folder: Path, store: str) -> None:
    """Put a sweep's `xarray.Dataset` into `folder` as sweep.nc or sweep.zarr, with its map and `parameters.json`.

    A sweep of both directions has `directions.png`, too.  A single point has no map, one of each direction no figure
    beside it.
    """
    from ..report.figures import directions_figure, save_figure, sweep_figure
    from ..sweeps import ALONG

    with staging_folder(folder) as staging:
        _put(data, staging, "sweep", store)
        if data.sizes:
            save_figure(sweep_figure(data), staging / "sweep.png")
        if data.sizes.get(ALONG) == 2 and len(data.sizes) > 1:
            save_figure(directions_figure(data), staging / "directions.png")


def write_border(data: "xarray.Dataset", folder: Path, store: str) -> None:
    """Put what `find_border` found into `folder` as border.nc or border.zarr, drawn, with `parameters.json`."""
    from ..report.figures import border_figure, save_figure

    with staging_folder(folder) as staging:
        _put(data, staging, "border", store)
        save_figure(border_figure(data), staging / "border.png")


def _put(data: "xarray.Dataset", staging: Path, name: str, store: str) -> None:
    write_numbers(json.loads(data.attrs["parameters"]), staging)
    data = data.assign_attrs({_DIGEST: _digest(data)})
    if store == "zarr":
        # Only format 2 specifies consolidated metadata; without, whoever opens the store is warned.
        data.to_zarr(staging / f"{name}.zarr", zarr_format=2, consolidated=True)
    else:
        data.to_netcdf(staging / f"{name}.nc", engine="scipy")


_DIGEST = "digest"
"""The attribute with the digest of a dataset: neither format has checksums, and a flipped bit is another number."""


def _digest(data: "xarray.Dataset") -> str:
    """The digest of all numbers, names and attributes of `data`, the same before writing and after reading."""
    digest = hashlib.sha256(_plain({name: value for name, value in data.attrs.items() if name != _DIGEST}))
    for name in sorted(map(str, data.variables)):
        variable = data[name]
        values = np.asarray(variable.values)
        digest.update(_plain([name, variable.dims, variable.attrs]))
        # Formats keep integers in types of their own, and NaN has many forms.
        numbers = values.astype("<f8") if values.dtype.kind in "iufb" else values.astype(str)
        digest.update(
            np.where(numbers != numbers, np.nan, numbers).tobytes() if numbers.dtype.kind == "f" else _plain(numbers)
        )
    return digest.hexdigest()


def _plain(value: object) -> bytes:
    """A value as text that is the same for the same numbers, whatever their types."""
    as_number = lambda entry: np.asarray(entry).tolist() if hasattr(entry, "dtype") else str(entry)
    numbers = lambda entry: float(entry) if isinstance(entry, int | float | np.number) else entry
    if isinstance(value, dict):
        value = {name: numbers(entry) for name, entry in value.items()}
    return json.dumps(value, sort_keys=True, default=as_number).encode()


def check_store(store: str) -> None:
    """Refuse a format of `write_sweep` that cannot be written here."""
    if store == "zarr" and importlib.util.find_spec("zarr") is None:
        raise InputError('option --store: found zarr, which is not installed; expected netcdf, or "pip install zarr".')


def read_sweep(folder: Path) -> "xarray.Dataset":
    """The dataset that `write_sweep` put into `folder`, in memory.

    **Raises:** `InputError` where there is none, one that cannot be read, or one that was changed since.
    """
    import xarray

    engines = {"sweep.nc": "scipy", "sweep.zarr": "zarr"}
    held = [name for name in engines if (folder / name).exists()]
    if not held:
        raise InputError(f"{folder}: found no {' or '.join(engines)}, expected the results of pdssjax sweep.")
    try:
        with xarray.open_dataset(folder / held[0], engine=engines[held[0]]) as opened:
            data = opened.load()
    except Exception as error:  # what reads them raises errors of many types
        raise InputError(f"{folder / held[0]}: cannot be read ({error}), expected a sweep.") from None
    # Of an older version it has none.
    if data.attrs.get(_DIGEST, "") not in ("", _digest(data)):
        raise InputError(
            f"{folder / held[0]}: found numbers that do not match their digest, expected the file as pdssjax sweep "
            "wrote it; the sweep's command with --resume writes it again."
        )
    return data
