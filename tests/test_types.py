"""Types: every public function says what it takes and gives, with shapes, and a swapped argument is found."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pdssjax"
MODULES = sorted(PACKAGE.rglob("*.py"))

SHAPED = {"Float", "Int", "Bool", "Complex", "Num", "Shaped", "UInt8", "Key"}
"""Of jaxtyping: what stands inside their brackets is an array with its shape."""

BARE = {"tuple", "dict", "list", "set", "frozenset", "Callable", "Mapping", "Sequence", "Iterable", "Iterator"}
"""Say nothing of what they hold unless they are followed by brackets."""

ARRAYS = {"Array", "ndarray"}
"""Say nothing of their shape unless they stand inside one of `SHAPED`."""

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
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and of_class:
            if public(node.target.id):
                yield f"{of_class}.{node.target.id}", node.annotation


def weak(path: Path) -> list[str]:
    """All that a module declares in public with a type that says nothing."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    where = path.relative_to(PACKAGE)
    found = [(name, weaknesses(annotation)) for name, annotation in declared(tree.body)]
    return [f"{where}: {name} {sorted(what)}" for name, what in found if what]


if __name__ == "__main__":
    every = [line for path in MODULES for line in weak(path)]
    print("\n".join(every))
    print(len(every))
