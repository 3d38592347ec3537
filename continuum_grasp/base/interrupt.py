"""Ctrl-C that is neither lost nor interrupts work that must be complete.

Python raises `KeyboardInterrupt` in any running code. If C++ of CasADi asks a Python object for its type, the exception
is dropped and the work continues; in an import it leaves half a module; at the end of a ``with`` block, a temporary
file. The handler here notes Ctrl-C and raises it in the innermost frame that is not under such code, as soon as this
frame continues. Long computations check `interrupt_pressed` regularly and end early; their linear algebra uses one
thread.
"""

from __future__ import annotations

import atexit
import math
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from types import FrameType
from typing import Any


class ExitStatus(IntEnum):
    """Exit statuses of commands, except 0.

    Failed means no usable result: a solver that failed, a supervisor that tripped, an object that was dropped, data
    that contradict the model or do not answer the question. Bad input has the status of argparse and click. An unstable
    grasp passes every check but does not hold the object. Ctrl-C gives 128 plus the signal's number, as in shells.
    """

    FAILED = 1
    BAD_INPUT = 2
    UNSTABLE = 3
    INTERRUPTED = 128 + signal.SIGINT


_PATIENCE = 1.5
"""After which it says that it waits [s]."""
_SAME_PRESS = 0.5
"""Signals within this time are one press [s]; a terminal and a parent process may send one each."""
_PARTS = {
    "casadi.casadi": None,
    "contextlib": ("__enter__", "__exit__"),
    "tempfile": None,
    "shutil": None,
    "weakref": None,
    "_weakrefset": None,
    "continuum_grasp.results.atomic": None,
    "continuum_grasp.results.folders": None,
    "continuum_grasp.results.record": None,
    "continuum_grasp.addons.sweeps.folder": ("append", "write_run_file"),
}
"""Modules, and functions in them, that would lose an exception or leave incomplete work; imports also count."""

_noted: float | None = None
"""Time of a Ctrl-C that has not been raised yet [s of the monotonic clock]."""
_blocks = 0
"""Number of blocks that hold Ctrl-C back."""
_seen = False
_ending = threading.Lock()
_watched = False
"""Whether the process ends with the block that listens."""
_handled = -math.inf
"""Last time that the main thread handled the signal [s of the monotonic clock]."""


class Interrupted(KeyboardInterrupt):
    """Ctrl-C during a long computation; not an ``Exception``, so that ``except Exception`` does not catch it.

    Parameters
    ----------
    message : str
        The interrupted work, and where it stopped.
    result : object, optional
        The result so far.
    """

    def __init__(self, message: str, *, result: Any = None) -> None:
        self.result = result
        super().__init__(message)

    @classmethod
    @contextmanager
    def after(cls, what: str) -> Iterator[Callable[[], Interrupted | None]]:
        """Block after the end of ``what``, whose result it makes whole; the exception, once it ended with Ctrl-C."""
        with interrupts_held(quietly=True) as pressed:
            yield lambda: cls(f"interrupted after the end of {what}") if pressed() else None


def interrupt_pressed() -> bool:
    """Whether Ctrl-C was pressed and has not been raised yet."""
    return _noted is not None


def interrupt_was_pressed() -> bool:
    """Whether Ctrl-C was pressed since the outermost `listening_for_interrupts` began."""
    return _seen


@contextmanager
def interruptible(command: bool = False) -> Iterator[None]:
    """Block, or decorator, of every long computation in Python and of each command: Ctrl-C is taken, and linear algebra
    takes one thread, so that results of both are equal to the last digit.
    """
    with one_thread(), listening_for_interrupts(command):
        yield


@contextmanager
def listening_for_interrupts(command: bool = False) -> Iterator[None]:
    """Handle Ctrl-C within the block; without effect outside the main thread, or if another handler is installed.

    ``command``: the block is the whole process. It ends with status 130 at a second press before the first could be
    raised, or if this takes long; code after the block ignores Ctrl-C.
    """
    global _noted, _seen
    usual = signal.getsignal(signal.SIGINT)
    ours = usual is signal.default_int_handler or (command and callable(usual) and usual is not _press)
    if threading.current_thread() is not threading.main_thread() or not ours:
        yield
        return
    _noted, _seen = None, False
    signal.signal(signal.SIGINT, _press)
    if command:
        _start_watch()
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN if command else usual)
        if not command and interrupt_pressed():  # nothing that could raise it came after
            _raise()


