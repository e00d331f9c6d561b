"""Types: every public function says what it takes and gives, with shapes, and a swapped argument is found."""

import ast
import functools
import importlib.util
import inspect
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import pdssjax

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pdssjax"
MODULES = sorted(PACKAGE.rglob("*.py"))
SHAPED = {"Float", "Int", "Bool", "Complex", "Num", "Shaped", "UInt8", "Key"}
"""Of jaxtyping: what stands inside their brackets is an array with its shape."""
BARE = {"tuple", "dict", "list", "set", "frozenset", "Callable", "Mapping", "Sequence", "Iterable", "Iterator"}
"""Say nothing of what they hold unless they are followed by brackets."""
ARRAYS = {"Array", "ndarray"}
"""Say nothing of their shape unless they stand inside one of `SHAPED`."""


@functools.cache
def tree(path: Path) -> ast.Module:
    """The parsed source of a file."""
    return ast.parse(path.read_text(encoding="utf-8"))


FunctionNode = ast.FunctionDef | ast.AsyncFunctionDef


def last_name(node: ast.expr) -> str:
    """The name of a type without its module: "ndarray" of np.ndarray."""
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def weaknesses(annotation: ast.expr | None) -> set[str]:
    """What in an annotation says nothing: "missing", "Any", or the name of a bare container or array."""
    if annotation is None:
        return {"missing"}
    if isinstance(annotation, ast.Constant) and isinstance(annotation.value, str):
        return weaknesses(ast.parse(annotation.value, mode="eval").body)
    name = last_name(annotation)
    if name:
        return {name} & ({"Any"} | BARE | ARRAYS)
    if isinstance(annotation, ast.Subscript):
        outer = last_name(annotation.value)
        if outer in SHAPED or outer in ("Literal", "Annotated"):
            return set()
        return weaknesses(annotation.slice)
    return set().union(*(weaknesses(node) for node in ast.iter_child_nodes(annotation) if isinstance(node, ast.expr)))


def parameters(function: FunctionNode, of_class: bool) -> list[ast.arg]:
    """The parameters of a function, without the instance or the class."""
    given = function.args
    static = any(last_name(d) == "staticmethod" for d in function.decorator_list)
    first = [*given.posonlyargs, *given.args][1 if of_class and not static else 0 :]
    return [*first, *given.kwonlyargs, *(arg for arg in (given.vararg, given.kwarg) if arg is not None)]


def public(name: str) -> bool:
    return not name.startswith("_") or name in ("__init__", "__call__")


def declared(body: list[ast.stmt], of_class: str = "") -> Iterator[tuple[str, ast.expr | None]]:
    """Names and annotations of all that a module declares in public: parameters, results, fields."""
    for node in body:
        if isinstance(node, ast.ClassDef) and public(node.name):
            yield from declared(node.body, node.name)
        elif isinstance(node, FunctionNode) and public(node.name):
            name = f"{of_class}.{node.name}".lstrip(".")
            for arg in parameters(node, bool(of_class)):
                yield f"{name}({arg.arg})", arg.annotation
            if node.name != "__init__":
                yield f"{name} ->", node.returns
        elif of_class and isinstance(node, ast.AnnAssign) and public(ast.unparse(node.target)):
            yield f"{of_class}.{ast.unparse(node.target)}", node.annotation


def weak(path: Path) -> list[str]:
    """All that a module declares in public with a type that says nothing."""
    where = path.relative_to(PACKAGE)
    found = [(name, weaknesses(annotation)) for name, annotation in declared(tree(path).body)]
    return [f"{where}: {name} {sorted(what)}" for name, what in found if what]


def test_what_is_public_has_types_that_say_something():
    for path in MODULES:
        assert not weak(path)


@pytest.mark.parametrize(
    ("declaration", "found"),
    [
        ("def f(x) -> int: ...", ["f(x)"]),
        ("def f(x: int): ...", ["f ->"]),
        ("def f(x: dict[str, Any]) -> int: ...", ["f(x)"]),
        ("def f(x: np.ndarray) -> Array: ...", ["f(x)", "f ->"]),
        ("def f(x: 'tuple | None', y: Callable[..., int]) -> list[int]: ...", ["f(x)"]),
        ("class C:\n    x: Any\n    def f(self, *rest, flag: bool) -> None: ...", ["C.x", "C.f(rest)"]),
        ("def f(x: Float[np.ndarray, ' n'], y: Callable[[int], str]) -> Literal['Any']: ...", []),
        ("def _f(x): ...\nclass _C:\n    def f(self, x): ...", []),
    ],
)
def test_types_that_say_nothing_are_seen(declaration, found):
    assert [name for name, annotation in declared(ast.parse(declaration).body) if weaknesses(annotation)] == found


def test_a_type_that_stands_for_anything_says_why():
    """`Any` is called by a name then, with a docstring below it."""
    for path in MODULES:
        body = tree(path).body
        for node, below in zip(body, [*body[1:], None], strict=True):
            if isinstance(node, ast.AnnAssign) and node.value is not None and "Any" in ast.unparse(node.value):
                told = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
                assert told, f"{path.relative_to(ROOT)}: {ast.unparse(node.target)} stands for Any and does not say why"


