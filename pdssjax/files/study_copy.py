"""Writes a copy of a study with other numbers: starts of free parameters, values of fixed ones, drives of records."""

import math
import os
import re
import tempfile
from collections.abc import Mapping
from pathlib import Path

import tomlkit

from ..core import Document, InputError
from .file_lock import UNFINISHED
from .study_toml import FORMAT, load_study, read_toml

_HEAD = "# Made by pdssjax explore from"


def save_study(
    source: Path,
    target: Path,
    values: Mapping[str, float],
    drives: Mapping[str, Mapping[str, float | str]],
    overwrite: bool = False,
) -> Path:
    """Write the study in `source` to `target` with other numbers, check that it loads, and return its absolute path.

    **Arguments:** `values` [SI] by the path of a parameter, which keeps its bounds and stays free or fixed; a parameter
    that was measured apart keeps its value.  `drives` by the name of a record: the changed fields of its drive, numbers
    in SI or words.  File names become relative to `target`.  All else, comments included, stays as written.

    **Raises:** `InputError` if `target` exists and `overwrite` is false or it is no study, if it is no .toml file or
    has no folder, or if the numbers make no legal study; nothing is written then.
    """
    target = Path(os.path.expanduser(target)).absolute()
    _check_target(source, target, overwrite)
    text = _text(source, target, values, drives)
    # Beside its place, so that relative paths lead to the same files once it has its name.
    handle, name = tempfile.mkstemp(".toml", UNFINISHED, target.parent)
    os.close(handle)
    copy = Path(name)
    try:
        copy.write_text(text, encoding="utf-8")
        copy.chmod(0o644)
        try:
            load_study(copy)
        except InputError as error:
            raise InputError(str(error).replace(str(copy), str(target))) from None
        if overwrite:
            copy.replace(target)
        else:
            try:
                os.link(copy, target)  # fails where a file has appeared meanwhile
            except FileExistsError:
                raise InputError(f"{target}: found a file there already, expected another name.") from None
            except OSError:  # a disk without links
                copy.rename(target)
    finally:
        copy.unlink(missing_ok=True)
    return target


def _check_target(source: Path, target: Path, overwrite: bool) -> None:
    try:
        os.stat(target)
    except ValueError:
        raise InputError(f"found {str(target)!r}, expected a name that a file can have.") from None
    except OSError:  # no file yet, or one of the checks below applies
        pass
    if target.suffix != ".toml":
        raise InputError(f'{target}: found a name that does not end in ".toml", expected that of a study.')
    if not target.parent.is_dir():
        raise InputError(f"{target}: there is no folder {target.parent}, expected one to write to.")
    if not target.exists():
        return
    if not overwrite:
        raise InputError(f"{target}: found a file there already, expected another name, or leave to replace it.")
    if target.samefile(source):
        raise InputError(f"{target}: found the study that is open, expected another name.")
    if not _is_study(target):
        raise InputError(f"{target}: found a file that is no study, expected another name: only a study is replaced.")


def _is_study(path: Path) -> bool:
    """Whether a file is a study, of any version of the format."""
    try:
        format_ = read_toml(path).get("format")
    except InputError:
        return False
    return isinstance(format_, str) and format_.startswith(FORMAT.partition("/")[0] + "/")


def _text(
    source: Path, target: Path, values: Mapping[str, float], drives: Mapping[str, Mapping[str, float | str]]
) -> str:
    before, known = source.read_text(encoding="utf-8-sig"), load_study(source).parameters
    document = tomlkit.parse(re.sub(rf"\A{re.escape(_HEAD)}.*\n", "", before))
    parameters: Document = document["parameters"]
    for path, number in values.items():
        listed = known.get(path)
        if listed is not None and listed.number is not None and math.isclose(listed.number, number, rel_tol=1e-12):
            continue  # stays as written, with its unit
        if path not in parameters:
            # An entry with a star has this parameter, and makes it free or fixed.
            parameters[path] = tomlkit.inline_table()
            parameters[path]["start" if listed is not None and listed.free else "value"] = number
        entry = parameters[path]
        if "standard_error" not in entry:  # a parameter that was measured apart keeps its value
            entry["value" if "value" in entry else "start"] = number
    for record in document.get("record", []):
        move_files(record, source.parent, target.parent)
        changed = drives.get(record.get("name", Path(record["file"]).stem), {})
        if changed:
            record["drive"].update(changed)
    return f"{_HEAD} {source.name}; numbers without a unit are in SI.\n{tomlkit.dumps(document)}"


def move_files(record: Document, before: Path, after: Path) -> None:
    """Make the file names of a `record`, relative to the folder `before`, relative to the folder `after`."""
    for table in (record, record.get("drive")):
        if isinstance(table, dict) and "file" in table and not Path(table["file"]).is_absolute():
            table["file"] = Path(os.path.relpath((before / table["file"]).absolute(), after.absolute())).as_posix()
