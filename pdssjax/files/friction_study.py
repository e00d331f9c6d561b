"""Makes a study of records of a contact alone: force against displacement or velocity, as a tribometer writes them."""

import dataclasses
import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..core import InputError, member, quantities
from .channel_roles import Hints, Roles, friction_roles
from .record_columns import read_columns
from .results_folder import check_empty
from .toml_table import quoted

_LAWS = {"displacement": "dahl", "velocity": "stribeck"}
"""The law of a new study, by the motion that its records have."""

_WHY = {
    "displacement": "the simplest one that shows presliding; pdssjax models lists others",
    "velocity": "a curve against the velocity alone; pdssjax models lists others",
}


@dataclasses.dataclass(frozen=True, eq=False)
class FrictionFile:
    """A file of a contact alone, and what its samples suggest."""

    name: str
    roles: Roles
    motion: Float[np.ndarray, " samples"]
    """The relative displacement [m], or velocity [m/s]."""
    force: Float[np.ndarray, " samples"]
    """[N], turned where it was counted against the motion."""
    turned: bool
    """Whether the force was given the other sign."""

    @property
    def quantity(self) -> str:
        """Quantity of the motion in the file: "displacement" or "velocity"."""
        return self.roles.motion


def friction_file(file: Path, hints: Hints) -> FrictionFile | None:
    """What `file` suggests for a record of a contact alone; None where it is not one.

    **Raises:** `InputError` where a channel or a unit is not clear, with the option that tells it, or where the
    samples are at fault.
    """
    roles = friction_roles(file, hints)
    if roles is None:
        return None
    columns = read_columns(file, roles.layout)
    columns.check_numbers()
    motion, force = columns.data[roles.motion], columns.data["force"]
    if force.size < 16:
        raise InputError(f"{file}: found {force.size} samples, expected a record of 16 at least.")
    if roles.motion == "velocity":
        work = np.sum(motion * force)
    else:
        # A zero of the sensor does no work in a motion to and fro.
        about = force - 0.5 * (force.min() + force.max())
        work = np.sum(np.diff(motion) * (about[1:] + about[:-1]))
    turned = bool(work < 0)
    return FrictionFile(file.stem, roles, motion, -force if turned else force, turned)


def write_friction_study(files: Sequence[FrictionFile], folder: Path, title: str) -> Path:
    """Write `study.toml` and a figure of each record into `folder`, which must be new or empty; the study's path.

    **Raises:** `InputError` if the folder holds something already, or if some files have a displacement and others a
    velocity.
    """
    from ..report.figures import friction_figure, save_figure

    kinds = {file.quantity: file for file in files}
    if len(kinds) > 1:
        curve, loop = kinds["velocity"].roles.file, kinds["displacement"].roles.file
        raise InputError(
            f"{curve}: found a force against a velocity, and in {loop} one against a displacement, expected files of "
            "one kind: make a study of each."
        )
    check_empty(folder)
    (folder / "check").mkdir(parents=True)
    names = _names(files)
    for name, file in zip(names, files, strict=True):
        figure = friction_figure(name, file.motion, file.force, file.quantity)
        stem = re.sub(r"[^\w.-]+", "_", name)
        save_figure(figure, folder / "check" / f"{stem}.png")
    path = folder / "study.toml"
    path.write_text(friction_study_text(names, files, folder, title), encoding="utf-8")
    return path


def friction_study_text(names: Sequence[str], files: Sequence[FrictionFile], folder: Path, title: str) -> str:
    """The study file of some `files` of one kind, as it stands in `folder`; every guess has a comment that says so."""
    quantity = files[0].quantity
    law = _LAWS[quantity]
    needed = [field for field, declared in quantities(member("friction", law)).items() if not declared.optional]
    lines = [
        "# Made by pdssjax new: what is marked as a guess was read off the samples; check/ shows it.",
        'format = "pdssjax-study/1"',
        f"title = {quoted(title)}",
        "",
        "[actuator]",
        'piezo = "static"  # no record shows it, and none of its parameters is needed',
        f'friction = "{law}"  # guess: {_WHY[quantity]}',
        "",
        "[parameters]",
        *(f'"friction.{field}" = {{}}' for field in needed),
    ]
    for name, file in zip(names, files, strict=True):
        lines += ["", *_record(name, file, folder)]
    return "\n".join(lines) + "\n"


def _names(files: Sequence[FrictionFile]) -> list[str]:
    """Names that differ, made of those of the files."""
    made: list[str] = []
    for file in files:
        name, number = file.name, 2
        while name.casefold() in [other.casefold() for other in made]:
            name, number = f"{file.name} {number}", number + 1
        made.append(name)
    return made


def _record(name: str, file: FrictionFile, folder: Path) -> list[str]:
    layout, curve = file.roles.layout, file.quantity == "velocity"
    key = lambda quantity: "motion" if quantity == "displacement" else quantity
    value = lambda given: quoted(given) if isinstance(given, str) else f"{given:g}"
    columns = {q: c for q, c in layout.columns.items() if not (curve and q == "time")}
    listed = ", ".join(f"{key(quantity)} = {value(name)}" for quantity, name in columns.items())
    guessed = sorted(file.roles.by_shape & set(columns))
    told = f"  # guess: {', '.join(guessed)} told by the samples and names" if guessed else ""
    lines = [
        "[[record]]",
        f"name = {quoted(name)}",
        f"file = {quoted(Path(os.path.relpath(file.roles.file, folder)).as_posix())}",
        f"columns = {{ {listed} }}{told}",
    ]
    if layout.interval is not None and not curve:
        lines.append(f'time = {{ interval = "{layout.interval:.9g} s" }}')
    units = {key(q): unit for q, unit in layout.units.items() if q in columns}
    if units:
        lines.append("units = { " + ", ".join(f"{q} = {quoted(unit)}" for q, unit in units.items()) + " }")
    if layout.decimal:
        lines.append(f"decimal = {quoted(layout.decimal)}")
    given = layout.scales.get("force")
    if file.turned:
        lines.append(f"scale = {value(_turned(given))}  # guess: the force is counted against the motion")
    elif given is not None:
        lines.append(f"scale = {value(given)}")
    lines.append(f'measures = "{"steady-friction" if curve else "friction"}"')
    if curve and (np.all(file.motion > 0) or np.all(file.motion < 0)):
        lines.append("offset = 0  # guess: the sensor's zero is right; in one direction no sample tells it")
    return lines


def _turned(given: float | str | None) -> float | str:
    """The scale that was `given`, with the other sign."""
    if isinstance(given, str):
        return given.strip()[1:] if given.strip().startswith("-") else f"-{given.strip().lstrip('+')}"
    return -1 if given is None else -given
