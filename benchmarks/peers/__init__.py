"""Everyone who can do the run: one simulator a file, each with a tuple `PEERS`."""

import importlib
import pkgutil

from .base import AbstractPeer


def peers() -> list[AbstractPeer]:
    """All of them, in the order of their files, whether they can run here or not."""
    found = [module.name for module in pkgutil.iter_modules(__path__)]
    names = sorted(name for name in found if name != "base" and not name.startswith("_"))
    return [peer for name in names for peer in importlib.import_module(f"{__name__}.{name}").PEERS]
