"""Every public name says what it is; where it has arrays, their shapes and units; where it raises, what."""

import ast
import functools
import inspect
import re
from pathlib import Path

import pytest
from python_objects import defined, fields, found, is_property, methods

from pdssjax.core import member, members

ROOT = Path(__file__).parents[1]
PATHS = re.findall(
    r"\{python-object\} (\S+)", "".join(p.read_text("utf-8") for p in sorted((ROOT / "docs/reference").glob("*.md")))
)
FAMILIES = "drive", "piezo", "friction", "study.measurement", "inference.losses", "inference.uncertainty.error_models"
MEMBERS = [member(family, name) for family in FAMILIES for name in members(family)]
NAMES = [*PATHS, *(f"{model.__module__}.{model.__qualname__}" for model in MEMBERS)]
ARRAY = re.compile(r"\b(?:Float|Int|Bool|Num|Complex|Shaped)\[")
UNIT = re.compile(r"\[[^\]\s]+(?: [^\]]+)?\]|\bSI\b|\bunits?\b|\bscale of the fit\b|\bdivided by\b")
"""A unit in brackets, or a word that says which: SI, the unit of something, the scale on which a fit works."""


@functools.cache
def functions(path: str) -> list[tuple[str, ast.FunctionDef, str]]:
    """A public function, or the public methods that a class defines, each with its docstring."""
    thing = found(path)
    if isinstance(thing, type):
        return [(f"{path}.{name}", node, text) for name, node, text in methods(thing)]
    node = defined(thing)
    assert isinstance(node, ast.FunctionDef)
    return [(path, node, inspect.getdoc(thing) or "")]


def annotations(node: ast.FunctionDef) -> list[str]:
    """The types of parameters and result, as written."""
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    return [ast.unparse(a) for a in (*(arg.annotation for arg in given), node.returns) if a is not None]


def test_every_public_name_has_a_docstring():
    for path in NAMES:
        assert inspect.getdoc(found(path)), path
        assert all(text for _, _, text in functions(path)), path


def test_arrays_say_their_shape_and_their_unit():
    for path in NAMES:
        whole = inspect.getdoc(found(path)) or ""
        for name, node, text in functions(path):
            if any(ARRAY.search(written) for written in annotations(node)):
                assert UNIT.search(text) or UNIT.search(whole), f"{name} says no unit"


def test_fields_that_are_arrays_say_their_unit():
    for path, thing in ((path, found(path)) for path in NAMES):
        whole = inspect.getdoc(thing) or ""
        for name, (written, text) in fields(thing).items() if isinstance(thing, type) else ():
            if re.search(r"\b(?:Float|Num)\[", written):
                assert UNIT.search(text) or UNIT.search(whole), f"{path}.{name} says no unit"


def test_what_raises_says_so():
    for path in NAMES:
        for name, node, text in functions(path):
            raised = {ast.unparse(n.exc).split("(")[0] for n in ast.walk(node) if isinstance(n, ast.Raise) and n.exc}
            assert not raised - {"NotImplementedError"} or "raises" in text.lower(), f"{name} raises {raised}"


def test_properties_are_told_from_methods():
    study = {name: is_property(node) for name, node, _ in methods(found("pdssjax.Study"))}
    assert study["models"] and not study["predict"]


@pytest.mark.parametrize(
    ("text", "told"), [("time [s]", True), ("in SI", True), ("the numbers", False), ("one of [a list", False)]
)
def test_units_are_recognised(text, told):
    assert bool(UNIT.search(text)) is told
