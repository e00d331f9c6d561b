"""Draws of a bootstrap or a posterior on the disk: line by line while a run makes them, and all of them as its result.

A run appends each draw to a file, so that an interrupted run can go on.  The first line identifies the run: study,
settings and fit.  Each line after it holds one entry as JSON, with numbers in full, and null where they are not finite.
Each line ends with a digest: of the first line, or of run and entry.  A line that was damaged, or came from another
run, does not match its digest, and its entry is drawn again.

The result is in SI.  A posterior goes to posterior.nc, in the groups that ArviZ expects:
`arviz.from_netcdf("posterior.nc")` opens it, as `xarray.open_datatree` does.  A bootstrap goes to bootstrap.csv, a
column a parameter.
"""

import contextlib
import hashlib
import importlib.util
import json
import os
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..core import Document, InputError, InputWarning
from ..study import Draws
from .json_text import finite_numbers
from .reading_process import Pairs, run_isolated
from .record_results import write_columns
from .results_folder import DRAWS, write_whole

FORMAT = "pdssjax-draws/5"


def holds_draws(folder: Path) -> bool:
    """Whether the `folder` has the draws of an unfinished run."""
    return (folder / DRAWS).exists()


class DrawsFile:
    """A store of draws (`inference.Store`) on the disk.

    Where the disk cannot be written to, the run goes on in memory alone, with one `InputWarning`: the fit and the draws
    still to be made are worth more than the file.

    **Arguments:** the `folder` of the results; `resume` reads the draws in its file.

    **Raises:** `InputError` where there is nothing to resume, or the file is none of draws.  Warns with `InputWarning`
    of lines that are left out, since they are damaged or of another run.
    """

    def __init__(self, folder: Path, resume: bool):
        self._file = folder / DRAWS
        self._begun: Document | None = None
        self._entries: list[Document] = []
        self._run = ""
        self._is_writable = True
        if resume:
            self._read()

    def __str__(self) -> str:
        return str(self._file)

    def begun(self) -> Document | None:
        return self._begun

    def begin(self, what: Document) -> None:
        """Write the first line, in place of an older file."""
        self._begun, self._entries = what, []
        head = {"format": FORMAT} | what
        self._run = _digest_of(head, "")
        self._write(_line(head, ""), anew=True)

    def kept(self) -> Sequence[Document]:
        return tuple(self._entries)

    def keep(self, entry: Document) -> None:
        """Append a line, which is on the disk when this returns unless a write has failed."""
        self._entries.append(entry)
        self._write(_line(finite_numbers(entry), self._run), anew=False)

    def _write(self, text: str, anew: bool) -> None:
        """Append `text`, or write the file `anew` with it alone."""
        # A line after a cut one would spoil the file, so that nothing is written after the first failure.
        if not self._is_writable:
            return
        try:
            if anew:
                self._file.parent.mkdir(parents=True, exist_ok=True)
                write_whole(self._file, text.encode())
                return
            with self._file.open("r+b") as lines:  # fails where somebody has removed the file
                lines.seek(0, os.SEEK_END)
                lines.write(text.encode())
                lines.flush()
                os.fsync(lines.fileno())
        except OSError as error:
            self._is_writable = False
            warnings.warn(
                f"{self._file}: cannot be written to ({error.strerror or error}); draws from now on are kept in memory "
                "alone, and lost if the run is broken off.",
                InputWarning,
                stacklevel=4,
            )

    def forget(self) -> None:
        """Remove the file of an earlier run, where there is one."""
        self._file.unlink(missing_ok=True)

    def _read(self) -> None:
        """Read the entries of an earlier run; drop an unfinished last line, and lines whose digest does not match."""
        try:
            text = self._file.read_text(encoding="utf-8", errors="replace")
        except FileNotFoundError:
            raise InputError(f"{self._file}: there is no such file, expected that of a run to go on with.") from None
        except OSError as error:
            raise InputError(f"{self._file}: cannot be read ({error}), expected that of a run to go on with.") from None
        whole = text[: text.rfind("\n") + 1]
        first, *rest = whole.splitlines(keepends=True) or [""]
        expected = "expected a file of draws that this version of pdssjax wrote"
        head = _parsed(first)
        if head is None or head.get("format") != FORMAT:
            raise InputError(f'{self._file}: line 1: found no "format": "{FORMAT}", {expected}.')
        if head.pop("digest", None) != _digest_of(head, ""):
            raise InputError(
                f"{self._file}: line 1: found content that does not match its digest, {expected}; begin anew without "
                "--resume."
            )
        self._begun, self._run = head, _digest_of(head, "")
        sound, damaged = [first], list[int]()
        for number, line in enumerate(rest, 2):
            entry = _parsed(line)
            if entry is None or entry.pop("digest", None) != _digest_of(entry, self._run):
                damaged.append(number)
            else:
                self._entries.append(entry)
                sound.append(line)
        if damaged:
            listed = ", ".join(map(str, damaged[:5])) + (", ..." if len(damaged) > 5 else "")
            warnings.warn(
                f"{self._file}: found {len(damaged)} lines that are damaged or of another run (line {listed}); their "
                "entries are drawn again.",
                InputWarning,
                stacklevel=4,
            )
        if damaged or text != whole:
            self._write("".join(sound), anew=True)


