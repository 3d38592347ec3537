"""A worker pool: processes on this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Future, ProcessPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from continuum_grasp.base.errors import SolverError
from continuum_grasp.base.interrupt import interrupts_ignored_by_children, one_thread


@dataclass
class _Worker:
    pool: ProcessPoolExecutor
    started: Future[Any]
    """Future of `_confirm_start`: failed where the process ended before any task of the caller."""
    busy: Future[Any]


class ProcessPool:
    """Processes on this machine, one executor each: a task that ends its process ends no other task.

    Each worker has one task at a time and one thread for linear algebra, ignores Ctrl-C, and ends when this process
    does, however that ends. ``start`` is called in each new process with ``arguments``, before its first task. ``most``
    is the greatest number of tasks to have submitted at a time.
    """

    def __init__(self, count: int, start: Callable[..., None] | None = None, *arguments: Any) -> None:
        self.workers = self.most = count
        # A forked child would inherit locks of threads that it does not have, for example from OpenBLAS.
        self._context = multiprocessing.get_context("spawn")
        # The writing end is open in this process alone: when it closes, however, the workers end.
        self._watched, self._alive = self._context.Pipe(duplex=False)
        self._started: list[_Worker | None] = [None] * count
        self._prepared = (self._watched, start, arguments)

    @staticmethod
    def cores() -> int:
        """Processor cores that this process may use."""
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Submit a task to an idle worker; one that died is replaced."""
        k = next(k for k, worker in enumerate(self._started) if worker is None or worker.busy.done())
        worker = self._started[k]
        if worker is not None:
            with suppress(BrokenExecutor):  # its process died
                worker.busy = worker.pool.submit(work, *arguments)
                return worker.busy
        with one_thread(), interrupts_ignored_by_children():
            pool = ProcessPoolExecutor(1, self._context, _prepare, self._prepared)
            started = pool.submit(_confirm_start)
        self._started[k] = worker = _Worker(pool, started, pool.submit(work, *arguments))
        return worker.busy

    def as_completed(self, work: Callable[..., Any], tasks: Sequence[Any]) -> Iterator[tuple[int, Future[Any]]]:
        """Yield number and future of each task, in the order of their ends."""
        pending: dict[Future[Any], int] = {}
        left = deque(enumerate(tasks))
        while left or pending:
            while left and len(pending) < self.most:
                k, task = left.popleft()
                pending[self.submit(work, task)] = k
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                yield pending.pop(future), future

    def lost(self, future: Future[Any]) -> bool:
        """Return whether the worker's process ended; `SolverError` if it ended before it had begun."""
        if not isinstance(future.exception(), BrokenExecutor):
            return False
        worker = next(worker for worker in self._started if worker is not None and worker.busy is future)
        if worker.started.exception() is not None:
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
        for worker in self._started:
            if worker is not None:
                worker.pool.shutdown(wait=True, cancel_futures=True)
        self._alive.close()
        self._watched.close()


def _prepare(watched: Connection, start: Callable[..., None] | None, arguments: tuple[Any, ...]) -> None:
    """In a new worker: leave Ctrl-C to the parent, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(watched,), daemon=True).start()
    if start is not None:
        start(*arguments)


def _end_with_parent(watched: Connection) -> None:
    with suppress(OSError, EOFError):
        watched.poll(None)  # nothing is ever written: it returns when the writing end closes
    os._exit(1)


def _confirm_start() -> None:
    """Run as the first task, so that a process which ends before any task is distinguished."""
