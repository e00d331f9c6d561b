"""Writes results to a folder: all of them or none, and never over others unasked."""

import contextlib
import csv
import importlib.util
import json
import math
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .characterise import Characterisation
from .display import display_unit
from .errors import InputError
from .estimate import FORMAT, Estimate, FittedRecord
from .report import format_report
from .virtual_rig import Recording, write_csv

CHARACTERISATION_FORMAT = "pdssjax-characterisation/1"
PARAMETERS_FORMAT = "pdssjax-parameters/1"

Numbers = dict[str, dict[str, Any]]
"""Value, unit and source of parameters by path, as `pdssjax.identified.numbers_used` tells them."""
_RESULTS = (
    "report.txt",
    "records",
    "predictions",
    "cycles.csv",
    "plots",
    "sweep.nc",
    "sweep.zarr",
    "sweep.png",
    "characterise.json",
    "parameters.json",
    "estimate.json",
)
"""What a folder of results may hold; the JSON file is moved in last, so where it is, all is."""


def check_free(folder: Path, overwrite: bool) -> None:
    """See, before any work is spent, that results can go to `folder`.

    **Raises:** `InputError` if it holds results and `overwrite` is false, or cannot be written to.
    """
    held = [name for name in _RESULTS if (folder / name).exists()]
    if held and not overwrite:
        raise InputError(
            f"{folder}: found results already ({', '.join(held)}); expected another folder, or --overwrite."
        )
    ground = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    if not ground.is_dir():
        raise InputError(f"{folder}: found a file at {ground}, expected a folder or nothing.")
    if not os.access(ground, os.W_OK | os.X_OK):
        raise InputError(f"{folder}: found no permission to write to {ground}, expected a folder to write to.")


def write_estimate(estimate: Estimate, folder: Path) -> None:
    """Put `estimate.json`, `report.txt`, plots and predictions into `folder`, in place of older ones."""
    from .plot import correlation_figure, error_figure

    with _staged(folder) as stage:
        _write_essentials(estimate, stage)
        _write_records(estimate.records, stage)
        if len(estimate.names) > 1:
            correlation_figure(estimate).savefig(stage / "plots" / "correlations.png")
        error_figure(estimate).savefig(stage / "plots" / "standard_errors.png")


def write_essentials(estimate: Estimate, folder: Path) -> None:
    """Put only `estimate.json` and `report.txt` into `folder`, in place of older results."""
    with _staged(folder) as stage:
        _write_essentials(estimate, stage)


def _write_essentials(estimate: Estimate, stage: Path) -> None:
    (stage / "estimate.json").write_text(estimate_json(estimate), encoding="utf-8")
    (stage / "report.txt").write_text(format_report(estimate), encoding="utf-8")


def estimate_json(estimate: Estimate) -> str:
    """What `estimate.json` holds."""
    return _json(_document(estimate))


