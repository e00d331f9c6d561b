"""What can be chosen in a study: every member of every family, with its equations and parameters.

Read from the members' own docstrings, so that there is one place for each fact.
"""

import ast
import dataclasses
import inspect
import sys
import textwrap

from ..actuator import PARTS
from ..core import InputError, Quantity, choices, member, members, nearest, quantities

FAMILIES = {"drive": "drive", "piezo": "piezo", "friction": "friction", "measurement": "study.measurement"}
"""Of these a study chooses a member: drives by `waveform`, measurements by `measures`, the others in [actuator]."""


@dataclasses.dataclass(frozen=True)
class Entry:
    """A member, or a part of the rig."""

    name: str
    """As a study writes it, with its family: "friction/lugre"; a part: "sensor", which goes before members."""
    summary: str
    """Its first sentence."""
    text: str
    """Equations and sources, as its module tells them."""
    parameters: dict[str, tuple[Quantity, str]]
    """By name, what is declared, and what it is."""
    choices: dict[str, list[str]]
    """By name, the words it may be set to."""


def catalogue_entries() -> list[Entry]:
    """All members and parts, family by family."""
    chosen = [(f"{said}/{name}", member(family, name)) for said, family in FAMILIES.items() for name in members(family)]
    return [_entry(name, model) for name, model in (*chosen, *PARTS.items())]


def find_entry(name: str) -> Entry:
    """The entry `name`, with or without its family.

    **Raises:** `InputError` that names the nearest known one.
    """
    entries = catalogue_entries()
    found = [entry for entry in entries if name in (entry.name, entry.name.rpartition("/")[2])]
    if not found:
        known = [entry.name.rpartition("/")[2] for entry in entries]
        raise InputError(f'models: found the unknown name "{name}"; {nearest(name, known)}')
    return next((entry for entry in found if entry.name == name), found[0])


def _entry(name: str, model: type) -> Entry:
    text = inspect.cleandoc(sys.modules[model.__module__].__doc__ or "")
    told = _field_docs(model)
    declared = {field: (quantity, told.get(field, "")) for field, quantity in quantities(model).items()}
    options = {field: list(words) for field, words in choices(model).items()}
    summary = text if "/" in name else model.__doc__ or ""
    return Entry(name, " ".join(summary.split("\n\n")[0].split()), text, declared, options)


def _field_docs(model: type) -> dict[str, str]:
    """The docstring below each field of a class and of those it inherits from."""
    docs: dict[str, str] = {}
    for base in reversed(model.__mro__):
        docs |= vars(base).get("told", {})  # of a class that is put together, and has no source
        if "told" not in vars(base) and base.__module__.startswith("pdssjax."):
            body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
            assert isinstance(body, ast.ClassDef)
            for field, below in zip(body.body, body.body[1:], strict=False):
                if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                    value = below.value if isinstance(below, ast.Expr) else None
                    if isinstance(value, ast.Constant) and isinstance(value.value, str):
                        docs[field.target.id] = inspect.cleandoc(value.value).replace("\n", " ")
    return docs
