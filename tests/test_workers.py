"""Processes on this machine: results as they come, and a task that ends its process ends no other."""

from __future__ import annotations

import os
import time
from concurrent.futures import BrokenExecutor, CancelledError

import pytest

from continuum_grasp.base import ProcessPool

_given: list[int] = []


def remember(value: int) -> None:
    _given.append(value)


def work(task: float) -> tuple[float, int]:
    """What was given at the start times the task; a task of zero ends the process, a negative one takes its time."""
    if task == 0.0:
        os._exit(3)
    time.sleep(max(0.0, -task))
    return _given[0] * task, os.getpid()


def test_every_task_is_done_once_and_a_dead_worker_is_replaced():
    pool = ProcessPool(2, remember, 7)
    found, lost = {}, []
    for k, future in pool.as_completed(work, [1.0, 0.0, 2.0, 3.0, 4.0]):
        if pool.lost(future):
            lost.append(k)
        else:
            found[k] = future.result()
    pool.close(False)
    assert lost == [1]
    assert {k: value for k, (value, _) in found.items()} == {0: 7.0, 2: 14.0, 3: 21.0, 4: 28.0}
    assert os.getpid() not in {process for _, process in found.values()}


def test_closing_at_once_waits_for_nothing():
    pool = ProcessPool(1, remember, 1)
    future = pool.submit(work, -3600.0)
    pool.close(True)
    with pytest.raises((BrokenExecutor, CancelledError)):
        future.result(0.0)


def test_an_error_of_a_task_is_no_lost_worker():
    pool = ProcessPool(1)
    ((_, future),) = pool.as_completed(work, ["x"])
    assert not pool.lost(future)
    assert isinstance(future.exception(), TypeError)
    pool.close(False)