def _json(document: Any) -> str:
    return json.dumps(_finite(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def write_predictions(records: Sequence[FittedRecord], used: Numbers, folder: Path) -> None:
    """Put the plot and the prediction of each record into `folder`, in place of older results.

    With them `parameters.json`, the numbers `used`.
    """
    with _staged(folder) as stage:
        _write_numbers(used, stage)
        _write_records(records, stage)


def _write_numbers(used: Numbers, stage: Path) -> None:
    text = _json({"format": PARAMETERS_FORMAT, "parameters": used})
    (stage / "parameters.json").write_text(text, encoding="utf-8")


def write_recordings(
    made: Sequence[Recording],
    compared: Sequence[FittedRecord],
    truth: dict[str, Any],
    used: Numbers,
    study: Path,
    folder: Path,
) -> None:
    """Put the CSV files of a virtual rig, the study that describes them, and what went in into `folder`.

    With them `parameters.json`, the numbers `used`.

    **Raises:** `InputError` where the study's records are to lie outside its folder.
    """
    places = [one.record.file.relative_to(study.parent) if _beside(one.record.file, study) else None for one in made]
    for place, one in zip(places, made, strict=True):
        if place is None:
            raise InputError(
                f'{study}: record "{one.record.name}": found {one.record.file}, expected a file beside it.'
            )
    with _staged(folder) as stage:
        _write_numbers(used, stage)
        _write_records(compared, stage)
        for place, one in zip(places, made, strict=True):
            write_csv(one, stage / "records" / str(place))
        shutil.copyfile(study, stage / "records" / study.name)
        (stage / "records" / "truth.json").write_text(_json(truth), encoding="utf-8")


def _beside(file: Path, study: Path) -> bool:
    return file.is_relative_to(study.parent) and ".." not in file.relative_to(study.parent).parts


def write_sweep(data: Any, folder: Path, store: str) -> None:
    """Put a sweep's `xarray.Dataset` into `folder` as sweep.nc or sweep.zarr, with its map and `parameters.json`."""
    from .plot_sweep import sweep_figure

    with _staged(folder) as stage:
        _write_numbers(json.loads(data.attrs["parameters"]), stage)
        if store == "zarr":
            data.to_zarr(stage / "sweep.zarr", consolidated=False)
        else:
            data.to_netcdf(stage / "sweep.nc", engine="scipy")
        sweep_figure(data).savefig(stage / "sweep.png")


def check_store(store: str) -> None:
    """Refuse a format of `write_sweep` that cannot be written here."""
    if store == "zarr" and importlib.util.find_spec("zarr") is None:
        raise InputError('option --store: found zarr, which is not installed; expected netcdf, or "pip install zarr".')


def write_characterisations(found: Sequence[Characterisation], folder: Path) -> None:
    """Put `characterise.json`, `cycles.csv` and a plot of each record into `folder`, in place of older results."""
    from .plot import cycle_figure

    stems = _stems(found)
    with _staged(folder) as stage:
        (stage / "plots").mkdir()
        for stem, one in zip(stems, found, strict=True):
            cycle_figure(one).savefig(stage / "plots" / f"{stem}.png")
        _write_cycles(dict(zip(stems, found, strict=True)), stage / "cycles.csv")
        document = {"format": CHARACTERISATION_FORMAT, "records": [_record_document(one) for one in found]}
        (stage / "characterise.json").write_text(_json(document), encoding="utf-8")


def _write_cycles(found: dict[str, Characterisation], file: Path) -> None:
    """A row a cycle, in display units; cells stay empty where a record has no such figure."""
    units = {name: summary.unit for one in found.values() for name, summary in one.summary.items()}
    names = list(dict.fromkeys(name for one in found.values() for name in one.metrics))
    shown = {name: display_unit(units[name]) for name in names}
    titles = [f"{name}_{unit}" if unit else name for name, (unit, _) in shown.items()]
    with file.open("w", newline="", encoding="utf-8") as stream:
        table = csv.writer(stream, lineterminator="\n")
        table.writerow(["record", "cycle", "start_s", *titles])
        for stem, one in found.items():
            for index in range(one.cycles.count):
                start = one.cycles.start + index / one.cycles.frequency
                cells = [one.metrics[n][index] * shown[n][1] if n in one.metrics else None for n in names]
                written = ["" if cell is None else f"{cell:.6g}" for cell in cells]
                table.writerow([stem, index + 1, f"{start:.9g}", *written])


def _record_document(one: Characterisation) -> dict[str, Any]:
    """One record of `characterise.json`, in SI."""
    cycles = one.cycles
    return {
        "file": str(one.file),
        "measures": one.measures,
        "column": one.column,
        "samples": len(one.time),
        "from": float(one.time[0]),
        "to": float(one.time[-1]),
        "direction": "backward" if cycles.falls else "forward",
        "frequency": {"used": cycles.frequency, "given": one.given, "seen": cycles.seen, "error": cycles.seen_error},
        "cycles": {"complete": cycles.count, "left_out": cycles.rejected, "start": cycles.start},
        "sawtooth_fit": cycles.fit,
        "slip_duration": one.slip_duration,
        "figures": {name: vars(summary) for name, summary in one.summary.items()},
    }


def write_aside(write: Callable[[Path], None]) -> Path:
    """A new folder for temporary files, in which `write` has put what it writes.

    **Raises:** `OSError` where that fails, too; then nothing is left behind.
    """
    folder = Path(tempfile.mkdtemp(prefix="pdssjax-"))
    try:
        write(folder)
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    return folder


@contextlib.contextmanager
def _staged(folder: Path) -> Iterator[Path]:
    """A hidden folder inside `folder`, whose contents move up once all of them are written."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=folder) as temporary:
        stage = Path(temporary)
        yield stage
        for name in reversed(_RESULTS):
            _remove(folder / name)
        for name in _RESULTS:
            if (stage / name).exists():
                (stage / name).rename(folder / name)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _write_records(records: Sequence[FittedRecord], stage: Path) -> None:
    from .plot import record_figure

    (stage / "predictions").mkdir()
    (stage / "plots").mkdir()
    for stem, record in zip(_stems(records), records, strict=True):
        unit, scale = display_unit(record.unit)
        table = np.column_stack([record.measured, record.predicted, record.measured - record.predicted])
        np.savetxt(
            stage / "predictions" / f"{stem}.csv",
            np.column_stack([record.time, scale * table]),
            fmt=("%.9g", "%.6f", "%.6f", "%.6f"),
            delimiter=",",
            header=f"time_s,measured_{unit},predicted_{unit},residual_{unit}",
            comments="",
        )
        record_figure(record).savefig(stage / "plots" / f"{stem}.png")


def _stems(records: Sequence[FittedRecord] | Sequence[Characterisation]) -> list[str]:
    """File names after the records' own, different from each other on any file system."""
    stems: list[str] = []
    for record in records:
        plain = re.sub(r"[^\w.-]+", "_", record.name).strip("._") or "record"
        taken = [stem.lower() for stem in [*stems, "correlations", "standard_errors"]]
        copies = (f"{plain}-{number}" for number in range(2, len(taken) + 2))
        stems.append(next(stem for stem in (plain, *copies) if stem.lower() not in taken))
    return stems


def _document(estimate: Estimate) -> dict[str, Any]:
    """What `estimate.json` holds, in SI."""
    parameters: dict[str, Any] = {}
    for path, parameter in estimate.parameters.items():
        parameters[path] = {
            "value": parameter.value,
            "standard_error": parameter.standard_error,
            "interval": parameter.interval,
            "unit": parameter.unit,
            "free": parameter.free,
            "start": parameter.start,
            "at_bound": parameter.at_bound,
            "informed": parameter.informed,
        }
        if estimate.method == "sequential":
            parameters[path]["naive_standard_error"] = parameter.naive_standard_error
    keys = "name role samples r2 error_index rmse noise offset offset_standard_error simulated measures".split()
    keys += ["noise_estimated", "noise_floor", "chi2", "reduced_chi2"]
    return {
        "format": FORMAT,
        "title": estimate.title,
        "method": estimate.method,
        "converged": estimate.converged,
        "message": estimate.message,
        "parameters": parameters,
        "correlation": {"names": estimate.names, "matrix": estimate.correlation},
        "covariance": {"names": estimate.names, "matrix": estimate.covariance},
        "records": [{key: getattr(record, key) for key in keys} for record in estimate.records],
        "statistics": vars(estimate.statistics),
        "notes": estimate.notes,
        "seconds": estimate.seconds,
    }


def _finite(value: Any) -> Any:
    """`value` with arrays as lists and with None for what JSON has no number for."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
