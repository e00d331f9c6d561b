"""The executor of a Dask cluster, which has no scheduler of its own here: `distributed` has one.

Its settings, TLS among them, are those of Dask (`DASK_DISTRIBUTED__COMM__TLS__...`, or its configuration files).
"""

import contextlib
import importlib.metadata
from collections.abc import Iterator
from concurrent.futures import Executor
from typing import Any

from ..core import InputError
from .job import package_version

_PATIENCE = 10.0
"""How long a scheduler may take to answer [s]."""


@contextlib.contextmanager
def cluster_executor(address: str) -> Iterator[tuple[Executor, int]]:
    """An executor on the workers of the Dask scheduler at `address`, such as "tcp://10.0.0.1:8786", and their threads.

    **Raises:** `InputError` where `distributed` is not installed, no scheduler answers, it has no workers, or one of
    them has another pdssjax or none.
    """
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "option --scheduler: found no distributed, expected it installed: \"pip install 'pdssjax[cluster]'\"."
        ) from None
    try:
        client = Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError, TypeError) as error:
        told = str(error).strip().splitlines()[:1] or [type(error).__name__]
        raise InputError(
            f"scheduler {address}: found none that answers ({told[0]}), expected a Dask scheduler."
        ) from None
    with contextlib.closing(client):
        threads = sum(_answer(client.nthreads()).values())
        if not threads:
            raise InputError(f"scheduler {address}: found no workers, expected at least one.")
        _check_versions(address, _answer(client.run(importlib.metadata.version, "pdssjax", on_error="return")))
        # A block is the same wherever and however often it is computed: a worker that dies is replaced.
        yield client.get_executor(pure=False, retries=2), threads


def _answer(told: Any) -> dict[str, Any]:
    """By worker, what it told; `distributed` types it as if it were awaited."""
    return told


def _check_versions(address: str, found: dict[str, object]) -> None:
    here = package_version()
    for worker, version in found.items():
        if version == here:
            continue
        told = f"pdssjax {version}" if isinstance(version, str) else "no pdssjax"
        raise InputError(f"scheduler {address}: worker {worker}: found {told}, expected pdssjax {here} as here.")
