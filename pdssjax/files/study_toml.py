"""Reads and checks a study file: the actuator's models, its parameters and its records.

`parameter_table` reads the tables [parameters] and [constraints], `record_table` the tables [[record]].
"""

import dataclasses
import math
import sys
import tomllib
from pathlib import Path

from ..core import Document, InputError, member, members
from ..integration import SOLVERS
from ..piezo import DYNAMICS, HYSTERESES, MOST, Composition
from ..piezo.base import AbstractPiezo
from ..study import Record, Study, drive_with, paths_in, shared_fields, split_path
from .parameter_table import read_constraints, read_parameters
from .record_table import read_record
from .results_folder import read_text
from .toml_table import Table

FORMAT = "pdssjax-study/1"

STATES = ["deflection", "force"]
"""Readings of the direction-dependent law, as a study names them."""

_STACKS = 'a name such as "second-order", or a table such as { dynamics = "static", hysteresis = { law = "play" } }'


def load_study(path: str | Path, virtual: bool = False) -> Study:
    """Read and check a study file and the files of its records.

    With `virtual` the records are still to be made: those with a `sampling` need no file.

    **Raises:** `InputError` that names file and key, or file, line and column, if anything is missing, unknown or
    illegal.  Warns with `InputWarning` where the input is legal but looks like a mistake.
    """
    path = Path(path)
    top = Table(read_toml(path), str(path))
    format_ = top.text("format", f'"{FORMAT}"')
    if format_ != FORMAT:
        raise InputError(f'{top.at("format")}: found "{format_}", expected "{FORMAT}".')
    top.only(["format", "title", "solver", "actuator", "parameters", "constraints", "record", "design"])
    actuator = top.table("actuator", 'a table with "piezo" and "friction"')
    actuator.only(["piezo", "friction", "friction_state", "feedback", "rests_under_load"])
    piezo = _read_piezo(actuator)
    records = _read_records(top, path.parent, virtual, piezo.has_steady_state)
    # Records of the platform alone do not depend on the friction law, so that a study of them need not name it.
    alone = bool(records) and all(record.measurement.platform_alone for record in records)
    default = ["coulomb"] if alone and actuator.entries.get("feedback") is not True else []
    law = actuator.option("friction", members("friction"), *default)
    study = Study(
        title=top.text("title", "a text", path.stem),
        path=path,
        piezo=piezo,
        friction=member("friction", law),
        friction_state=actuator.option("friction_state", STATES, STATES[0]),
        feedback=actuator.get("feedback", bool, "true or false", False),
        parameters={},
        records=records,
        rests_under_load=actuator.get("rests_under_load", bool, "true or false", False),
        solver=top.option("solver", SOLVERS, SOLVERS[0]),
    )
    parameters = read_parameters(top, study)
    study = dataclasses.replace(study, parameters=parameters, constraints=read_constraints(top, parameters))
    _check_durations(top, study)
    _check_jumps(top, study)
    _check_measurements(top, study)
    fitted = [record for record in study.records if record.role == "fit"]
    samples = sum(record.time.size for record in fitted)
    free = sum(parameter.free for parameter in study.parameters.values())
    offsets = sum(record.offset is None for record in fitted)
    if fitted and samples < free + offsets:
        raise InputError(
            f"{top.where}: found {samples} samples to fit, "
            f"expected at least as many as there are unknowns: {free} free parameters and {offsets} offsets."
        )
    return study


def read_toml(path: Path) -> Document:
    """The content of a TOML file; **raises** `InputError` if it is missing or not valid TOML."""
    text = read_text(path, "a study file")
    try:
        document = tomllib.loads(text)
        str(document)  # raises here for hexadecimal integers too long to be written in messages
        return document
    except (ValueError, RecursionError) as error:  # beside syntax: integers and nesting beyond what Python reads
        raise InputError(f"{path}: found no valid TOML: {error}.") from None


def _read_records(top: Table, folder: Path, virtual: bool, settles: bool) -> tuple[Record, ...]:
    expected = "one [[record]] table for each record"
    parameters = top.table("parameters", "a table of parameters")
    records: list[Record] = []
    for number, entries in enumerate(top.get("record", list, expected, []), start=1):
        if not isinstance(entries, dict):
            raise InputError(f"{top.at('record')}: found {entries}, expected {expected}.")
        name = entries.get("name")
        label = f'record "{name}"' if isinstance(name, str) else f"record {number}"
        record = read_record(Table(entries, f"{top.where}: {label}"), parameters, folder, virtual, settles)
        if record.name in [other.name for other in records]:
            raise InputError(f'{top.where}: found two records named "{record.name}", expected different names.')
        records.append(record)
    return tuple(records)


