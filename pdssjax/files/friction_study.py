"""Makes a study of records of a contact alone: force against displacement or velocity, as from a tribometer."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from ..core import InputError, member, quantities
from .channel_roles import Hints, Roles, friction_roles
from .new_study import distinct_names, head_lines, put_study, record_lines, scale_lines
from .record_columns import read_columns


@dataclasses.dataclass(frozen=True, eq=False)
class FrictionFile:
    """A file of a contact alone, and its samples."""

    name: str
    roles: Roles
    motion: Float[np.ndarray, " samples"]
    """The relative displacement [m], or velocity [m/s]."""
    force: Float[np.ndarray, " samples"]
    """[N], with its sign turned where it was counted against the motion."""
    turned: bool
    """Whether the sign of the force was turned."""

    @property
    def quantity(self) -> str:
        """Quantity of the motion in the file: "displacement" or "velocity"."""
        return self.roles.motion


def friction_file(file: Path, hints: Hints) -> FrictionFile | None:
    """The record of a contact alone in `file`; None where the file is of another kind.

    **Raises:** `InputError` with the option to give where a channel or a unit is ambiguous, or where the samples are at
    fault.
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
        # An offset of the sensor does no work in a closed motion.
        centred = force - 0.5 * (force.min() + force.max())
        work = np.sum(np.diff(motion) * (centred[1:] + centred[:-1]))
    turned = bool(work < 0)
    return FrictionFile(file.stem, roles, motion, -force if turned else force, turned)


def write_friction_study(files: Sequence[FrictionFile], folder: Path, title: str) -> Path:
    """Write `study.toml` and a figure of each record into `folder`, new or empty; return the path of the study.

    **Raises:** `InputError` if the folder is not empty, or if some files have a displacement and others a
    velocity.
    """
    from ..report.figures import friction_figure

    kinds = {file.quantity: file for file in files}
    if len(kinds) > 1:
        curve, loop = kinds["velocity"].roles.file, kinds["displacement"].roles.file
        raise InputError(
            f"{curve}: found a force against a velocity, and in {loop} one against a displacement, expected files of "
            "one kind: make a study of each."
        )
    names = distinct_names([file.name for file in files])
    pairs = zip(names, files, strict=True)
    figures = (friction_figure(name, file.motion, file.force, file.quantity) for name, file in pairs)
    return put_study(folder, friction_study_text(names, files, folder, title), names, figures)


def friction_study_text(names: Sequence[str], files: Sequence[FrictionFile], folder: Path, title: str) -> str:
    """The text of a study in `folder` of `files` of one kind; every guess has a comment."""
    is_curve = files[0].quantity == "velocity"
    if is_curve:
        measures, keys = "steady-friction", {"velocity": "velocity", "force": "force"}
        law, why = "stribeck", "a curve against the velocity alone"
    else:
        measures, keys = "friction", {"time": "time", "displacement": "motion", "force": "force"}
        law, why = "dahl", "the simplest one that shows presliding"
    needed = [field for field, declared in quantities(member("friction", law)).items() if not declared.optional]
    lines = [
        *head_lines(title),
        'piezo = "static"  # no record shows it, and none of its parameters is needed',
        f'friction = "{law}"  # guess: {why}; pdssjax models lists others',
        "",
        "[parameters]",
        *(f'"friction.{field}" = {{}}' for field in needed),
    ]
    for name, file in zip(names, files, strict=True):
        lines += ["", *record_lines(name, file.roles, folder, keys)]
        given = file.roles.layout.scales.get("force")
        lines += scale_lines(given, file.turned, "the force is counted against the motion")
        lines.append(f'measures = "{measures}"')
        if is_curve and (np.all(file.motion > 0) or np.all(file.motion < 0)):
            lines.append("offset = 0  # guess: the sensor's zero is right; in one direction no sample determines it")
    return "\n".join(lines) + "\n"
