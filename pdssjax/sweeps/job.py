"""A sweep as plain data: all that the computation of a block needs but its points.

Text crosses to other processes and machines in place of modules and compiled functions, and tells sweeps apart:
two of one text and of the same points find the same numbers.
"""

import dataclasses
import importlib.metadata
import json
from numbers import Integral

from ..core import MOST_DRAWN, Document, InputError, choices, member, member_name, members, quantities
from ..integration import Accuracy, Taylor
from ..study import Models
from .cycles.base import AbstractCycle
from .cycles.numbered import Numbered
from .cycles.steady import Steady
from .point import PointFunction

FORMAT = "pdssjax-sweep/1"


def package_version() -> str:
    """The version of pdssjax that is installed; empty where it only lies on the path."""
    try:
        return importlib.metadata.version("pdssjax")
    except importlib.metadata.PackageNotFoundError:
        return ""


def measured_cycle(cycles: int | str) -> AbstractCycle:
    """The cycle that `sweep(cycles=...)` asks for: a number, or "steady".

    **Raises:** `InputError` for anything else.
    """
    if cycles == "steady":
        return Steady()
    # An integer of NumPy is one, too.
    if isinstance(cycles, bool | str) or not isinstance(cycles, Integral) or not 1 <= int(cycles) <= MOST_DRAWN:
        raise InputError(f'sweep: found cycles = {cycles!r:.80}, expected a number of at least 1, or "steady".')
    return Numbered(int(cycles))


def job_document(function: PointFunction) -> Document:
    """`function` as plain data: members by name, numbers by path or field, in SI."""
    models, drive = function.models, function.drive
    numbers = {field: float(getattr(drive, field)) for field in [*quantities(type(drive)), *choices(type(drive))]}
    # Left out where nothing is asked for, so that stores from before there was anything to ask are those of this sweep.
    asked = {"further": list(function.further), "derivatives": list(function.by)}
    return {name: list(of) for name, of in asked.items() if of} | {
        "format": FORMAT,
        "pdssjax": package_version(),
        "actuator": models.chosen | {"parts": sorted(models.parts)},
        "drive": {"waveform": member_name(type(drive)), **numbers},
        "parameters": {path: float(number) for path, number in function.numbers.items()},
        "paths": list(function.paths),
        "cycles": function.cycle.described,
        "accuracy": _accuracy_document(function.accuracy),
        "metrics": list(function.columns),
    }


def point_function(document: Document) -> PointFunction:
    """What `document` describes; `job_document` the other way round."""
    actuator, drive, accuracy = document["actuator"], dict(document["drive"]), dict(document["accuracy"])
    models = Models(
        member("piezo", actuator["piezo"]),
        member("friction", actuator["friction"]),
        actuator["friction_state"],
        actuator["feedback"],
        frozenset(actuator["parts"]),
        actuator.get("rests_under_load", False),
    )
    waveform = member("drive", drive.pop("waveform"))
    order = accuracy.pop("method")["order"]
    return PointFunction(
        models,
        waveform(**drive),
        tuple(document["paths"]),
        document["parameters"],
        measured_cycle(document["cycles"]),
        Accuracy(method=Taylor(order), **accuracy),
        tuple(document.get("further", ())),
        tuple(document.get("derivatives", ())),
    )


def job_text(document: Document) -> str:
    """A `document` as text, the same for the same content."""
    return json.dumps(document, sort_keys=True)


def check_travels(document: Document) -> None:
    """**Raises** `InputError` for what another process could not build again from `document`."""
    if document["accuracy"]["method"]["name"] != "taylor":
        found = document["accuracy"]["method"]["name"]
        raise InputError(f'sweep: found the step method "{found}" with an executor, expected a Taylor series.')
    named = {"piezo": document["actuator"]["piezo"], "friction": document["actuator"]["friction"]}
    for family, name in (named | {"drive": document["drive"]["waveform"]}).items():
        if name.partition(":")[0] not in members(family):
            raise InputError(
                f'sweep: found the {family} "{name}" with an executor, which pdssjax does not have; expected one of '
                f"{', '.join(members(family))}: other processes know no others."
            )


def differences(document: Document, other: Document, at: str = "") -> list[str]:
    """Where two documents differ, each as "parameters.friction.f_ss_a: 0.8, not 0.7"; the first is called for."""
    found: list[str] = []
    for key in sorted({*document, *other}):
        here, there = document.get(key), other.get(key)
        name = f"{at}.{key}".lstrip(".")
        if isinstance(here, dict) and isinstance(there, dict):
            found += differences(here, there, name)
        elif here != there:
            found.append(f"{name}: {_told(there)}, not {_told(here)}")
    return found


def _told(value: object) -> str:
    return "none" if value is None else f"{value!r}" if isinstance(value, float) else str(value)


def _accuracy_document(accuracy: Accuracy) -> Document:
    method = accuracy.method
    described = {"name": "taylor", "order": method.order} if isinstance(method, Taylor) else {"name": repr(method)}
    numbers = {f.name: getattr(accuracy, f.name) for f in dataclasses.fields(accuracy) if f.name != "method"}
    return {name: float(n) if isinstance(n, float) else int(n) for name, n in numbers.items()} | {"method": described}