def _check_durations(top: Table, study: Study) -> None:
    """**Raises** `InputError` where a duration shared by the drives does not fit into the period of one of them."""
    for path, parameter in study.parameters.items():
        base, condition = split_path(path)
        family, _, field = base.partition(".")
        given = parameter.start if parameter.free else parameter.value
        if family != "drive" or parameter.unit != "s" or given is None:
            continue
        for record in study.records:
            applies = not condition or condition in record.conditions
            if record.drive is None or field not in shared_fields(record) or not applies:
                continue
            clause = drive_with(record, {base: given}).broken_conditions().get(field)
            if clause:
                raise InputError(f'{top.where}: parameters: key "{path}": found {clause}, in record "{record.name}".')


def _check_jumps(top: Table, study: Study) -> None:
    """Check the records of a piezo whose platform follows the voltage at once.

    Such a platform feels no force, and some measurements are undefined where it jumps.
    """
    if study.piezo.is_compliant:
        return
    if study.feedback:
        raise InputError(
            f'{top.where}: actuator: key "feedback": found true, expected false: no force moves the platform of '
            "this piezo."
        )
    amplified = any(path.startswith("amplifier.") for path in study.parameters)
    # A rise or fall time that is free is not zero.
    numbers = {path: sys.float_info.min if p.value is None else p.value for path, p in study.parameters.items()}
    for record in study.records:
        where, measurement = f'{top.where}: record "{record.name}": drive', record.measurement
        if record.drive is None:
            continue
        record_numbers = {base: numbers[path] for base, path in paths_in(numbers, record.conditions).items()}
        jumps = drive_with(record, record_numbers).has_jumps()
        if jumps and not amplified and measurement.at_a_jump():
            raise InputError(
                f"{where}: found a voltage that jumps, expected a fall or rise time above 0 or an amplifier: "
                f"the platform of this piezo would jump, too, and {measurement.at_a_jump()}."
            )
        # Behind an amplifier a jump is a corner.
        corners = jumps if amplified else record.drive.has_corners()
        if corners and measurement.at_a_corner():
            expected = "a fall or rise time above 0" if amplified else "a smooth one or an amplifier"
            raise InputError(
                f"{where}: found a voltage with {'jumps' if amplified else 'corners'}, expected {expected}: "
                f"the velocity of the platform of this piezo would jump there, and {measurement.at_a_corner()}."
            )


def _check_measurements(top: Table, study: Study) -> None:
    """Refuse records that their measurement refuses under the models and numbers of the study."""
    nominal = {path: declared.nominal for path, declared in study.models.declared().items() if declared.optional}
    for record in study.records:
        known = nominal | {path: math.nan if p.value is None else p.value for path, p in study.parameters.items()}
        record_numbers = {base: known[path] for base, path in paths_in(known, record.conditions).items()}
        if reason := record.measurement.refused(study.models, record_numbers, record):
            raise InputError(f'{top.where}: record "{record.name}": {reason}.')


def _read_piezo(actuator: Table) -> type[AbstractPiezo]:
    """The class that the key "piezo" of the table [actuator] describes."""
    if not isinstance(actuator.entries.get("piezo"), dict):
        actuator.get("piezo", str, _STACKS)
        return member("piezo", actuator.option("piezo", members("piezo")))
    table = actuator.table("piezo", _STACKS)
    table.only(["dynamics", "hysteresis", "creep", "modes"])
    dynamics = table.option("dynamics", DYNAMICS)
    if "modes" in table.entries and dynamics != "rod":
        raise InputError(f'{table.at("modes")}: found modes of "{dynamics}" dynamics, expected them of a "rod" only.')
    composition = Composition(dynamics, "none", 0, 1, 0, _count(table, "modes", 1))
    if "hysteresis" in table.entries:
        given, example = table.entries["hysteresis"], 'a table such as { law = "play", elements = 8, asymmetry = 3 }'
        is_name = isinstance(given, str)
        ceramic = Table({"law": given}, f"{table.where}: hysteresis") if is_name else table.table("hysteresis", example)
        ceramic.only(["law", "elements", "asymmetry"])
        law = ceramic.option("law", HYSTERESES)
        has_elements = law in ("play", "maxwell-slip")
        if "elements" in ceramic.entries and not has_elements:
            raise InputError(
                f'{ceramic.at("elements")}: found elements of "{law}", expected them of play or maxwell-slip.'
            )
        elements = _count(ceramic, "elements", 8) if has_elements else 0
        asymmetry = _count(ceramic, "asymmetry", 1)
        composition = composition._replace(hysteresis=law, elements=elements, asymmetry=asymmetry)
    if "creep" in table.entries:
        creep = table.table("creep", "a table such as { elements = 3 }")
        creep.only(["elements"])
        composition = composition._replace(creep=_count(creep, "elements", 3, "creep"))
    return member("piezo", f"composed:{composition.text}")


def _count(table: Table, key: str, default: int, limit: str = "") -> int:
    most = MOST[limit or key]
    return table.whole(key, f"a whole number from 1 to {most}", default, most=most)
