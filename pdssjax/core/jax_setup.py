"""Sets JAX up for a program that identifies actuators: double precision, fast loops, compiled code kept and checked.

Importing pdssjax changes nothing global; programs (the command line, the tests, the experiments) call `prepare_jax`
before anything is traced.

jaxlib 0.10.2 adds up the products of the last of 16 385 rows from the wrong place on a CPU, and says nothing
(jax issue 39103); 16 384 rows come out right.  A small program that such a jaxlib fails is run once.
"""

import contextlib
import ctypes
import functools
import hashlib
import importlib.metadata
import mmap
import os
import platform
import re
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

import jax
import jax.numpy as jnp
import jaxlib
import numpy as np
import platformdirs
from jaxlib.version import __version__ as jaxlib_version
from jaxtyping import Array, Float

from .errors import InputError, InputWarning, MiscompilationError
from .kept_programs import keep_programs_in
from .process import raise_gc_threshold

Task = TypeVar("Task")
Result = TypeVar("Result")

_ROWS = 16_385
"""One more than XLA's kernels for a CPU take at once, in double precision."""


def check_compiler(folder: Path | None) -> None:
    """Compile and run the program, unless it was right before with this jaxlib, processor and flags.

    **Arguments:** `folder`, where an empty file says that it was; without one it is run once a process.

    **Raises** `MiscompilationError` where a result is wrong.
    """
    circumstances = _circumstances()
    if folder is None:
        _run_once(circumstances)
        return
    stamp = folder / f"compiler-checked-{hashlib.sha256(circumstances.encode()).hexdigest()[:32]}"
    if not stamp.exists():
        _run_once(circumstances)
        with contextlib.suppress(OSError):
            stamp.write_bytes(b"")


@functools.cache
def _run_once(circumstances: str) -> None:
    """Under given `circumstances`; an exception is not remembered."""
    del circumstances
    first = np.arange(_ROWS, dtype=float)
    rows = np.stack([first, 0.0 * first, 0.0 * first], axis=1)
    found, expected = np.asarray(_squares(np.eye(3), rows)), first**2
    wrong = np.flatnonzero(found != expected)
    if wrong.size:
        row = wrong[0]
        flags = os.environ.get("XLA_FLAGS")
        raise MiscompilationError(
            f"jaxlib {jaxlib_version} computes wrongly here"
            + (f" with XLA_FLAGS={flags}" if flags else "")
            + f": the squared length of {_ROWS} rows times the unit matrix is wrong for {wrong.size} of them "
            f"(row {row}: found {found[row]:.0f}, expected {expected[row]:.0f}).\n"
            f"Results would be wrong without a word. Install another version: "
            f"pip install 'jax>=0.10.1,!={jaxlib_version}' 'jaxlib!={jaxlib_version}'"
        )


@jax.jit
def _squares(matrix: Float[Array, "3 3"], rows: Float[Array, "rows 3"]) -> Float[Array, " rows"]:
    return jax.vmap(lambda row: jnp.sum((matrix @ row) ** 2))(rows)


def _circumstances() -> str:
    """The settings that compiled code depends on, as far as known before JAX looks for its devices."""
    platforms, flags = jax.config.jax_platforms, os.environ.get("XLA_FLAGS", "")  # pyright: ignore[reportAttributeAccessIssue]
    return "\n".join([jax.__version__, jaxlib_version, str(platforms), flags, _processor()])


def _processor() -> str:
    """Model and instruction sets of the processor, where Linux tells; elsewhere what Python knows of it."""
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as file:
        lines = []
        for line in file:
            if not line.strip():  # the first core ends
                break
            if line.startswith(("model name", "flags", "CPU part", "Features")):
                lines.append(line)
        return platform.machine() + "".join(lines)
    return platform.machine() + platform.processor()


def cache_folder() -> Path:
    """Where compiled code is kept: the environment's `PDSSJAX_CACHE`, or else the user's cache folder."""
    return Path(os.environ.get("PDSSJAX_CACHE") or platformdirs.user_cache_dir("pdssjax", appauthor=False))


_EMITTERS = "--xla_cpu_use_fusion_emitters=false"
"""Each kernel is emitted without setting up MLIR for it: a fit's function then takes a fifth of the memory and three
fifths of the time to compile, and runs as fast.  jaxlib 0.11.1 dropped the flag; 0.12 compiles in that time without it,
in a fifth more memory."""

_LOOPS = "--xla_backend_extra_options=xla_cpu_small_while_loop_byte_threshold=1000000000"
"""Up to how many bytes a loop touches it is one kernel: of more it is a kernel for each operation.  A step of an
integration is some hundred kernels of a few numbers each, and starting them took longer than what they compute."""

_LEVEL = "--xla_backend_optimization_level=1"
"""LLVM's level of optimisation for a CPU: the example's fit compiles in a fifth less time than at the usual third
level, and the loops over steps run as fast (docs/decisions/12-loop-over-the-order.md)."""

_PASSES = "--xla_disable_hlo_passes=tree_reduction_rewriter,while-loop-invariant-code-motion"
"""What XLA is not to do.  Its tree of sums of 32 numbers each is pages of LLVM code, where a loop is a line.  What it
moves out of a loop is carried through the kernels of all loops around it: without that a fit's function compiles in a
tenth less time and a trajectory in a third less, and both run as fast (docs/decisions/12-loop-over-the-order.md)."""

