"""Re-exports that are loaded on first use, so that the face of a room costs nothing until a name is asked for."""

import importlib
import re
import sys
from collections.abc import Callable

_IMPORT = re.compile(r"^    from (\.\S*) import (?:\(([^)]*)\)|(.*))$", re.MULTILINE)
"""An import as the formatter writes it.  `ast` would read any, and take a tenth of the time until `--help` is shown."""


def lazy_exports(package: str) -> tuple[Callable[[str], object], Callable[[], list[str]], list[str]]:
    """`__getattr__`, `__dir__` and `__all__` of `package`, from the imports under `if TYPE_CHECKING:` in its source.

    So a face names each export once, where type checkers read it.  Python asks a module's `__getattr__` for what the
    module does not hold (PEP 562); a loaded value is kept in the module.

    **Raises:** `ImportError` where the source is missing.
    """
    module = sys.modules[package]
    loader = module.__loader__
    source = loader.get_source(package)  # pyright: ignore[reportAttributeAccessIssue, reportOptionalMemberAccess]
    if source is None:
        raise ImportError(f"found no source of {package}, expected it beside the compiled code: it names the exports")
    typed = source.partition("if TYPE_CHECKING:\n")[2].partition("\nelse:\n")[0]
    homes = {
        shown or name: (home, name)
        for home, several, one in _IMPORT.findall(typed)
        for name, shown in re.findall(r"(\w+)(?: as (\w+))?", several or one)
    }

    def get(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        home, original = homes[name]
        value = getattr(importlib.import_module(home, package), original)
        setattr(module, name, value)
        return value

    return get, lambda: sorted(homes), sorted(homes)
