"""Number of threads of linear algebra."""

from __future__ import annotations

import os

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Variables of the environment, which the libraries under numpy and scipy read when they are loaded."""


def one_thread() -> None:
    """Linear algebra that is loaded from now on takes one thread, unless the environment states another number.

    The matrices here have some hundred rows: further threads cost more than they give (eightfold in the test of a
    grasp's stability, where other processes compute too), and the last digits of results depend on how many they are.
    """
    for name in VARIABLES:
        os.environ.setdefault(name, "1")
