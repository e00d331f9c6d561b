"""The catalogue of every member of every family, with its equations and parameters.

Read from the members' own docstrings, so that there is one place for each fact.
"""

import ast
import dataclasses
import functools
import inspect
import itertools
import sys

from ..actuator import PARTS
from ..core import InputError, Quantity, choices, member, nearest, quantities
from .summaries import FAMILIES, entry_names, first_sentence


@dataclasses.dataclass(frozen=True)
class Entry:
    """A member, or a part of the rig."""

    name: str
    """Name as a study writes it, with its family: "friction/lugre"; of a part, such as "sensor", without one."""
    summary: str
    """First sentence of the docstring."""
    text: str
    """Equations and sources, as a member's module or a part's class tells them."""
    parameters: dict[str, tuple[Quantity, str]]
    """By name, what is declared, and what it is."""
    choices: dict[str, list[str]]
    """By name, the words it may be set to."""


def catalogue_entries() -> list[Entry]:
    """All members and parts, family by family."""
    return [_entry(name) for name in entry_names()]


def find_entry(name: str) -> Entry:
    """The entry `name`, with or without its family.

    **Raises:** `InputError` that names the nearest known one.
    """
    named = [entry for entry in entry_names() if name in (entry, entry.rpartition("/")[2])]
    if not named:
        known = [entry.rpartition("/")[2] for entry in entry_names()]
        raise InputError(f'models: found the unknown name "{name}"; {nearest(name, known)}')
    return _entry(name if name in named else named[0])


def _entry(name: str) -> Entry:
    said, mark, short = name.partition("/")
    model = member(FAMILIES[said], short) if mark else PARTS[name]
    text = inspect.cleandoc((sys.modules[model.__module__] if mark else model).__doc__ or "")
    docs = _field_docs(model)
    declared = {field: (quantity, docs.get(field, "")) for field, quantity in quantities(model).items()}
    options = {field: list(words) for field, words in choices(model).items()}
    return Entry(name, first_sentence(text), text, declared, options)


def _field_docs(model: type) -> dict[str, str]:
    """The docstring below each field of a class and of those it inherits from."""
    docs: dict[str, str] = {}
    for base in reversed(model.__mro__):
        docs |= vars(base).get("meanings", {})  # of a class that is put together, and has no source
        if "meanings" not in vars(base) and base.__module__.startswith("pdssjax."):
            body = _class_bodies(base.__module__)[base.__name__]
            for field, below in itertools.pairwise(body):
                if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
                    value = below.value if isinstance(below, ast.Expr) else None
                    if isinstance(value, ast.Constant) and isinstance(value.value, str):
                        docs[field.target.id] = inspect.cleandoc(value.value).replace("\n", " ")
    return docs


@functools.cache
def _class_bodies(module: str) -> dict[str, list[ast.stmt]]:
    """The statements of each class of a module, by its name; read at once: `inspect` would read it class by class."""
    tree = ast.parse(inspect.getsource(sys.modules[module]))
    return {of.name: of.body for of in tree.body if isinstance(of, ast.ClassDef)}
