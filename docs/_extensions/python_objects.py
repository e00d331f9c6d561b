"""A public name as Markdown: its signature as it is written, its docstring, its fields or methods.

Docstrings are Markdown, which autodoc would take for reStructuredText; so they are put into the page as they are.
"""

import ast
import dataclasses
import importlib
import inspect
import re
import textwrap
from collections.abc import Iterator

from pdssjax.core import Quantity, choices, display_unit, member, members, quantities


def found(path: str) -> object:
    """The object of a dotted path; its module is imported."""
    parts = path.split(".")
    for split in range(len(parts) - 1, 0, -1):
        try:
            thing: object = importlib.import_module(".".join(parts[:split]))
        except ModuleNotFoundError:
            continue
        for name in parts[split:]:
            thing = getattr(thing, name)
        return thing
    raise ValueError(f"no module of {path}")


def defined(thing: object) -> ast.FunctionDef | ast.ClassDef:
    """The definition of a function or class, as it is written."""
    node = ast.parse(textwrap.dedent(inspect.getsource(thing))).body[0]  # pyright: ignore[reportArgumentType]
    assert isinstance(node, ast.FunctionDef | ast.ClassDef)
    return node


def is_written(thing: type) -> bool:
    """Whether a class stands in a file; what a family makes of a name while it runs does not."""
    try:
        inspect.getsource(thing)
    except (OSError, TypeError):
        return False
    return True


def signature(function: ast.FunctionDef, method: bool) -> str:
    """Parameters and result as they are written, with shapes; without the instance."""
    given = function.args
    static = any(ast.unparse(d) == "staticmethod" for d in function.decorator_list)
    if method and not static and given.args:
        given.args = given.args[1:]
    result = f" -> {ast.unparse(function.returns)}" if function.returns is not None else ""
    result = re.sub(r"^ -> '([\w.]+)'$", r" -> \1", result)  # a name that is written in quotes for Python's sake
    return f"({ast.unparse(given)}){result}".replace("\n", " ")


def fields(thing: type, skip_class_variables: bool = False) -> dict[str, tuple[str, str]]:
    """Of every public field of a class, its type as written and the docstring below it."""
    told: dict[str, tuple[str, str]] = {}
    for base in reversed(thing.__mro__):
        if not base.__module__.startswith("pdssjax") or not hasattr(base, "__annotations__"):
            continue
        if not is_written(base):
            continue
        body = defined(base).body
        for node, below in zip(body, [*body[1:], None], strict=True):
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
                value = below.value if isinstance(below, ast.Expr) else None
                text = value.value if isinstance(value, ast.Constant) and isinstance(value.value, str) else ""
                written = ast.unparse(node.annotation)
                if not node.target.id.startswith("_") and not (written.startswith("ClassVar") and skip_class_variables):
                    told[node.target.id] = written, " ".join(text.split())
    return told


def methods(thing: type) -> Iterator[tuple[str, ast.FunctionDef, str]]:
    """The public methods that a class defines itself, with their docstrings, inherited ones where they have none."""
    body = defined(thing).body if is_written(thing) else []
    for node in {n.name: n for n in body if isinstance(n, ast.FunctionDef)}.values():  # overloads once
        if not node.name.startswith("_"):
            attribute = inspect.getattr_static(thing, node.name)
            text = inspect.getdoc(getattr(attribute, "func", attribute)) or inspect.getdoc(getattr(thing, node.name))
            yield node.name, node, text or ""


def is_property(function: ast.FunctionDef) -> bool:
    return any("property" in ast.unparse(d) for d in function.decorator_list)


def block(kind: str, head: str, text: str, depth: int = 0, result: str = "") -> list[str]:
    """One object of the Python domain, its text below it; of a property, its type."""
    fence = ":" * (8 - depth)
    told = [f":type: {result}"] if result else []
    return [f"{fence}{{py:{kind}}} {head}", *told, "", *text.splitlines(), "", fence, ""]


def cell(text: str) -> str:
    return text.replace("|", "\\|")


def number(declared: Quantity) -> str:
    unit, scale = display_unit(declared.unit)
    return f"{declared.nominal * scale:.6g} {unit}".replace("um", "µm").strip()


def field_table(thing: type, skip_class_variables: bool = False) -> list[str]:
    """Fields with type or unit and nominal value."""
    told, declared, words = (
        fields(thing, skip_class_variables),
        quantities(thing) if dataclasses.is_dataclass(thing) else {},
        {},
    )
    if dataclasses.is_dataclass(thing):
        words = choices(thing)
    if not told:
        return []
    rows = []
    for name, (written, text) in told.items():
        if name in declared:
            kind = f"[{declared[name].unit or '1'}], nominal {number(declared[name])}"
        elif name in words:
            kind = "one of " + ", ".join(f"`{word}`" for word in words[name])
        else:
            kind = f"`{cell(written)}`"
        rows.append(f"| `{name}` | {kind} | {cell(text)} |")
    return ["| field | type or unit | |", "|---|---|---|", *rows, ""]


def markdown(path: str, shown_methods: bool = True) -> list[str]:
    """The lines that show the object of a path."""
    thing = found(path)
    text = inspect.cleandoc(getattr(thing, "__doc__", "") or "")
    if not isinstance(thing, type):
        node = defined(thing)
        assert isinstance(node, ast.FunctionDef)
        return block("function", path + signature(node, method=False), text)
    inner = [*text.splitlines(), "", *field_table(thing)]
    if shown_methods:
        for name, node, told in methods(thing):
            if is_property(node):
                inner += block("property", name, told, 1, ast.unparse(node.returns) if node.returns else "")
            else:
                inner += block("method", name + signature(node, method=True), told, 1)
    return block("class", path, "\n".join(inner))


def family_lines(family: str) -> list[str]:
    """Every member of a family, with the equations at the head of its file, and its parameters."""
    lines: list[str] = []
    for name in members(family):
        model = member(family, name)
        text = inspect.cleandoc(importlib.import_module(model.__module__).__doc__ or "")
        said = [] if family.startswith("inference") else [f"In a study: `{name}`.", ""]
        told = "\n".join([*said, *text.splitlines(), "", *field_table(model, skip_class_variables=True)])
        lines += block("class", f"{model.__module__}.{model.__name__}", told)
    return lines
