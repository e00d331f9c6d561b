"""Sets JAX up for a program that identifies actuators: double precision, compiled code kept.

Importing pdssjax changes nothing global; programs (the command line, the tests, the
experiments) call `prepare_jax` before anything is traced.
"""

import contextlib
import os
from pathlib import Path

import jax
import platformdirs


def cache_folder() -> Path:
    """Where compiled code is kept: the environment's `PDSSJAX_CACHE`, or else the user's cache folder."""
    return Path(os.environ.get("PDSSJAX_CACHE") or platformdirs.user_cache_dir("pdssjax", appauthor=False))


def prepare_jax() -> None:
    """Switch on 64-bit numbers and, where it can be written to, the cache of compiled code."""
    jax.config.update("jax_enable_x64", True)
    folder = cache_folder()
    # JAX itself would warn at every function it compiles.
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    if os.access(folder, os.W_OK | os.X_OK):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
