"""Every key of the study file as Markdown, from the JSON schema that `pdssjax schema` prints."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from pdssjax.files import schema_text

Schema = Mapping[str, Any]
"""A piece of JSON."""


def kind(schema: Schema) -> str:
    """What a key takes, in words."""
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return " or ".join(f"`{word}`" for word in schema["enum"])
    if "oneOf" in schema and all("const" in one for one in schema["oneOf"]):
        return "one of " + ", ".join(f"`{one['const']}`" for one in schema["oneOf"])
    if "anyOf" in schema:
        parts = [part for part in schema["anyOf"] if "description" not in part or "const" in part]
        names = {"number": "a number", "string": "a text", "integer": "a whole number", "object": "a table"}
        return " or ".join(dict.fromkeys(names.get(part.get("type", ""), kind(part)) for part in parts))
    if isinstance(schema.get("type"), list):
        return " or ".join(kind({"type": one}) for one in schema["type"])
    names = {"string": "a text", "integer": "a whole number", "boolean": "`true` or `false`"}
    names |= {"number": "a number", "object": "a table", "array": "a list"}
    return names.get(schema.get("type", ""), "")


def row(name: str, schema: Schema, needed: bool) -> str:
    cells = [f"`{name}`", "needed" if needed else "", kind(schema), schema.get("description", "")]
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


def table(schema: Schema) -> list[str]:
    """The keys of one table."""
    needed = schema.get("required", [])
    lines = [row(name, told, name in needed) for name, told in schema["properties"].items()]
    return ["| key | | takes | |", "|---|---|---|---|", *lines, ""]


def parameters(schema: Schema) -> list[str]:
    """The parameters that a study may list, by their paths."""
    lines = []
    for path, told in schema["properties"].items():
        unit = told["properties"]["value"]["description"].rpartition("[")
        shown = unit[2].rstrip("]") if unit[1] else "1"
        lines.append(f"| `{path}` | {shown} | {told.get('description', '')} |")
    keys = row_lines(schema)
    return [*keys, "| path | unit | |", "|---|---|---|", *lines, ""]


def row_lines(schema: Schema) -> list[str]:
    """The keys that each parameter takes."""
    first = next(iter(schema["properties"].values()))
    lines = [f"| `{key}` | {told['description'].partition(' [')[0]} |" for key, told in first["properties"].items()]
    return ["| key of a parameter | |", "|---|---|", *lines, ""]


def drives(schema: Schema) -> Iterator[str]:
    """Every waveform with its keys."""
    for one in schema["oneOf"]:
        waveform = one["properties"]["waveform"]
        yield from [f"**{waveform['const']}**: {waveform['description']}", ""]
        yield from table({**one, "properties": {k: v for k, v in one["properties"].items() if k != "waveform"}})


def lines_of(part: str) -> list[str]:
    """The lines of one part of the study.

    They are "study", "actuator", "parameters", "record", "drive", "design" and "budget".
    """
    whole = json.loads(schema_text())
    record = whole["properties"]["record"]["items"]
    if part == "study":
        return table(whole)
    if part == "parameters":
        return parameters(whole["properties"]["parameters"])
    if part == "drive":
        return list(drives(record["properties"]["drive"]))
    if part == "budget":
        return table(whole["properties"]["design"]["properties"]["budget"])
    return table(record if part == "record" else whole["properties"][part])
