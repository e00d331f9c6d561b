"""The JSON schema (draft 7) of a study file, by which editors complete, explain and check it.

The schema is generated from the families and the declarations of their members, so that it has new members at once.
"""

import re
from collections.abc import Iterable, Mapping

from ..actuator import PARTS
from ..core import Document, Quantity, member, members
from ..integration import SOLVERS
from ..piezo import DYNAMICS, HYSTERESES, MOST, Composition, fields_of
from ..study import Entry, catalogue_entries
from .design_table import BUDGET_KEYS, DESIGN_KEYS
from .drive_table import SAMPLED_KEYS
from .json_text import json_text
from .parameter_table import CONSTRAINT_EXAMPLE
from .record_table import RECORD_KEYS
from .study_toml import FORMAT, STATES

_NUMBER = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*.*$"

_TEXT: Document = {"type": "string", "minLength": 1}

_NAME: Document = {"anyOf": [_TEXT, {"type": "integer", "minimum": 1}], "description": "Name or number of a channel."}

_PAIR: Document = {"type": "array", "minItems": 2, "maxItems": 2}


def study_schema() -> Document:
    """The schema, as plain data for a JSON file."""
    entries = {entry.name: entry for entry in catalogue_entries()}
    return {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "A study of pdssjax",
        **_table(
            {
                "format": {"const": FORMAT},
                "title": {"type": "string", "description": "Title of the study in reports."},
                "solver": {
                    "enum": list(SOLVERS),
                    "description": "Integrator of every simulation, taylor if left out. The others are diffrax's.",
                },
                "actuator": _actuator(entries),
                "parameters": _parameters(entries),
                "constraints": {
                    "type": "object",
                    "additionalProperties": {"type": "string", "pattern": ">=|<="},
                    "description": f'Inequalities between parameters, each under a name: "{CONSTRAINT_EXAMPLE}".',
                },
                "record": {
                    "type": "array",
                    "items": _record(entries),
                    "description": "One table for each run of the rig.",
                },
                "design": _design(),
            },
            ["format", "actuator", "parameters"],
        ),
    }


def _table(properties: Mapping[str, object], required: Iterable[str] = (), **more: object) -> Document:
    return {
        "type": "object",
        "properties": dict(properties),
        "required": list(required),
        "additionalProperties": False,
        **more,
    }


def _quantity(unit: str, text: str = "") -> Document:
    """A number in SI, or a text with a unit."""
    bracketed = f"[{unit}]" if unit and f"[{unit}]" not in text else ""
    with_unit = {"type": "string", "pattern": _NUMBER}
    return {"anyOf": [{"type": "number"}, with_unit], "description": f"{text} {bracketed}".strip()}


def _chosen(entries: Mapping[str, Entry], family: str) -> Document:
    """The names of a family's members, each with its summary."""
    summaries = {name.partition("/")[2]: e.summary for name, e in entries.items() if name.startswith(f"{family}/")}
    return {"oneOf": [{"const": name, "description": summary} for name, summary in summaries.items()]}


def _actuator(entries: Mapping[str, Entry]) -> Document:
    count = lambda key: {"type": "integer", "minimum": 1, "maximum": MOST[key]}
    law = {"enum": list(HYSTERESES), "description": "How the displacement lags behind the voltage."}
    hysteresis = _table({"law": law, "elements": count("elements"), "asymmetry": count("asymmetry")}, ["law"])
    composed = {
        "dynamics": {"enum": list(DYNAMICS), "description": "Mechanics of stack and platform."},
        "hysteresis": {"anyOf": [law, hysteresis], "description": "Hysteresis of the ceramic; none if left out."},
        "creep": _table({"elements": count("creep")}, description="Creep of the ceramic; none if left out."),
        "modes": count("modes") | {"description": "Number of modes of a rod."},
    }
    under_load = "Load and tilt acted before t = 0; if left out, they set in at t = 0."
    keys = {
        "piezo": {"anyOf": [_chosen(entries, "piezo"), _table(composed, ["dynamics"])]},
        "friction": _chosen(entries, "friction"),
        "friction_state": {"enum": list(STATES), "description": "Reading of the direction-dependent law (5.22)."},
        "feedback": {"type": "boolean", "description": "Friction acts back on the platform (5.25)."},
        "rests_under_load": {"type": "boolean", "description": under_load},
    }
    return _table(keys, ["piezo"])


def _composed_parameters() -> dict[str, Document]:
    """The parameters of a composed stack, by a pattern of their paths."""
    compositions = [Composition(dynamics, law, 1, 2, 1) for dynamics in DYNAMICS for law in HYSTERESES]
    fields = {field.name: field for composition in compositions for field in fields_of(composition)}
    tables: dict[str, Document] = {}
    for name, field in fields.items():
        declared = field.declared.metadata["quantity"]
        text = re.sub(r"\b[12]\b", "n", field.text) if name[-1].isdigit() else field.text
        path = re.sub(r"\d+$", r"\\d+", re.escape(f"piezo.{name}"))
        tables[rf"^{path}(@.+)?$"] = _parameter(declared, text)
    tables[r"^piezo\.[a-z_]+_\*(@.+)?$"] = {"type": "object", "description": "All that differ by a number."}
    return tables


