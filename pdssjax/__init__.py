"""Differentiable models and joint identification of piezoelectric stick-slip actuators."""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .estimation import FitInterrupted as FitInterrupted
    from .estimation import identify as identify
    from .guessing import initial_guess as initial_guess
    from .simulation import simulate as simulate
    from .study import load_study as load_study
    from .sweeping import sweep as sweep

_HOMES = {
    "FitInterrupted": "estimation",
    "identify": "estimation",
    "initial_guess": "guessing",
    "load_study": "study",
    "simulate": "simulation",
    "sweep": "sweeping",
}


def __getattr__(name: str) -> Any:
    # Loaded on first use: JAX and its solvers take a second, for which `pdssjax --help` need not wait.
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
