"""A Dask cluster as the worker pool of a sweep."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

from continuum_grasp.errors import InputError
from continuum_grasp.workers import ExecutorPool

__all__ = ["dask_pool"]

_PATIENCE = 10.0
"""How long to wait for an answer of the scheduler [s]."""
_ASK_AGAIN = 2.0
"""How long a count of workers is taken as current [s]: asking is a call over the network."""


@contextmanager
def dask_pool(address: str, patience: float = _PATIENCE) -> Iterator[ExecutorPool]:
    """The workers of a running Dask scheduler.

    Parameters
    ----------
    address : str
        Such as ``tcp://127.0.0.1:8786``.
    patience : float
        How long to wait for an answer [s].

    Raises
    ------
    InputError
        Dask is not installed, or no scheduler answers.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise InputError(
            "a Dask cluster needs the extra 'cluster': pip install 'continuum-grasp[cluster]'", key="scheduler"
        ) from None
    try:
        client: Any = distributed.Client(address, timeout=patience, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:  # TimeoutError is an OSError
        raise InputError(f"no Dask scheduler answers at {address!r}: {error}", key="scheduler") from None
    try:
        yield ExecutorPool(client.get_executor(pure=False), _Count(client))
    finally:
        client.close()


class _Count:
    """How many worker processes there are, asked every two seconds."""

    def __init__(self, client: Any) -> None:
        self._client, self._count, self._asked = client, 0, -_ASK_AGAIN

    def __call__(self) -> int:
        if time.monotonic() - self._asked > _ASK_AGAIN:
            self._count, self._asked = len(self._client.nthreads()), time.monotonic()
        return self._count
