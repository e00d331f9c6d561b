"""Checked access to the tables of a TOML file, with messages that name the place; strings of TOML."""

import dataclasses
import json
import math
from collections.abc import Iterable
from typing import Any, TypeVar, overload

from ..core import Document, InputError, Quantity, check_range, nearest, to_si

Kind = TypeVar("Kind")

Default = TypeVar("Default")

_REQUIRED: Any = object()


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of a TOML file.  Every method raises `InputError` where the table is not as it requires."""

    entries: Document
    """Keys and values as read."""
    where: str
    """File and table, as messages name them."""

    def at(self, key: str) -> str:
        """The place of a key, as messages name it."""
        return f'{self.where}: key "{key}"'

    def only(self, known: Iterable[str]) -> None:
        """Require that all keys are among the `known` ones."""
        known = list(known)
        for key in self.entries:
            if key not in known:
                raise InputError(f'{self.where}: found the unknown key "{key}"; {nearest(key, known)}')

    @overload
    def get(self, key: str, kind: type[Kind], expected: str) -> Kind: ...
    @overload
    def get(self, key: str, kind: type[Kind], expected: str, default: Default) -> Kind | Default: ...
    def get(self, key: str, kind: type[Kind], expected: str, default: Default = _REQUIRED) -> Kind | Default:
        """The value of `key`, of the type `kind`; `expected` describes it for messages."""
        if key not in self.entries:
            if default is not _REQUIRED:
                return default
            raise InputError(f'{self.where}: the key "{key}" is missing, expected {expected}.')
        value = self.entries[key]
        if not isinstance(value, kind):
            raise InputError(f"{self.at(key)}: found {_value_text(value)}, expected {expected}.")
        return value

    def text(self, key: str, expected: str, default: str = _REQUIRED) -> str:
        """A text that is not empty."""
        value = self.get(key, str, expected, default)
        if not value:
            raise InputError(f"{self.at(key)}: found an empty text, expected {expected}.")
        return value

    def option(self, key: str, options: Iterable[str], default: str = _REQUIRED) -> str:
        """The text of a key, which must be one of the `options`."""
        options = list(options)
        value = self.get(key, str, f"one of {', '.join(options)}", default)
        if value not in options:
            raise InputError(f'{self.at(key)}: found "{value}"; {nearest(value, options)}')
        return value

    @overload
    def number(self, key: str, unit: str) -> float: ...
    @overload
    def number(self, key: str, unit: str, default: Default) -> float | Default: ...
    def number(self, key: str, unit: str, default: Default = _REQUIRED) -> float | Default:
        """A quantity, as a float in the SI unit `unit`."""
        expected = f"a value in {unit}" if unit else "a pure number"
        value = self.get(key, object, expected, default)
        return default if value is default else to_si(value, unit, self.at(key))

    def whole(self, key: str, expected: str, default: int = _REQUIRED, least: int = 1, most: float = math.inf) -> int:
        """A whole number from `least` to `most`; `expected` describes it for messages."""
        value = self.get(key, object, expected, default)
        if isinstance(value, bool) or not isinstance(value, int) or not least <= value <= most:
            raise InputError(f"{self.at(key)}: found {_value_text(value)}, expected {expected}.")
        return value

    def quantity(self, key: str, declared: Quantity) -> float:
        """A legal value of a `declared` quantity, in its SI unit."""
        value = self.number(key, declared.unit)
        check_range(value, declared, self.at(key), self.entries[key])
        return value

    def table(self, key: str, expected: str, default: Document = _REQUIRED) -> "Table":
        """A table inside this one."""
        return Table(self.get(key, dict, expected, default), f"{self.where}: {key}")


def _value_text(value: object) -> str:
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else str(value)


def quoted(text: str) -> str:
    """A `text` as a string of TOML, in quotation marks."""
    # TOML has the escapes of JSON, and needs one for the last control character.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
