"""A small program that a jaxlib which computes wrongly fails.

jaxlib 0.10.2 adds up the products of the last of 16 385 rows from the wrong place on a CPU, and says nothing
(jax issue 39103); 16 384 rows come out right.
"""

import contextlib
import functools
import hashlib
import os
import platform
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from jaxlib.version import __version__ as jaxlib_version
from jaxtyping import Array, Float

from .errors import MiscompilationError

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
    """What compiled code depends on, as far as it is known before JAX looks for its devices."""
    return "\n".join([jax.__version__, jaxlib_version, str(jax.config.jax_platforms), _flags(), _processor()])  # pyright: ignore[reportAttributeAccessIssue]


def _flags() -> str:
    return os.environ.get("XLA_FLAGS", "")


def _processor() -> str:
    """Its model and what it can do, where Linux tells; elsewhere what Python knows of it."""
    with contextlib.suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as file:
        lines = []
        for line in file:
            if not line.strip():  # the first core ends
                break
            if line.startswith(("model name", "flags", "CPU part", "Features")):
                lines.append(line)
        return platform.machine() + "".join(lines)
    return platform.machine() + platform.processor()
