"""Linear algebra has one thread within, and as many as before afterwards."""

import numpy as np
import scipy.linalg  # noqa: F401  # loads SciPy's own library
from threadpoolctl import threadpool_info, threadpool_limits

from pdssjax.core import one_blas_thread


def threads():
    np.linalg.qr(np.eye(3))
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def test_within_it_is_one_and_afterwards_what_it_was():
    with threadpool_limits(2, user_api="blas"):
        with one_blas_thread():
            assert threads() == {1}
        assert threads() == {2}


def test_a_function_that_raises_leaves_it_as_it_was():
    @one_blas_thread()
    def failing():
        assert threads() == {1}
        raise KeyError

    with threadpool_limits(2, user_api="blas"):
        for _ in range(2):
            try:
                failing()
            except KeyError:
                assert threads() == {2}
