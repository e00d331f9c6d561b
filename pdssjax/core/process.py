"""Settings of the process: garbage collection, threads of linear algebra, installed versions."""

import contextlib
import gc
import importlib
import platform
from collections.abc import Iterator

_OBJECTS = 100_000
"""Objects made, and not yet deleted, before Python looks for cycles among them; by default a few hundred."""


def raise_gc_threshold() -> None:
    """Let Python look for garbage less often, for programs that use JAX.

    JAX makes objects by the hundred thousand when it is imported and when it traces, and nearly all of them stay.
    To look through them again and again is a tenth of the time to the first result.
    """
    gc.set_threshold(max(_OBJECTS, gc.get_threshold()[0]))


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Run linear algebra in the calling thread: a context manager, also usable as a decorator.

    The matrices of a fit are thin: a second thread gains nothing on a machine that does nothing else, and beside
    another process each waits for the other at every step.  What is computed does not depend on the number of cores
    then, either.  The limit is the process's, for so long.
    """
    from threadpoolctl import threadpool_limits

    importlib.import_module("scipy.linalg")  # limits reach only what is loaded, and SciPy brings a library of its own
    with threadpool_limits(1, user_api="blas"):
        yield


_COMPUTING = "pdssjax", "jax", "jaxlib", "diffrax", "equinox", "optimistix", "numpy", "scipy"
"""Packages on which the digits of a result may depend."""


def installed_versions() -> dict[str, str]:
    """The versions of Python and of the packages that compute, by name; without those that were never installed."""
    from importlib import metadata

    found = {"python": platform.python_version()}
    for package in _COMPUTING:
        with contextlib.suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found