SETTING = """
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pdssjax import (
    AbstractDrive,
    AbstractFriction,
    AbstractHybridSystem,
    AbstractPiezo,
    Accuracy,
    Actuator,
    Effector,
    Record,
    Study,
    identify,
    pose_problem,
    simulate,
    sweep,
)
from pdssjax.friction.lugre import LuGre
from pdssjax.inference import Problem
from pdssjax.integration import integrate_steps, states_at
from pdssjax.piezo.second_order import SecondOrder
from pdssjax.simulation import StickSlip, sensor_samples
from pdssjax.study import Models, compare, depends_on, numbers_used


def calls(
    path: Path,
    study: Study,
    problem: Problem,
    record: Record,
    actuator: Actuator,
    drive: AbstractDrive,
    law: AbstractFriction,
    piezo: AbstractPiezo,
    models: Models,
    system: AbstractHybridSystem,
    accuracy: Accuracy,
    starts: dict[str, float],
) -> None:
    times = jnp.linspace(0.0, 1.0, 9)
    segment = drive.segment(times[0])
    voltage = segment.voltage(0.0)
    rig = StickSlip(actuator, drive)
"""
RIGHT = """
    identify(study, "joint", accuracy=accuracy)
    problem.whitened(problem.encode(starts))
    simulate(actuator, drive, times, accuracy)
    Actuator(SecondOrder(), LuGre(), Effector(0.086))
    sensor_samples(system, times, accuracy)
    integrate_steps(system, times[-1], accuracy)
    law.force(law.initial(), times[0], 1.0)
    compare(record, record.measured, noise=1e-8, offset=0.0)
    study.predict(starts, accuracy)
    piezo.rate(piezo.initial(), voltage, 0.0)
    rig.field(segment, times[0], rig.initial(), times[0])
    states_at(system, integrate_steps(system, times[-1], accuracy), times)
    models.contact({"friction.sigma0": times[0], "friction.sigma1": 45.0})
    sweep(study, {"drive.voltage": times, "drive.frequency": np.array([5.0])})
"""
SWAPPED = """
    identify(path)
    identify(accuracy)
    identify(study, "both")
    identify(study, "joint", accuracy=1e-12)
    pose_problem(study, 1e-12)
    problem.encode(times)
    problem.whitened(starts)
    problem.whitened(problem)
    simulate(drive, actuator, times)
    simulate(actuator, drive, accuracy)
    simulate(actuator, times, drive)
    simulate(actuator, drive, path)
    Actuator(LuGre(), SecondOrder())
    Actuator(SecondOrder(), LuGre(), 0.086)
    Actuator(SecondOrder(), LuGre(), Effector(path))
    sensor_samples(accuracy, times, system)
    sensor_samples(system, accuracy, times)
    integrate_steps(system, accuracy, times[-1])
    law.force(times[0], law.initial(), 1.0)
    law.on_reversal(1.0, law.initial())
    drive.at(path)
    compare(study.records, record.measured, noise=1e-8, offset=0.0)
    compare(record, study.predict(), noise=1e-8, offset=0.0)
    compare(record, record.measured, noise=path, offset=0.0)
    study.predict(accuracy, starts)
    study.with_values([record])
    drive.with_numbers(times)
    problem.decode(starts)
    problem.jacobian(study)
    drive.segment(path)
    segment.voltage(segment)
    piezo.rate(voltage, piezo.initial(), 0.0)
    piezo.acceleration(piezo.initial(), 64.0)
    piezo.motion(piezo.initial(), times[0], segment, times[0])
    law.rate(law.initial(), 1.0, law)
    law.on_reversal(law.initial(), path)
    system.guards(segment, times[0], rig.initial(), path)
    rig.field(times[0], segment, rig.initial(), times[0])
    rig.after_event(segment, times[0], times[0], rig.initial(), times[0])
    rig.force(segment, rig.initial(), times[0], times[0])
    rig.shown_displacement(times)
    integrate_steps(system, path, accuracy)
    states_at(system, system, times)
    models.actuator(accuracy)
    models.contact({"friction.sigma0": path})
    depends_on(models, models, [])
    numbers_used(study, 1.0)
    sweep(study, {"drive.voltage": path})
    sweep(study, study)
    study.predict({"piezo.gain": path})
"""


def test_what_pdssjax_offers_takes_no_two_arguments_of_one_type_by_position():
    """So that the checker finds any two that are swapped; of one type they are named."""
    for name in pdssjax.__all__:
        offered = getattr(pdssjax, name)
        if inspect.isfunction(inspect.unwrap(offered)):
            given = inspect.signature(offered).parameters.values()
            types = [str(p.annotation) for p in given if p.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD]
            assert len(types) == len(set(types)), f"{name}: {types}"


@pytest.mark.slow  # the checker reads all of JAX: some 8 s
@pytest.mark.skipif(importlib.util.find_spec("basedpyright") is None, reason="basedpyright is not installed")
def test_a_swapped_argument_is_found(tmp_path):
    (tmp_path / "calls.py").write_text(SETTING + RIGHT + SWAPPED, encoding="utf-8")
    setting = {"include": ["calls.py"], "extraPaths": [str(ROOT)], "typeCheckingMode": "standard"}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(setting), encoding="utf-8")
    command = [sys.executable, "-m", "basedpyright", "--outputjson", "--pythonpath", sys.executable]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    lines = (SETTING + RIGHT + SWAPPED).splitlines()
    wrong = {lines[error["range"]["start"]["line"]].strip() for error in json.loads(done.stdout)["generalDiagnostics"]}
    assert wrong == {line.strip() for line in SWAPPED.strip().splitlines()}