@contextmanager
def interrupts_held(*, quietly: bool = False) -> Iterator[Callable[[], bool]]:
    """Keep Ctrl-C until the end of the block, for solvers that would lose an exception; raise it then.

    Yields what states whether Ctrl-C was pressed, also after the block. ``quietly``: raise nothing; the caller asks.
    """
    global _blocks, _noted
    usual = signal.getsignal(signal.SIGINT)
    if threading.current_thread() is not threading.main_thread() or not callable(usual):
        yield lambda: False
        return
    interrupted = False
    if usual is not _press:
        signal.signal(signal.SIGINT, _press)
    _blocks += 1
    try:
        yield lambda: interrupted or interrupt_pressed()
    finally:
        _blocks -= 1
        interrupted = interrupt_pressed()
        if usual is not _press:
            signal.signal(signal.SIGINT, usual)
        # An outer block that holds it back raises it at its own end.
        if interrupted and (quietly or not _blocks):
            _noted = None
            if not quietly:
                usual(signal.SIGINT, None) if usual is not _press else _raise()


@contextmanager
def interrupts_ignored_by_children() -> Iterator[None]:
    """Processes that are started within the block never see Ctrl-C, which a terminal sends to all of them."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    resource_tracker.ensure_running()  # its start unblocks the signal
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _press(number: int, frame: FrameType | None) -> None:
    """Handle the signal: raise now, or have the nearest frame raise that can."""
    global _noted, _seen, _handled
    now = _handled = time.monotonic()
    if _noted is not None:
        if now - _noted > _SAME_PRESS:
            _end() if _watched else _raise()
        return
    _noted, _seen = now, True
    if _blocks:
        return
    carrier = _carrier(frame)
    if carrier is frame:
        _raise()
    # Tracing is the one way to raise in a frame that is not the innermost.
    if carrier is not None:
        carrier.f_trace = _deliver
        sys.settrace(_deliver)


def _carrier(frame: FrameType | None) -> FrameType | None:
    """The innermost frame with nothing above it that would lose an exception."""
    current = frame
    while frame is not None:
        names = _PARTS.get(frame.f_globals.get("__name__", ""), ())
        imports = frame.f_code.co_filename.startswith("<frozen importlib")
        if imports or names is None or frame.f_code.co_name in (*names, "__del__"):
            current = frame.f_back
        frame = frame.f_back
    return current


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


def leave_interrupted() -> None:
    """End the process with status 130; after an exception in an ``eval`` Python would have the signal kill it."""
    atexit._run_exitfuncs()  # os._exit skips them
    os._exit(ExitStatus.INTERRUPTED)


def _end() -> None:
    """End the process at once; files are whole, since they get their names when they are complete."""
    _ending.acquire()  # whoever comes second waits for the end
    os.write(2, b"interrupted\n")
    os._exit(ExitStatus.INTERRUPTED)


def _start_watch() -> None:
    """Have a thread learn of every press, also while the main thread is within a call into C++."""
    global _watched
    _watched = True
    if os.name != "posix":
        return
    heard, reported = os.pipe()
    os.set_blocking(reported, False)
    signal.set_wakeup_fd(reported, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(heard,), daemon=True).start()


def _watch(heard: int) -> None:
    """End the process where a press is not raised in time, or is repeated."""
    # The wakeup descriptor gets a byte from C as soon as the signal comes, whatever the main thread does.
    while True:
        if signal.SIGINT not in os.read(heard, 64):
            continue
        began = time.monotonic()
        reported = False
        # Its handler runs when the main thread is back in Python: then the press is raised, or held by a block.
        while _handled < began - _SAME_PRESS or _noted is not None:
            waited = time.monotonic() - began
            if select.select([heard], [], [], 0.1)[0] and signal.SIGINT in os.read(heard, 64) and waited > _SAME_PRESS:
                _end()
            # 10.0: longest time that a command waits for one call into C++ that cannot be stopped [s]; building a
            # controller has some of 5 s
            if waited > 10.0 and not _blocks:
                _end()
            if waited > _PATIENCE and not reported:
                os.write(2, b"interrupted; this step cannot be stopped (Ctrl-C again ends at once)\n")
                reported = True


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
