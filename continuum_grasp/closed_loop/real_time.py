"""Requests to the operating system while a loop runs, its clock, and its alarm."""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple


class RealTime(NamedTuple):
    """Requests to the operating system while a loop runs.

    Attributes
    ----------
    priority : int or None
        Of the first-in-first-out scheduler, 1 to 99.
    core : int or None
        The core that the process keeps to.
    lock_memory : bool
        Whether no memory of the process is swapped out.
    """

    priority: int | None = None
    core: int | None = None
    lock_memory: bool = False


class HangsError(TimeoutError):
    """The driver does not return."""


def wait_until(instant: float, spin: float) -> float:
    """Sleep, then poll the clock; return the time at which the waiting ended."""
    rest = instant - spin - time.perf_counter()
    if rest > 0.0:
        time.sleep(rest)
    now = time.perf_counter()
    while now < instant:
        now = time.perf_counter()
    return now


@contextmanager
def no_collection() -> Iterator[None]:
    """Collect no garbage, which takes longer than a cycle."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


@contextmanager
def alarm(watchdog: float) -> Iterator[Callable[[bool], object]]:
    """Break off what hangs while it is armed, by a timer of the operating system where there is one."""
    if not hasattr(signal, "setitimer") or threading.current_thread() is not threading.main_thread():
        yield lambda on: None
        return

    def hangs(*_: object) -> None:
        raise HangsError(f"the driver did not return within {watchdog:g} s")

    before = signal.signal(signal.SIGALRM, hangs)
    try:
        yield lambda on: signal.setitimer(signal.ITIMER_REAL, watchdog if on else 0.0)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def real_time(asked: RealTime) -> Iterator[tuple[str, ...]]:
    """Ask the operating system, say what it granted, and give it back."""
    said, undo = list[str](), ExitStack()

    def ask(what: str, wanted: bool, do: Any, back: Any) -> None:
        if not wanted:
            return
        try:
            before = do()
            undo.callback(back, before)
            said.append(f"{what}: granted")
        except (OSError, AttributeError, TypeError, ValueError) as error:
            said.append(f"{what}: refused ({error})")

    def priority() -> Any:
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(asked.priority or 1))
        return before

    def core() -> Any:
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {asked.core or 0})
        return before

    def memory() -> Any:
        library = ctypes.CDLL(None, use_errno=True)
        if library.mlockall(3) != 0:  # MCL_CURRENT | MCL_FUTURE
            raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        return library

    ask(f"core {asked.core}", asked.core is not None, core, lambda was: os.sched_setaffinity(0, was))
    ask("locked memory", asked.lock_memory, memory, lambda library: library.munlockall())
    wanted = asked.priority is not None
    ask(f"priority {asked.priority}", wanted, priority, lambda was: os.sched_setscheduler(0, *was))
    with undo:
        yield tuple(said)
