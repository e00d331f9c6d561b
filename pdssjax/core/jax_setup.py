"""Sets a program up that identifies actuators: double precision, code compiled lightly and kept, less garbage sought.

Importing pdssjax changes nothing global; programs (the command line, the tests, the
experiments) call `prepare_jax` before anything is traced.
"""

import contextlib
import os
from pathlib import Path

import jax
import platformdirs
from jaxlib.version import __version__ as jaxlib_version

from .garbage import seldom_look_for_garbage


def cache_folder() -> Path:
    """Where compiled code is kept: the environment's `PDSSJAX_CACHE`, or else the user's cache folder."""
    return Path(os.environ.get("PDSSJAX_CACHE") or platformdirs.user_cache_dir("pdssjax", appauthor=False))


_LIGHT = "--xla_cpu_use_fusion_emitters=false"
"""Whole loops are emitted at once, without setting up MLIR for each of the hundreds of small kernels of a step.

A fit's function then takes a fifth of the memory and three fifths of the time to compile, and runs as fast.
"""

_KNOWN_TO = ("0.10.",)
"""Versions of jaxlib that know the flag: one that does not would end the process."""


def _compile_lightly() -> None:
    """Tell XLA, which reads its flags when the first computation is asked for, unless the user told it already."""
    given = os.environ.get("XLA_FLAGS", "")
    in_a_file = bool(given) and not given.lstrip().startswith("-")
    if jaxlib_version.startswith(_KNOWN_TO) and _LIGHT.partition("=")[0] not in given and not in_a_file:
        os.environ["XLA_FLAGS"] = f"{given} {_LIGHT}".strip()


def prepare_jax() -> None:
    """Switch on 64-bit numbers, light compilation and, where it can be written to, the cache of compiled code."""
    _compile_lightly()
    seldom_look_for_garbage()
    jax.config.update("jax_enable_x64", True)
    folder = cache_folder()
    # JAX itself would warn at every function it compiles.
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    if os.access(folder, os.W_OK | os.X_OK):
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def need_double_precision() -> None:
    """**Raises** `ValueError` where JAX computes in single precision, which cannot locate events."""
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        raise ValueError(
            "Expected JAX in double precision, but it is in single; "
            'call jax.config.update("jax_enable_x64", True) first.'
        )
