"""Number of threads of linear algebra."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Variables of the environment, which the libraries under numpy and scipy read when they are loaded."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra within the block, and in processes started there, takes one thread, unless the environment states
    a number.

    The matrices here have some hundred rows: further threads cost more than they give (a grasp takes twice the
    processor time with two), and the last digits of results depend on how many they are.
    """
    if any(name in os.environ for name in VARIABLES):
        yield
        return
    os.environ.update(dict.fromkeys(VARIABLES, "1"))
    try:
        if "numpy" in sys.modules:  # its libraries have read the environment before
            from threadpoolctl import threadpool_limits

            with threadpool_limits(1, user_api="blas"):
                yield
        else:
            yield
    finally:
        for name in VARIABLES:
            os.environ.pop(name, None)
