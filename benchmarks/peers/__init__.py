"""Everyone who can do the run: one simulator a file, each with a tuple `PEERS`."""

import importlib
import pkgutil

from .base import AbstractPeer


def peers() -> list[AbstractPeer]:
    """All of them, in the order of their files, whether they can run here or not."""
    names = sorted(module.name for module in pkgutil.iter_modules(__path__) if module.name != "base")
    return [peer for name in names for peer in importlib.import_module(f"{__name__}.{name}").PEERS]
