"""Who does the work: processes on this machine, or any executor."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any, Protocol

from continuum_grasp.errors import InputError, SolverError
from continuum_grasp.interrupt import ignored_by_children

__all__ = ["Crew", "ExecutorCrew", "LocalCrew", "checked_count", "cores"]

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")


class Crew(Protocol):
    """Takes chunks of work."""

    @property
    def workers(self) -> int:
        """How many there are."""

    @property
    def most(self) -> int:
        """How many chunks to give out at a time."""

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Give out a chunk; there are less than ``most`` of them out."""

    def lost(self, future: Future[Any]) -> bool:
        """Whether a chunk failed since its worker died, and another may be tried.

        Raises
        ------
        SolverError
            There are no workers to go on with.
        """

    def close(self, at_once: bool) -> None:
        """Send everybody home, at once or when they are done."""


@dataclass
class _Seat:
    pool: ProcessPoolExecutor
    started: Future[Any]
    busy: Future[Any]


class LocalCrew:
    """One pool of one process per worker: a scene that takes its process with it takes nothing else along.

    Each worker has one chunk at a time and one thread for linear algebra, ignores Ctrl-C, and ends when this process
    does, however that ends.

    Parameters
    ----------
    count : int
        Number of processes.
    """

    def __init__(self, count: int) -> None:
        self.workers = self.most = count
        self._context = multiprocessing.get_context("spawn")
        self._watched, self._alive = self._context.Pipe(duplex=False)
        self._seats: list[_Seat | None] = [None] * count

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Give a chunk to an idle worker; one that died is replaced."""
        k = next(k for k, seat in enumerate(self._seats) if seat is None or seat.busy.done())
        seat = self._seats[k]
        try:
            if seat is not None:
                seat.busy = seat.pool.submit(work, *arguments)
                return seat.busy
        except BrokenExecutor:  # its process died
            pass
        with _one_thread(), ignored_by_children():
            pool = ProcessPoolExecutor(1, self._context, _prepare, (self._watched,))
            started = pool.submit(_here)
        self._seats[k] = seat = _Seat(pool, started, pool.submit(work, *arguments))
        return seat.busy

    def lost(self, future: Future[Any]) -> bool:
        """Whether the worker's process ended.

        Raises
        ------
        SolverError
            It ended before it had begun.
        """
        if not isinstance(future.exception(), BrokenExecutor):
            return False
        seat = next(seat for seat in self._seats if seat is not None and seat.busy is future)
        if seat.started.exception() is not None:
            raise SolverError(
                "worker processes cannot be started",
                status="not_started",
                advice="A script that calls this needs its main part under: if __name__ == '__main__':",
            )
        return True

    def close(self, at_once: bool) -> None:
        """End the processes: when they are idle, or at once."""
        if at_once:
            self._alive.close()
        for seat in self._seats:
            if seat is not None:
                seat.pool.shutdown(wait=True, cancel_futures=True)
        self._alive.close()
        self._watched.close()


class ExecutorCrew:
    """Any `concurrent.futures.Executor`, which stays its owner's.

    Parameters
    ----------
    executor : concurrent.futures.Executor
    workers : callable
        Gives how many there are; asked again and again, since clusters grow and shrink.
    """

    def __init__(self, executor: Executor, workers: Callable[[], int]) -> None:
        self._executor, self._count = executor, workers
        self._out: set[Future[Any]] = set()

    @property
    def workers(self) -> int:
        """How many there are now."""
        return max(1, self._count())

    @property
    def most(self) -> int:
        """Two chunks for each, so that nobody waits for the next."""
        return 2 * self.workers

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Give out a chunk.

        Raises
        ------
        SolverError
            The executor takes no more.
        """
        try:
            future = self._executor.submit(work, *arguments)
        except RuntimeError as error:  # broken, or shut down
            raise _stopped(error) from error
        self._out.add(future)
        future.add_done_callback(self._out.discard)
        return future

    def lost(self, future: Future[Any]) -> bool:
        """Whether a cluster gave a chunk up because workers died of it.

        Raises
        ------
        SolverError
            The executor is broken.
        """
        error = future.exception()
        if isinstance(error, BrokenExecutor):
            raise _stopped(error) from error
        return type(error).__name__ == "KilledWorker"

    def close(self, at_once: bool) -> None:
        """Take back what has not begun."""
        for future in list(self._out):
            future.cancel()


def cores() -> int:
    """Processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def checked_count(workers: Any) -> int:
    """A number of workers.

    Raises
    ------
    InputError
        It is none.
    """
    if isinstance(workers, bool) or not isinstance(workers, int) or not 1 <= workers <= 4096:
        raise InputError(f"expected a number of workers from 1 to 4096, got {workers!r:.60}", key="workers")
    return workers


def _stopped(error: BaseException) -> SolverError:
    return SolverError(
        f"the executor takes no more work: {error}",
        status="stopped",
        advice="What was computed is in the table; the same call with a new executor goes on from there.",
    )


def _prepare(watched: Connection) -> None:
    """In a new worker: leave Ctrl-C to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(watched,), daemon=True).start()


def _end_with_parent(watched: Connection) -> None:
    with suppress(OSError, EOFError):
        watched.poll(None)
    os._exit(1)


def _here() -> None:
    """A worker that does this is there."""


@contextmanager
def _one_thread() -> Iterator[None]:
    """What is started here computes with one thread, unless the user said otherwise."""
    own = [name for name in _THREADS if name not in os.environ]
    os.environ.update(dict.fromkeys(own, "1"))
    try:
        yield
    finally:
        for name in own:
            os.environ.pop(name, None)