def _parameters(entries: Mapping[str, Entry]) -> Document:
    """Every parameter of every member; those that a study may list depend on its models."""
    quantities: dict[str, tuple[Quantity, str]] = {}
    for name, entry in entries.items():
        family = name.partition("/")[0]
        for field, declared in entry.parameters.items():
            if family in ("piezo", "friction", *PARTS) or (family == "drive" and field != "frequency"):
                quantities.setdefault(f"{family}.{field}", declared)
    tables = {path: _parameter(*declared) for path, declared in quantities.items()}
    marked = {f"^{re.escape(path)}@.+$": table for path, table in tables.items()}
    return _table(tables, patternProperties=marked | _composed_parameters())


def _parameter(declared: Quantity, text: str) -> Document:
    keys = {
        "value": "The number at which the parameter is fixed.",
        "start": "Where the fit begins; if left out, it is found in the data.",
        "min": "Lower bound.",
        "max": "Upper bound.",
        "standard_error": "Error of a value that was measured apart, which the fit uses as one more measurement.",
    }
    return _table({key: _quantity(declared.unit, meaning) for key, meaning in keys.items()}, description=text)


def _record(entries: Mapping[str, Entry]) -> Document:
    kinds = [member("study.measurement", name) for name in members("study.measurement")]
    quantities = dict.fromkeys(quantity for kind in kinds for quantity in kind.columns)
    choices = {
        key: words for name, e in entries.items() if name.startswith("measurement/") for key, words in e.choices.items()
    }
    clock = _table({"interval": _quantity("s"), "start": _quantity("s")}, ["interval"])
    described: dict[str, Document] = {
        "name": _TEXT | {"description": "Name of the record in reports; the file's name if left out."},
        "file": _TEXT | {"description": "CSV, MATLAB, TDMS, HDF5 or an oscilloscope's; relative to the study."},
        "columns": _table(dict.fromkeys(quantities, _NAME), description="Channel of each quantity."),
        "channel": _NAME | {"description": "Channel of the measured quantity."},
        "time": {"anyOf": [*_NAME["anyOf"], clock], "description": "Channel of the times, or their interval."},
        "units": _table(
            dict.fromkeys([*quantities, "voltage"], _TEXT), description="Units that the file does not give."
        ),
        "scale": _quantity("", 'Factor of the channel\'s numbers, such as "0.5 um/V", or -1.'),
        "decimal": {"enum": [",", "."], "description": "Decimal sign of a text; if left out, it is found in the file."},
        "measures": _chosen(entries, "measurement"),
        "role": {"enum": ["fit", "validate"], "description": "Fitted, or only predicted and compared."},
        "noise": _quantity("", "Standard deviation of the noise; if left out, it is estimated."),
        "offset": _quantity("", 'Zero of the sensor, or "free" (default).'),
        "window": _PAIR
        | {"items": _quantity("s"), "description": "Part of the record that is kept, on the file's clock."},
        "exclude": {"type": "array", "items": _PAIR | {"items": _quantity("s")}, "description": "Parts left out."},
        "held": {"type": "integer", "minimum": 2, "description": "Samples for which the sensor shows each value."},
        "decimate": {"type": "integer", "minimum": 2, "description": "Keeps every so many samples, low-passed."},
        "start": _quantity("s", "Start of the drive on the file's clock."),
        "drive": _drive(entries),
        "resolution": _quantity("", "Step in which the sensor counts."),
        "sampling": {
            "type": ["object", "array"],
            "description": "Sample times of a record to be made: start, end, interval; or a list of such windows.",
        },
        "conditioning": {"description": "The drive before t = 0: cycles, or a time for which it was held."},
        "conditions": {
            "type": "array",
            "items": _TEXT,
            "description": "Conditions of the record, as in path@condition.",
        },
        **{key: {"enum": words} for key, words in choices.items()},
    }
    described["offset"]["anyOf"].append({"const": "free"})
    assert set(RECORD_KEYS) <= set(described)
    return _table(described, ["file", "measures"])


def _design() -> Document:
    """The limits of the next records, for `pdssjax design`."""
    types = {key: {"type": "array"} for key in ("kinds", "waveforms", "voltage", "frequency", "duty", "amplitude")}
    types |= {key: {"type": "object"} for key in ("noise", "correlation_time", "range", "rig")}
    types["budget"] = _table(
        {key: {"type": "number", "description": "For all records together."} for key in BUDGET_KEYS}
    )
    keys = {key: types.get(key, _quantity("")) | {"description": text} for key, text in DESIGN_KEYS.items()}
    return _table(keys, description="What rig, sensor and recorder can do, for the next records.")


def _drive(entries: Mapping[str, Entry]) -> Document:
    """One table for each waveform."""
    tables = []
    for waveform in members("drive"):
        entry = entries[f"drive/{waveform}"]
        keys: dict[str, Document] = {"waveform": {"const": waveform, "description": entry.summary}}
        keys |= {field: _quantity(declared.unit, meaning) for field, (declared, meaning) in entry.parameters.items()}
        keys |= {field: {"enum": words} for field, words in entry.choices.items()}
        keys["hold"] = _quantity("s", "Interval of a converter's staircase.")
        # Other numbers may be parameters of the study.
        needed = ["waveform", *({"frequency"} & set(entry.parameters))]
        if waveform == "sampled":
            keys |= {key: {"description": text} for key, text in SAMPLED_KEYS.items()}
            needed.append("column")
        tables.append(_table(keys, needed))
    return {"type": "object", "oneOf": tables, "description": "The voltage on the piezo."}


def schema_text() -> str:
    """The schema as the text of a JSON file."""
    return json_text(study_schema())
