"""How many threads NumPy's and SciPy's linear algebra takes."""

import contextlib
import importlib
from collections.abc import Iterator


@contextlib.contextmanager
def one_blas_thread() -> Iterator[None]:
    """Within it, or in a function that it decorates, linear algebra runs in the thread that asks for it.

    The matrices of a fit are thin: a second thread gains nothing on a machine that does nothing else, and beside
    another process each waits for the other at every step.  What is computed does not depend on the number of cores
    then, either.  The limit is the process's, for so long.
    """
    from threadpoolctl import threadpool_limits

    importlib.import_module("scipy.linalg")  # limits reach only what is loaded, and SciPy brings a library of its own
    with threadpool_limits(1, user_api="blas"):
        yield
