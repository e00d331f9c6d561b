"""Finds the members of an open family: one file a member, no registry to edit.

A family is a package such as `pdssjax.friction`.  Its member "anisotropic-lugre" is the
one public class defined in `pdssjax/friction/anisotropic_lugre.py`.
"""

import importlib
from pathlib import Path
from typing import Any


def members(family: str) -> list[str]:
    """Names of the members of a family ("drive", "piezo", "friction", "simulation.systems", ...), sorted."""
    package = importlib.import_module(f"pdssjax.{family}")
    # `pkgutil` would do, and load `inspect` with it, which is a tenth of the time in which the command line starts.
    files = (file.stem for folder in package.__path__ for file in Path(folder).glob("*.py"))
    # A `_file` inside a family is a helper of its members.
    return sorted(name.replace("_", "-") for name in files if name != "base" and not name.startswith("_"))


def member(family: str, name: str) -> type:
    """The class of the member `name`; `KeyError` where the family has no such member.

    Of a member that has variants, "composed:static+play-8" names one, as its `variant` understands it.
    """
    name, mark, variant = name.partition(":")
    if name not in members(family):
        raise KeyError(name)
    module = importlib.import_module(f"pdssjax.{family}.{name.replace('-', '_')}")
    local = [c for c in vars(module).values() if isinstance(c, type) and c.__module__ == module.__name__]
    public = [c for c in local if not c.__name__.startswith("_")]
    if len(public) != 1:
        raise TypeError(f"{module.__name__} must define exactly one public class, but defines {public}")
    found: Any = public[0]
    return found.variant(variant) if mark else found


def member_name(model: type) -> str:
    """The name of the member that a class of a family is: that of its file, and of its variant where it is one."""
    name, variant = model.__module__.rpartition(".")[2].replace("_", "-"), getattr(model, "variant_name", "")
    return f"{name}:{variant}" if variant else name


def docstring_of(module: str, name: str = "") -> str:
    """The docstring of a `module` of pdssjax ("friction.lugre"), or of its class `name`; read without loading it."""
    import ast

    package, _, last = f"pdssjax.{module}".rpartition(".")
    (folder,) = importlib.import_module(package).__path__
    found: Any = ast.parse((Path(folder) / f"{last}.py").read_bytes())
    if name:
        (found,) = (part for part in found.body if isinstance(part, ast.ClassDef) and part.name == name)
    return ast.get_docstring(found, clean=False) or ""
