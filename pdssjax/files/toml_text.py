"""Writes tables as TOML: one line a key, tables below the first level in braces."""

import json
import re
from collections.abc import Mapping

from ..core import Document


def toml_text(document: Document, tables: tuple[str, ...], lists: tuple[str, ...]) -> str:
    """A document as TOML: plain keys first, then the keys in `tables` as [key], those in `lists` as [[key]]."""
    lines = [f"{_key(key)} = {_value(given)}" for key, given in document.items() if key not in (*tables, *lists)]
    for name in tables:
        if name in document:
            lines += ["", f"[{_key(name)}]", *_entries(document[name])]
    for name in lists:
        for entry in document.get(name, []):
            lines += ["", f"[[{_key(name)}]]", *_entries(entry)]
    return "\n".join(lines) + "\n"


def _entries(table: Document) -> list[str]:
    return [f"{_key(key)} = {_value(given)}" for key, given in table.items()]


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else quoted(key)


def _value(given: object) -> str:
    if isinstance(given, Mapping):
        pairs = ", ".join(f"{_key(str(key))} = {_value(value)}" for key, value in given.items())
        return f"{{ {pairs} }}" if pairs else "{}"
    if isinstance(given, list):
        return f"[{', '.join(map(_value, given))}]"
    if isinstance(given, bool):
        return str(given).lower()
    if isinstance(given, int | float):
        return repr(given)
    return quoted(str(given))


def quoted(text: str) -> str:
    # What JSON escapes TOML escapes alike, but for the last control character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
