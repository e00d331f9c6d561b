"""What is measured: one job a file, each with a function `measure(effort)`."""

import importlib
import pkgutil
from collections.abc import Callable

from ..measure import Effort, Outcome

ORDER = ("trajectory", "jacobian", "fit", "sweep", "predict", "growth", "startup", "steps")
"""The jobs as the table shows them; any other comes after these.  Where time runs out, the last are left out."""


def jobs() -> dict[str, Callable[[Effort], Outcome]]:
    """All jobs by name."""
    names = [module.name for module in pkgutil.iter_modules(__path__)]
    ordered = sorted(names, key=lambda name: (ORDER.index(name) if name in ORDER else len(ORDER), name))
    return {name: importlib.import_module(f"{__name__}.{name}").measure for name in ordered}
