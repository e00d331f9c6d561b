"""Re-exports that are loaded on first use, so that the face of a room costs nothing until a name is asked for."""

import ast
import importlib
import sys
from collections.abc import Callable


def lazy_exports(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of `package`, from the imports under `if TYPE_CHECKING:` in its source.

    So a face names each export once, where type checkers read it.  Python asks a module's `__getattr__` for what the
    module does not hold (PEP 562); a loaded value is kept in the module.
    """
    module = sys.modules[package]
    source = module.__loader__.get_source(package)  # pyright: ignore[reportAttributeAccessIssue, reportOptionalMemberAccess]
    if source is None:
        raise ImportError(f"found no source of {package}, expected it beside its compiled code: it names the exports")
    homes = {
        alias.asname or alias.name: (f"{'.' * statement.level}{statement.module or ''}", alias.name)
        for block in ast.parse(source).body
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name) and block.test.id == "TYPE_CHECKING"
        for statement in block.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }

    def get(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home, original = homes[name]
        value = getattr(importlib.import_module(home, package), original)
        setattr(module, name, value)
        return value

    return get, lambda: sorted(homes), sorted(homes)
