"""Ctrl-C that is neither lost nor comes where it leaves half of something.

Python raises `KeyboardInterrupt` in whatever runs. Where C++ of CasADi asks a Python object for its type, the exception
is dropped and the work goes on; in an import it leaves half a module; at the end of a ``with`` block, a temporary file.
The handler here notes Ctrl-C and raises it in the innermost frame that no such code lies above, as soon as that frame
goes on; computations that look at `pressed` now and then end early for it.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

__all__ = ["held", "kept_from_children", "listening", "pressed", "was_pressed"]

STATUS = 130
"""Exit status of a command that Ctrl-C ended: 128 and the signal's number, as in shells."""
_SAME_PRESS = 0.5
"""Signals within this time are one press [s]; a terminal and a parent process may send one each."""
_PARTS = {
    "casadi.casadi": None,
    "_frozen_importlib": None,  # named importlib._bootstrap once importlib itself is imported
    "_frozen_importlib_external": None,
    "importlib._bootstrap": None,
    "importlib._bootstrap_external": None,
    "contextlib": ("__enter__", "__exit__"),
    "tempfile": None,
    "shutil": None,
    "weakref": None,
    "_weakrefset": None,
    "continuum_grasp.results.atomic": None,
    "continuum_grasp.results.record": None,
}
"""Modules, and functions of them, in and under which an exception would be lost or leave half of something."""

_noted: float | None = None
"""When Ctrl-C was pressed, as long as it has not been raised [s of the monotonic clock]."""
_blocks = 0
"""How many blocks hold it back."""
_seen = False
_ends_process = False


def pressed() -> bool:
    """Whether Ctrl-C was pressed and has not been raised yet."""
    return _noted is not None


def was_pressed() -> bool:
    """Whether Ctrl-C was pressed since the outermost `listening` began."""
    return _seen


@contextmanager
def listening(command: bool = False) -> Iterator[None]:
    """Take Ctrl-C within the block; without effect outside the main thread, and where somebody else handles it.

    Parameters
    ----------
    command : bool, optional
        The block is the whole process: a second press before the first could be raised ends it at once, with status
        130, and what comes after the block ignores Ctrl-C.
    """
    global _ends_process, _noted, _seen
    usual = signal.getsignal(signal.SIGINT)
    ours = usual is signal.default_int_handler or (command and callable(usual) and usual is not _press)
    if threading.current_thread() is not threading.main_thread() or not ours:
        yield
        return
    _noted, _seen, _ends_process = None, False, command
    signal.signal(signal.SIGINT, _press)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN if command else usual)


@contextmanager
def held(*, quietly: bool = False) -> Iterator[Callable[[], bool]]:
    """Keep Ctrl-C until the end of the block, for solvers that would lose an exception; raise it then.

    Parameters
    ----------
    quietly : bool, optional
        Raise nothing: whoever opened the block asks whether Ctrl-C was pressed.

    Yields
    ------
    callable
        Whether Ctrl-C was pressed; also after the block.
    """
    global _blocks, _noted
    usual = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(usual):
        yield lambda: False
        return
    found = False
    if usual is not _press:
        signal.signal(signal.SIGINT, _press)
    _blocks += 1
    try:
        yield lambda: found or pressed()
    finally:
        _blocks -= 1
        found = pressed()
        if usual is not _press:
            signal.signal(signal.SIGINT, usual)
        if found and (quietly or not _blocks):
            _noted = None
            if not quietly:
                usual(signal.SIGINT, None) if usual is not _press else _raise()


@contextmanager
def kept_from_children() -> Iterator[None]:
    """Processes that are started within the block never see Ctrl-C, which a terminal sends to all of them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # unblocks the signal where it is started
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _press(number: int, frame: FrameType | None) -> None:
    """Handle the signal: raise now, or have the nearest frame raise that can."""
    global _noted, _seen
    now = time.monotonic()
    if _noted is not None:
        if now - _noted > _SAME_PRESS:
            if _ends_process:
                os._exit(STATUS)
            _raise()
        return
    _noted, _seen = now, True
    if _blocks:
        return
    carrier = _carrier(frame)
    if carrier is frame:
        _raise()
    if carrier is not None:
        carrier.f_trace = _deliver
        sys.settrace(_deliver)


def _carrier(frame: FrameType | None) -> FrameType | None:
    """The innermost frame with nothing above it that would lose an exception."""
    found = frame
    while frame is not None:
        names = _PARTS.get(frame.f_globals.get("__name__", ""), ())
        if names is None or frame.f_code.co_name in names or frame.f_code.co_name == "__del__":
            found = frame.f_back
        frame = frame.f_back
    return found


def _deliver(frame: FrameType, event: str, argument: Any) -> Any:
    """Raise in the frame that was chosen, as its trace function; frames that are called meanwhile go on."""
    if event == "call":
        return None
    frame.f_trace = None
    sys.settrace(None)
    if _noted is not None and not _blocks:
        _raise()
    return None


def _raise() -> None:
    global _noted
    _noted = None
    raise KeyboardInterrupt