def _line(document: Document, run: str) -> str:
    """A line of the file, with its digest."""
    return json.dumps(document | {"digest": _digest_of(document, run)}) + "\n"


def _digest_of(document: Document, run: str) -> str:
    """The digest of a line of a `run`."""
    return hashlib.sha256(f"{run} {json.dumps(document, sort_keys=True)}".encode()).hexdigest()[:32]


def _parsed(line: str) -> Document | None:
    """The JSON object in a `line`; None where it is damaged."""
    with contextlib.suppress(ValueError, RecursionError):  # syntax; integers and nesting beyond what Python reads
        document: object = json.loads(line)
        return document if isinstance(document, dict) else None
    return None


_FILES = {"bootstrap": "bootstrap.csv", "posterior": "posterior.nc"}
"""In a folder of results, by the kind of the draws."""


def write_draws(draws: Draws, units: dict[str, str], folder: Path) -> None:
    """Write all draws to `folder`; `units` by path of the parameter."""
    if draws.kind == "bootstrap":
        headers = [f"{path} [{units[path]}]" if units[path] else path for path in draws.names]
        columns = dict(zip(headers, draws.values[0].T, strict=True))
        write_columns(folder / _FILES["bootstrap"], columns, "%.10g")
    else:
        _write_posterior(draws, units, folder / _FILES["posterior"])


def read_draws(estimate: Path, kind: str) -> tuple[tuple[str, ...], Float[np.ndarray, "draws p"]]:
    """The paths of the parameters that were drawn, and all draws [SI], beside an `estimate`, an estimate.json.

    **Arguments:** `kind` is "bootstrap" or "posterior".

    **Raises:** `InputError` where there are none, or the file cannot be read.
    """
    place = estimate.parent / _FILES[kind]
    if not place.exists():
        raise InputError(
            f"{place}: there is no such file, expected the draws of `pdssjax identify --intervals {kind}` beside the "
            "estimate."
        )
    try:
        if kind == "posterior":
            paths, columns = zip(*run_isolated(posterior_of, place), strict=True)
            return paths, np.stack(columns, axis=1)
        with place.open(encoding="utf-8") as lines:
            names = tuple(column.partition(" [")[0] for column in lines.readline().strip().split(","))
            return names, np.loadtxt(lines, delimiter=",", ndmin=2)
    except (OSError, ValueError, TypeError, KeyError) as error:
        reason = str(error).strip().partition("\n")[0]
        raise InputError(f"{place}: cannot be read ({reason}), expected the draws of pdssjax identify.") from None


def posterior_of(file: Path) -> Pairs:
    """The path of each parameter in a posterior, and its draws; runs in a process of its own."""
    import xarray

    with file.open("rb") as stream:
        grouped = stream.read(4) == b"\x89HDF"
    engine, group = ("h5netcdf", "posterior") if grouped else ("scipy", None)
    with xarray.open_dataset(file, engine=engine, group=group) as data:
        for name in data.data_vars:
            yield str(name), np.asarray(data[name], float).ravel()


def _write_posterior(draws: Draws, units: dict[str, str], file: Path) -> None:
    import xarray

    chains, each, _ = draws.values.shape
    coordinates = {"chain": np.arange(chains), "draw": np.arange(each)}
    attributes = {"inference_library": "pdssjax", "description": draws.description, "seed": draws.seed}
    drawn = {
        path: (("chain", "draw"), draws.values[:, :, i], {"units": units[path]}) for i, path in enumerate(draws.names)
    }
    posterior = xarray.Dataset(drawn, coordinates, attributes)
    if any(importlib.util.find_spec(package) is None for package in ("h5netcdf", "h5py")):
        # The older format has no groups; ArviZ takes the dataset once xarray has opened it.
        posterior.to_netcdf(file, engine="scipy")
        return
    # Booleans as in ArviZ's own files, in a type that every reader of the format knows.
    storable = lambda values: np.asarray(values, np.int8) if values.dtype == bool else values
    numbers = {name: (("chain", "draw"), storable(values)) for name, values in draws.statistics.items()}
    statistics = xarray.Dataset(numbers, coordinates, attributes)
    tree = xarray.DataTree.from_dict({"/posterior": posterior, "/sample_stats": statistics})
    tree.to_netcdf(file, engine="h5netcdf")
