"""Pools of workers for a sweep: processes on this machine, any executor, a Dask cluster."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future
from contextlib import contextmanager
from functools import lru_cache
from importlib import import_module
from typing import Any

from continuum_grasp.base import InputError, ProcessPool, SolverError, install_line


class ExecutorPool:
    """Any `concurrent.futures.Executor`, which stays its owner's.

    ``workers`` returns their number; it is asked again and again, since clusters grow and shrink.
    """

    def __init__(self, executor: Executor, workers: Callable[[], int]) -> None:
        self._executor = executor
        self._count = workers
        self._out: set[Future[Any]] = set()

    @property
    def workers(self) -> int:
        """Number of workers now."""
        return max(1, self._count())

    @property
    def most(self) -> int:
        """Two tasks for each, so that none waits for the next."""
        return 2 * self.workers

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit a task; `SolverError` where the executor takes no more."""
        try:
            future = self._executor.submit(work, *arguments)
        except RuntimeError as error:  # broken, or shut down
            raise _stopped(error) from error
        self._out.add(future)
        future.add_done_callback(self._out.discard)
        return future

    def lost(self, future: Future[Any]) -> bool:
        """Whether a cluster gave a task up because workers died of it; `SolverError` where the executor is broken."""
        error = future.exception()
        if isinstance(error, BrokenExecutor):
            raise _stopped(error) from error
        # Of dask.distributed, which is not imported for its name.
        return type(error).__name__ == "KilledWorker"

    def close(self, at_once: bool) -> None:
        """Cancel tasks that have not begun."""
        for future in list(self._out):
            future.cancel()


WorkerPool = ProcessPool | ExecutorPool
"""Takes tasks, up to ``most`` at a time."""


def _stopped(error: BaseException) -> SolverError:
    return SolverError(
        f"the executor takes no more work: {error}",
        status="stopped",
        advice="What was computed is in the table; the same call with a new executor resumes from there.",
    )


@contextmanager
def dask_pool(address: str) -> Iterator[ExecutorPool]:
    """The workers of a running Dask scheduler, at an address such as ``tcp://127.0.0.1:8786``.

    Raises an InputError where Dask is not installed, or no scheduler answers.
    """
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise InputError(
            f"a Dask cluster needs the extra 'cluster': {install_line('cluster')}", key="scheduler"
        ) from None
    try:
        # Not the default one: the caller may use Dask for something else.
        # 10.0: time to wait for an answer [s]
        client: Any = distributed.Client(address, timeout=10.0, set_as_default=False)
    except (OSError, ValueError, TypeError) as error:  # TimeoutError is an OSError
        raise InputError(f"no Dask scheduler answers at {address!r}: {error}", key="scheduler") from None

    @lru_cache(maxsize=1)
    def count(tick: float) -> int:
        return len(client.nthreads())

    try:
        # Not pure: a scene that is tried again is computed again. Workers are counted every 2 s, over the network.
        yield ExecutorPool(client.get_executor(pure=False), lambda: count(time.monotonic() // 2.0))
    finally:
        client.close()
