"""Checked access to the tables of a TOML file, with messages that name the place."""

import dataclasses
from collections.abc import Iterable
from typing import Any

from ..core import InputError, Quantity, check_range, nearest, to_si

_REQUIRED = object()


@dataclasses.dataclass(frozen=True)
class Table:
    """A table of a TOML file.  Every method raises `InputError` where its claim fails."""

    entries: dict[str, Any]
    """Keys and values as read."""
    where: str
    """File and table, as messages name them."""

    def at(self, key: str) -> str:
        """The place of a key, as messages name it."""
        return f'{self.where}: key "{key}"'

    def only(self, known: Iterable[str]) -> None:
        """There are no keys but the `known` ones."""
        known = list(known)
        for key in self.entries:
            if key not in known:
                raise InputError(f'{self.where}: found the unknown key "{key}"; {nearest(key, known)}')

    def get(self, key: str, kind: type, expected: str, default: Any = _REQUIRED) -> Any:
        """The value of `key`, of the type `kind`; `expected` says so in words."""
        if key not in self.entries:
            if default is not _REQUIRED:
                return default
            raise InputError(f'{self.where}: the key "{key}" is missing, expected {expected}.')
        value = self.entries[key]
        if not isinstance(value, kind):
            raise InputError(f"{self.at(key)}: found {_shown(value)}, expected {expected}.")
        return value

    def text(self, key: str, expected: str, default: Any = _REQUIRED) -> str:
        """A text that is not empty."""
        value = self.get(key, str, expected, default)
        if not value:
            raise InputError(f"{self.at(key)}: found an empty text, expected {expected}.")
        return value

    def option(self, key: str, options: Iterable[str], default: Any = _REQUIRED) -> str:
        """One of the `options`."""
        options = list(options)
        value = self.get(key, str, f"one of {', '.join(options)}", default)
        if value not in options:
            raise InputError(f'{self.at(key)}: found "{value}"; {nearest(value, options)}')
        return value

    def number(self, key: str, unit: str, default: Any = _REQUIRED) -> Any:
        """A quantity, as a float in the SI unit `unit`."""
        expected = f"a value in {unit}" if unit else "a pure number"
        value = self.get(key, object, expected, default)
        return value if value is default else to_si(value, unit, self.at(key))

    def quantity(self, key: str, declared: Quantity) -> float:
        """A legal value of a `declared` quantity, in its SI unit."""
        value = self.number(key, declared.unit)
        check_range(value, declared, self.at(key))
        return value

    def table(self, key: str, expected: str, default: Any = _REQUIRED) -> "Table":
        """A table inside this one."""
        return Table(self.get(key, dict, expected, default), f"{self.where}: {key}")


def _shown(value: Any) -> str:
    if isinstance(value, dict):
        return "a table"
    return f'"{value}"' if isinstance(value, str) else str(value)
