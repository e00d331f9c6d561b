"""Sets a program up that identifies actuators: double precision, fast loops, compiled code kept, less garbage sought.

Importing pdssjax changes nothing global; programs (the command line, the tests, the
experiments) call `prepare_jax` before anything is traced.
"""

import contextlib
import ctypes
import os
import sys
from pathlib import Path

import jax
import platformdirs
from jaxlib.version import __version__ as jaxlib_version

from .garbage import seldom_look_for_garbage


def cache_folder() -> Path:
    """Where compiled code is kept: the environment's `PDSSJAX_CACHE`, or else the user's cache folder."""
    return Path(os.environ.get("PDSSJAX_CACHE") or platformdirs.user_cache_dir("pdssjax", appauthor=False))


_FLAGS = (
    "--xla_cpu_use_fusion_emitters=false",
    "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000",
)
"""How XLA compiles for a CPU.

Each kernel is emitted without setting up MLIR for it: a fit's function then takes a fifth of the memory and three
fifths of the time to compile, and runs as fast.  And a loop is one kernel whatever it touches, not only below 1 kB: a
step of an integration is some hundred kernels of a few numbers each, and starting them took longer than what they
compute.
"""

_KNOWN_TO = ("0.10.",)
"""Versions of jaxlib that know the flags: one that does not would end the process."""


def _tell_xla() -> None:
    """Add the flags to XLA's, which it reads when the first computation is asked for, unless the user gave them."""
    given = os.environ.get("XLA_FLAGS", "")
    in_a_file = bool(given) and not given.lstrip().startswith("-")
    if jaxlib_version.startswith(_KNOWN_TO) and not in_a_file:
        missing = [flag for flag in _FLAGS if flag.partition("=")[0] not in given]
        os.environ["XLA_FLAGS"] = " ".join([given, *missing]).strip()


_MOST_ARENAS, _ARENAS = -8, 2
"""The parameter of glibc's `mallopt` (M_ARENA_MAX), and its value."""


def _share_free_memory() -> None:
    """Let threads take memory from two pools, where glibc gives each up to one of its own.

    XLA compiles in many threads for a moment each, and what they free stays in their pools: an eighth of the memory of
    the very first identification.
    """
    if sys.platform == "linux":
        with contextlib.suppress(OSError, AttributeError):  # another C library
            ctypes.CDLL(None).mallopt(_MOST_ARENAS, _ARENAS)


def prepare_jax() -> None:
    """Switch on 64-bit numbers, loops of one kernel and, where it can be written to, the cache of compiled code.

    Less garbage is looked for, too, and memory that is free is shared by the threads.

    What a program calls before JAX computes anything; later, loops stay as they are.  Flags of XLA that the environment
    gives already are left alone, and compiled code is kept where its `PDSSJAX_CACHE` says.
    """
    _tell_xla()
    _share_free_memory()
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
