"""Which parameters a prediction depends on, and the messages on those that have no effect.

What is legal in a study (`Study.legal`) is more than what its records depend on: a study of the platform knows
the parameters of a stop.  A path that somebody names outside the study's file has to have an effect, or is refused.
"""

import itertools
from collections.abc import Collection, Iterable, Mapping, Sequence

import numpy as np
from jax.core import Tracer

from ..core import InputError, Quantity, check_range, nearest
from .models import Models
from .record import Record, drive_with, shared_fields

ELECTRONICS = frozenset({"amplifier", "sensor"})
"""Parts of every driven rig; a study has them where it, or a request to predict, names their parameters."""

_NEEDS = {
    "stop": ("no record runs against a stop", 'a record with measures = "force"'),
    "effector": ("no record depends on the end-effector", 'a record with measures = "effector"'),
    "friction": ("no record depends on the contact", 'a record with measures = "effector" or "friction"'),
    **dict.fromkeys(
        ("piezo", "amplifier", "sensor"), ("no record is driven", 'a record with measures = "platform" or "effector"')
    ),
}
"""Why the parameters of a part of the rig have no effect, and what would give them one."""

MASS_UNUSED = "only friction that acts back on the platform uses it", "feedback = true in [actuator] of the study"
"""Why the mass of a stack without feedback changes nothing, and what would make it count."""


def paths_read(models: Models, records: Sequence[Record]) -> list[str]:
    """The paths of the parameters on which the prediction of any of the `records` depends."""
    parts = set[str]().union(*(record.measurement.parts() for record in records))
    if any(record.measurement.driven for record in records):
        parts |= ELECTRONICS | ({"friction", "effector"} if models.feedback else set())
    unused = unused_by(models)
    read = [path for path in models.declared() if path.split(".")[0] in parts and path not in unused]
    shared = dict.fromkeys(path for record in records for path in shared_fields(record).values())
    return [*read, *(path for path in shared if path != "drive.frequency")]


def unused_by(models: Models) -> set[str]:
    """The paths of declared parameters that nothing uses, whatever is measured."""
    mass = models.declared().get("piezo.mass")
    return {"piezo.mass"} if mass is not None and mass.optional and not models.feedback else set()


def check_read(paths: Iterable[str], models: Models, records: Sequence[Record], where: str) -> None:
    """**Raises** `InputError` that names the first of the `paths` on which no record depends, and what would change it.

    A study without records may be made for any use, and refuses none.
    """
    if not records:
        return
    read = paths_read(models, records)
    for path in paths:
        if path in read:
            continue
        part, _, field = path.partition(".")
        if path in unused_by(models):
            why, needs = MASS_UNUSED
        elif part != "drive":
            why, needs = _NEEDS[part]
        elif any(record.drive is not None and field in record.drive.declared() for record in records):
            why = f"every record sets the {field} of its own drive"
            needs = f'"{path}" in [parameters], and a record whose drive leaves {field} out'
        else:
            why, needs = f"no drive of a record has a {field}", f"a record whose waveform has a {field}"
        raise without_effect(where, path, why, needs, read)


def without_effect(where: str, path: str, why: str, needs: str, read: Collection[str]) -> InputError:
    """The error for a `path` without effect: `why`, what it `needs`, and the nearest path that is `read`."""
    return InputError(f'{where}: found "{path}", which changes nothing: {why}. It needs {needs}; {nearest(path, read)}')


def check_whole_parts(paths: Collection[str], listed: Collection[str], where: str) -> None:
    """**Raises** `InputError` where `paths` name a part by a parameter that says nothing without another.

    **Arguments:** `listed` are the paths of the study's parameters.
    """
    if "amplifier.slew" in paths and "amplifier.bandwidth" not in {*paths, *listed}:
        raise InputError(
            f'{where}: found "amplifier.slew" without "amplifier.bandwidth", expected a number for both: the study '
            "has no amplifier yet."
        )


def check_numbers(
    values: Mapping[str, object], declared: Mapping[str, Quantity], records: Sequence[Record], where: str
) -> None:
    """**Raises** `InputError` for what is no number, or outside its legal range, or contradicts a record's drive.

    Numbers that JAX traces are not known, and pass.
    """
    known: dict[str, float] = {}
    for path, number in values.items():
        if isinstance(number, Tracer):
            continue
        unit = declared[path].unit
        expected = f"a number in {unit}" if unit else "a number"
        array = np.asarray(number)
        if array.shape:
            raise InputError(
                f'{where}: "{path}": found an array of shape {array.shape}, expected {expected}; '
                "jax.vmap takes many numbers at once."
            )
        if array.dtype.kind not in "fiu":
            raise InputError(f'{where}: "{path}": found {number!r:.80}, expected {expected}.')
        known[path] = float(array)
        check_range(known[path], declared[path], f'{where}: "{path}"')
    # A number that the drives of several records share has to suit each that follows it.
    for path, record in itertools.product(known, records):
        if path in shared_fields(record).values():
            clause = drive_with(record, known).broken_conditions().get(path.removeprefix("drive."))
            if clause:
                raise InputError(f'{where}: "{path}": found {clause}, in record "{record.name}".')