_PARTS = "--xla_cpu_parallel_codegen_split_count=1"
"""Into how many parts a function is split to be compiled in threads of their own: the loops, which most of the time
goes into, are parts of their own anyway, and 32 parts take 4 % more."""

_WITHOUT_EMITTERS_FLAG, _NEWER_THAN_MEASURED = (0, 11, 1), (0, 13)
"""Versions of jaxlib: the first without `_EMITTERS`, the first not tried."""


def xla_flags(version: str = jaxlib_version) -> list[str]:
    """How XLA is to compile for a CPU, of a jaxlib's `version`: flags that it knows, since an unknown one aborts."""
    numbers = tuple(int(number) for number in re.findall(r"\d+", version)[:3])
    flags = [_EMITTERS] if numbers < _WITHOUT_EMITTERS_FLAG else []
    flags += [
        flag
        for flag in (_LOOPS, _LEVEL, _PASSES, _PARTS)
        if numbers < _NEWER_THAN_MEASURED or in_jaxlib(_flag_name(flag))
    ]
    # Level and passes would hold for an accelerator's code, too.
    accelerators = importlib.metadata.entry_points(group="jax_plugins")
    return [flag for flag in flags if flag not in (_LEVEL, _PASSES) or not accelerators]


def in_jaxlib(flag: str) -> bool:
    """Whether the installed jaxlib's binary holds the name of a `flag`, as a string of its own."""
    for library in Path(jaxlib.__file__).parent.glob("*jax_common.*"):
        with library.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            return content.find(flag.encode() + b"\0") >= 0
    return False


def _flag_name(flag: str) -> str:
    return flag.removeprefix("--").partition("=")[0]


def add_xla_flags() -> None:
    """Add the flags to XLA's, which it reads when the first computation is asked for, unless the user gave them."""
    given = os.environ.get("XLA_FLAGS", "")
    in_a_file = bool(given) and not given.lstrip().startswith("-")
    if not in_a_file:
        missing = [flag for flag in xla_flags() if _flag_name(flag) not in given]
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


def usable_cache() -> Path | None:
    """The folder of compiled code, made where it is missing; None where it cannot be written to, or others can.

    What lies in it is run: who may write there could run code as this user.
    """
    folder = cache_folder()
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    if not os.access(folder, os.W_OK | os.X_OK):
        return None  # JAX itself would warn at every function it compiles
    if os.name == "posix":
        status = folder.stat()
        if status.st_uid != os.geteuid() or status.st_mode & 0o022:
            warnings.warn(
                f"Compiled code is neither kept in {folder} nor taken from it: it is run, and others may write there. "
                f"Change it by `chmod go-w`, or set PDSSJAX_CACHE to a folder of your own.",
                InputWarning,
                stacklevel=3,
            )
            return None
    return folder


def prepare_jax(*, dedicated: bool = False) -> None:
    """Switch on 64-bit numbers, loops of one kernel and, where it can be written to, the cache of compiled code.

    What a program calls before JAX computes anything; later, loops stay as they are.  Flags of XLA that the environment
    gives already are left alone, and compiled code is kept where its `PDSSJAX_CACHE` says, in a folder that nobody else
    may write to.  A small program is compiled and its result checked, once for each version of jaxlib, processor and
    flags: JAX has its devices from then on, so choose them before.

    **Arguments:**

    - `dedicated`: whether the process is there for pdssjax, as one of the command line is.  Python then looks for
      garbage less often, glibc's threads share the memory that is free, and every compiled function is kept, also
      yours and however quickly it was compiled; otherwise only those that took JAX's
      `jax_persistent_cache_min_compile_time_secs`, a second.

    **Raises** `MiscompilationError`, a `RuntimeError`, where the installed jaxlib computes wrongly.
    """
    add_xla_flags()
    jax.config.update("jax_enable_x64", True)
    folder = usable_cache()
    if folder is not None:
        jax.config.update("jax_compilation_cache_dir", str(folder))
    if dedicated:
        _share_free_memory()
        raise_gc_threshold()
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    check_compiler(folder)
    keep_programs_in(folder, _circumstances())


def use_float64() -> None:
    """Prepare JAX where it is in single precision, as it is in another process of an executor."""
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        prepare_jax()


class Float64Call(Generic[Task, Result]):
    """`work(task)` without arguments, for an executor.

    In another process JAX is prepared before the arrays in `work` and `task` are unpickled: in single precision, in
    which JAX begins, they would be rounded.
    """

    def __init__(self, work: Callable[[Task], Result], task: Task):
        self._work, self._task = work, task

    def __call__(self) -> Result:
        return self._work(self._task)

    def __reduce__(self) -> tuple[Any, ...]:
        return _float64_call, (_Float64(), self._work, self._task)


class _Float64:
    """Unpickled, a call of `use_float64`."""

    def __reduce__(self) -> tuple[Any, ...]:
        return use_float64, ()


def _float64_call(_: None, work: Callable[[Task], Result], task: Task) -> Float64Call[Task, Result]:
    return Float64Call(work, task)


def require_float64(what: str) -> None:
    """**Raises** `InputError` that names `what` was called where JAX computes in single precision.

    Single precision cannot locate events.
    """
    if not jax.config.jax_enable_x64:  # pyright: ignore[reportAttributeAccessIssue]
        raise InputError(
            f"{what}: found JAX in single precision, expected it in double; call pdssjax.prepare_jax(), or "
            'jax.config.update("jax_enable_x64", True), before anything is computed.'
        )
