"""Drivers for `run_hardware`, a simulated bench and a board on a serial line; requests to the operating system while a
loop runs, its clock, and its alarm.
"""

from __future__ import annotations

import ctypes
import gc
import math
import os
import signal
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import Array, CheckedArgument, InputError, check_arguments, install_line
from continuum_grasp.closed_loop.plant import Plant, SharedPlant
from continuum_grasp.control import Command
from continuum_grasp.scene import ControlScene, scene_of


class SimulatedBench:
    """The plant of a scene as a bench, which counts as ``plant.mounting`` or ``mounting`` says.

    Parameters
    ----------
    scene : ControlScene or path-like

    Attributes
    ----------
    plant : Plant
        It moves on in the rest of each period.
    code : CodeKind
        Kind of code of its integrator.
    """

    @check_arguments
    def __init__(self, scene: ControlScene | str | PathLike[str]) -> None:
        scene = scene_of(scene, ControlScene)
        true = scene.plant.replaced(mounting=scene.bench_mounting)
        self.plant = Plant(scene.replaced(mounting=None, plant=true))
        self.code = SharedPlant((self.plant,)).prepare()  # before a clock runs
        self._u: ArrayLike = self.plant.model.rest_input

    def read(self) -> Array:
        """Measurement that arrives now."""
        return self.plant.measure()

    def write(self, command: Command) -> None:
        """Take a command for the period that follows."""
        self._u = command.u.copy()

    def idle(self) -> None:
        """Move for a period."""
        self.plant.advance(self._u)


class SerialBoard:
    """A board on a serial line that exchanges lines of text.

    The board sends ``y,<number>,<reading>,...*<check>`` whenever it has measured, an empty field for a reading that it
    has not, and takes ``u,<number>,<status>,<command>,...*<check>``; the check is the CRC-32 of what stands before the
    star, as eight hexadecimal digits. Numbers count up by one. A board should go to rest by itself where commands stay
    away, or where the status is ``safe_ramp``.

    Parameters
    ----------
    port : str
        Name of the port, or a URL of pyserial.
    readings : int
        Number of readings in a line.
    baudrate : int
        [1/s]

    Attributes
    ----------
    damaged, missed : int
        Lines that were dropped for their check or form, and readings that were skipped by their numbers.

    Raises
    ------
    InputError
        If pyserial is missing, or the port cannot be opened.
    """

    @check_arguments
    def __init__(self, port: str, readings: int, baudrate: int = 115200) -> None:
        try:
            import serial
        except ImportError:
            raise InputError(f"a serial board needs pyserial: {install_line('serial')}") from None
        self._readings = CheckedArgument("readings", readings).whole()
        self._sent = 0
        self._rest = b""
        self._number = -1
        self.damaged = self.missed = 0
        try:
            self._port: Any = serial.serial_for_url(port, baudrate, timeout=0.0, write_timeout=0.1)
        except (OSError, ValueError) as error:  # SerialException is an OSError
            raise InputError(f"{port} cannot be opened: {error}", key="port") from None

    def read(self) -> Array | None:
        """Return the newest complete measurement since the last call; None without one."""
        *lines, self._rest = (self._rest + self._port.read(self._port.in_waiting)).split(b"\n")
        # 4096: bytes without an end of line after which they are dropped: a line of 16 readings has 200
        self._rest = self._rest[-4096:]
        measurement = None
        for line in lines:
            fields = _fields(line)
            try:
                if fields is None or fields[0] != "y" or len(fields) != self._readings + 2:
                    raise ValueError
                number = int(fields[1])
                values = [float(field) if field else math.nan for field in fields[2:]]
            except ValueError:
                self.damaged += 1
                continue
            self.missed += max(0, number - self._number - 1) if self._number >= 0 else 0
            self._number = number
            measurement = np.array(values)
        return measurement

    def write(self, command: Command) -> None:
        """Send a command with its status."""
        values = ",".join(f"{value:.6g}" for value in command.u)
        self._port.write(line_of(f"u,{self._sent},{command.status.name.lower()},{values}"))
        self._sent += 1

    def close(self) -> None:
        """Close the port."""
        self._port.close()


def line_of(text: str) -> bytes:
    return f"{text}*{zlib.crc32(text.encode()):08x}\n".encode()


def _fields(line: bytes) -> list[str] | None:
    """Fields of a line whose check is right."""
    text, _, check = line.decode("ascii", "replace").strip().rpartition("*")
    return text.split(",") if text and check == f"{zlib.crc32(text.encode()):08x}" else None


class RealTime(NamedTuple):
    """Requests to the operating system while a loop runs.

    Attributes
    ----------
    priority : int or None
        Priority in the first-in-first-out scheduler, 1 to 99.
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
    """Sleep, then poll the clock; return the time at the end of the wait."""
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
    said = list[str]()
    undo = ExitStack()

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
