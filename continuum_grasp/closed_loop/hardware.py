"""A controller on real hardware: a loop of fixed period around a driver, with a safe command at its end."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from continuum_grasp.base import (
    Array,
    CheckedArgument,
    InputError,
    Interrupted,
    check_arguments,
    interruptible,
    interrupts_held,
)
from continuum_grasp.closed_loop.bags import topics_of_hardware, write_topics
from continuum_grasp.closed_loop.drivers import HangsError, RealTime, alarm, no_collection, real_time, wait_until
from continuum_grasp.closed_loop.wiring import Wiring
from continuum_grasp.control import (
    Command,
    CommandStatus,
    Controller,
    ControlLog,
    Health,
    spread,
)
from continuum_grasp.scene import DataTable, Initial


@runtime_checkable
class Driver(Protocol):
    """Reader of measurements and writer of commands; its ``idle()``, if any, is called in the rest of each period."""

    def read(self) -> ArrayLike | None:
        """Return the newest measurement in the order of ``measurement_names``, NaN for missing; None: none came."""

    def write(self, command: Command) -> object:
        """Send a command: its ``u``, and any use that the bench makes of ``status`` and ``health``."""


@dataclass(frozen=True)
class HardwareRun:
    """A loop on hardware, of K cycles that ran.

    Attributes
    ----------
    ended : {"finished", "tripped", "silent", "interrupted", "failed"}
        Reason for the end: its duration was over; the supervisor tripped; nothing was read; Ctrl-C; the driver or a
        step raised.
    cause : str
        The same in words.
    log : ControlLog
        A row per period: commands and measurements as the controller counts them, of skipped periods the command that
        was held and no measurement. ``replay`` and ``identify`` read its ``text()``.
    period : float
        [s]
    jitter, latency : (K,) ndarray
        Delay of the start of each cycle, and time from there until its command was written [s].
    overruns, skipped : int
        Cycles that ended after the next one should have begun, and cycles that were skipped for that reason.
    status, health : dict
        Commands by status and by health.
    realtime : tuple of str
        Grants of the operating system, in sentences.
    """

    ended: str
    cause: str
    log: ControlLog
    period: float
    jitter: Array
    latency: Array
    overruns: int
    skipped: int
    status: dict[str, int]
    health: dict[str, int]
    realtime: tuple[str, ...]

    def summary(self) -> dict[str, Any]:
        """Return how it ended, counts, and median, 99th percentile and maximum of jitter and latency [s]."""
        counts = {"cycles": len(self.jitter), "overruns": self.overruns, "skipped": self.skipped}
        spreads = {"jitter": spread(self.jitter), "latency": spread(self.latency)}
        outcome = {"ended": self.ended, "cause": self.cause, "period": self.period, **counts, **spreads}
        return {**outcome, "status": self.status, "health": self.health, "realtime": list(self.realtime)}


@interruptible()
@check_arguments
def run_hardware(
    controller: Controller,
    driver: Any,
    *,
    duration: float,
    start: ArrayLike | Command | None = None,
    soft_start: float = 0.5,
    watchdog: float = 0.25,
    hold: bool = False,
    spin: float = 0.0,
    realtime: RealTime | None = None,
    mcap: str | os.PathLike[str] | None = None,
) -> HardwareRun:
    """Read, compute and write once per period of a controller, until the time is over or a fault occurs.

    Cycles begin at fixed instants of the monotonic clock. A cycle that ends after the next one should have begun is an
    overrun, and the next begins at once; cycles that are missed altogether are ``Anomaly.MISSED_CALLS`` of the next
    command, which goes on over the time that passed. Python's garbage collection is off meanwhile.

    Whatever ends the loop, Ctrl-C and errors of the driver too, the command then goes to the input at rest within half
    a second, unless ``hold``. Measurements and commands go through the ``mounting`` of the controller's scene.

    Parameters
    ----------
    controller : Controller
        With ``deadline=math.inf``, since this loop detects late commands itself. It starts anew.
    driver : Driver
    duration : float
        [s]
    start : (nu,) array_like or Command, optional
        Hand-over without a jump: the input that acts at the start, under which the finger rests; or the last command of
        the controller before, whose estimate this one continues. By default the input at rest.
    soft_start : float
        Time for the command to fade in from the input at the start [s].
    watchdog : float
        Time without any reading after which the loop ends [s]. On Unix, in the main thread, a ``read`` or ``write``
        that hangs as long is broken off; elsewhere it is noticed when it returns.
    hold : bool
        Whether the last command stays after the duration, for a controller that takes over.
    spin : float
        Last part of the waiting time, spent polling the clock instead of sleeping [s]; less jitter, more load.
    realtime : RealTime, optional
    mcap : path-like, optional
        Bag of ROS 2 to write when the loop has ended, however: topics as of `ControlRun.write_mcap`, stamps of the
        system's clock.

    Returns
    -------
    HardwareRun

    Raises
    ------
    InputError
        If an argument does not fit.
    Interrupted
        On Ctrl-C, after the ramp; ``result`` is the run until then.
    Exception
        The error that the driver or a step raised, after the ramp, with the run as ``result``.

    Examples
    --------
    >>> import math
    >>> from continuum_grasp.closed_loop import SimulatedBench, run_hardware
    >>> from continuum_grasp.control import Controller
    >>> controller = Controller("configs/mpc/steady_tip.yaml", deadline=math.inf)
    >>> run = run_hardware(controller, SimulatedBench(controller.scene), duration=0.1)
    >>> run.ended, len(run.log.t)
    ('finished', 10)
    """
    period = controller.period
    # 1e7: cycles of one run: their log is held in memory, 1 GB; a day at 10 ms
    duration = CheckedArgument("duration", duration).number(most=1e7 * period)
    if not 0.0 <= spin < period:
        raise InputError(f"expected a time from 0 to the period of {period:g} s, got {spin!r:.60}", key="spin")
    CheckedArgument("soft_start", soft_start).number(0.0, 60.0)
    CheckedArgument("watchdog", watchdog).number(most=60.0)
    for name in ("read", "write"):
        if not callable(getattr(driver, name, None)):
            raise InputError(f"expected a driver with read() and write(command); this one has no {name}", key="driver")
    loop = _Loop(controller, driver, _first(controller, start), soft_start, watchdog)
    began = 0
    if mcap is not None:
        DataTable.bag({})  # before the drives move: its libraries may be missing
        loop.commands = {}
        began = time.time_ns()
    error: BaseException | None = None
    with ExitStack() as stack:
        granted = stack.enter_context(real_time(realtime or RealTime()))
        stack.enter_context(no_collection())
        loop.arm = stack.enter_context(alarm(watchdog))
        try:
            loop.run(max(1, math.floor(duration / period + 1e-9)), spin)
        except BaseException as raised:
            error = raised
            of_user = isinstance(raised, KeyboardInterrupt)
            if isinstance(raised, HangsError):
                loop.ended = "silent"
            elif of_user:
                loop.ended = "interrupted"
            else:
                loop.ended = "failed"
            loop.cause = str(raised) or type(raised).__name__
        if not (hold and loop.ended == "finished"):
            with interrupts_held(quietly=True):
                loop.ramp()
    run = loop.found(granted)
    if mcap is not None:
        try:
            write_topics(topics_of_hardware(run.log, controller, loop.commands or {}), mcap, began)
        except (InputError, OSError) as failed:
            if error is None:
                failed.result = run  # type: ignore[union-attr]
                raise
            error.add_note(f"the bag could not be written: {failed}")
    if loop.ended == "interrupted":
        raise Interrupted(f"interrupted after t = {len(loop.u) * period:g} s; the drives are at rest", result=run)
    if error is not None and loop.ended == "failed":
        error.add_note(f"after t = {len(loop.u) * period:g} s of the loop; the command went to the input at rest")
        error.result = run  # type: ignore[attr-defined]
        raise error
    return run


def _first(controller: Controller, start: ArrayLike | Command | None) -> Array:
    """Reset a controller to what goes on at the start, and return the input that acts."""
    rest = np.array(controller.scene.rest_input)
    if start is None:
        controller.reset()
        return rest
    if isinstance(start, Command):
        x = start.estimate.x
        u = start.u.copy()
        if x.size != controller.prediction.nx or u.size != rest.size:
            raise InputError("the previous controller has another model: give the present input", key="start")
    else:
        u = CheckedArgument("start", start).vector(rest.size)
        x = controller.prediction.start_state(Initial(pose="equilibrium"), u.tolist())
    controller.reset(state=x, u=u)
    return u


class _Loop:
    """Cycles of one run, and their records."""

    def __init__(self, controller: Controller, driver: Driver, first: Array, soft: float, watchdog: float) -> None:
        self.controller = controller
        self.driver = driver
        scene = controller.scene
        names = (controller.measurement_names, controller.stages.u_names)
        wired = Wiring.of(scene.mounting, *names, "mounting")
        self._wired = None if scene.mounting is None else wired
        self._rest, (low, high) = np.array(scene.rest_input), np.array(scene.input_limits)
        self._range = np.maximum(high - low, 1e-12)
        self._start = first
        self._soft = soft
        self._watchdog = watchdog
        self._last: Array = first
        self._command: Command | None = None
        self._none = np.full(len(controller.measurement_names), np.nan)
        self.u = list[Array]()
        self.y = list[Array]()
        self.commands: dict[int, Command] | None = None
        self.jitter = list[float]()
        self.latency = list[float]()
        self.overruns = self.skipped = 0
        self.status = dict.fromkeys(CommandStatus, 0)
        self.health = dict.fromkeys(Health, 0)
        self.ended = "finished"
        self.cause = "the duration is over"
        self.arm: Callable[[bool], object] = lambda on: None

    def run(self, cycles: int, spin: float) -> None:
        controller = self.controller
        period = self.controller.period
        idle = getattr(self.driver, "idle", None)
        # A period ahead, so that the first cycle is not late by what was done until here.
        start = time.perf_counter() + period
        cycle = 0
        late = False
        heard = start
        while cycle < cycles:
            release = start + cycle * period
            began = wait_until(release, spin)
            measured = self._read()
            heard = began if measured is not None and np.isfinite(measured).any() else heard
            now = time.perf_counter()
            if now - heard > self._watchdog:
                self.ended = "silent"
                self.cause = f"nothing was read for {now - heard:.2g} s"
                return
            blended = self._command is not None and not np.array_equal(self._command.u, self._last)
            applied = self._last if blended else None
            # By the instant at which the cycle should begin: estimator, plan and setpoints keep pace with the clock
            # over cycles that are skipped.
            command = controller.step(measured, late=late or None, applied=applied, time=release)
            share = 1.0 if self._soft == 0.0 else min((cycle + 1) * period / self._soft, 1.0)
            self._command = command
            self._send(command, self._start + share * (command.u - self._start))
            written = time.perf_counter()
            self.jitter.append(began - release)
            self.latency.append(written - began)
            self.status[command.status] += 1
            self.health[Health(command.health)] += 1
            if self.commands is not None:
                self.commands[len(self.u)] = command
            self._record(measured)
            if command.health is Health.TRIPPED:
                self.ended = "tripped"
                self.cause = command.health_text
                # 1e-3: distance of a command from that at rest, per its range, at which a tripped loop ends
                if np.all(np.abs(self._last - self._rest) <= 1e-3 * self._range):
                    return
            if idle is not None:
                idle()
            passed = int((time.perf_counter() - start) / period)
            late = written - release > period
            self.overruns += passed > cycle
            missed = max(0, min(passed, cycles) - cycle - 1)
            for _ in range(missed):
                self._record(None)
            self.skipped += missed
            cycle += 1 + missed

    def _read(self) -> Array | None:
        self.arm(True)
        reading = self.driver.read()
        self.arm(False)
        if reading is None:
            return None
        read = CheckedArgument("read()", reading).vector(len(self.controller.measurement_names), check=False)
        return read if self._wired is None else self._wired.readings.back(read)

    def _send(self, command: Command, u: Array, status: CommandStatus | None = None) -> None:
        sent = u if self._wired is None else self._wired.commands(u)
        same = status is None and np.array_equal(sent, command.u)
        self.arm(True)
        self.driver.write(command if same else command.with_input(sent, status))
        self.arm(False)
        self._last = u

    def _record(self, measured: Array | None) -> None:
        self.u.append(self._last.copy())
        self.y.append(self._none if measured is None else measured)

    def ramp(self) -> None:
        """Go from the last command to the input at rest, period by period, also where the driver fails again."""
        period = self.controller.period
        first = self._last
        command = self._command or self.controller.step(None, late=True)
        whole = self.controller.parts.calls.ramp
        count = max(1, math.ceil(whole * float(np.max(np.abs(first - self._rest) / self._range)) / period))
        for k in range(count):
            try:
                self._send(command, first + (k + 1) / count * (self._rest - first), CommandStatus.SAFE_RAMP)
            except Exception as failed:
                self.cause += f"; the ramp to rest could not be written: {failed}"
                if k + 1 < count:
                    self._last = first + (k + 1) / count * (self._rest - first)
            time.sleep(period)

    def found(self, granted: tuple[str, ...]) -> HardwareRun:
        controller = self.controller
        count = len(self.u)
        lacking = max(0, 2 - count)  # a log has two rows at least
        u = np.array([*self.u, *[self._last] * lacking])
        y = np.array([*self.y, *[self._none] * lacking])
        t = np.asarray(controller.period * np.arange(len(u)), dtype=float)
        return HardwareRun(
            ended=self.ended,
            cause=self.cause,
            log=ControlLog(t, u, y, controller.stages.u_names, controller.measurement_names, name="hardware"),
            period=controller.period,
            jitter=np.array(self.jitter),
            latency=np.array(self.latency),
            overruns=self.overruns,
            skipped=self.skipped,
            status={kind.name.lower(): count for kind, count in self.status.items()},
            health={kind.name.lower(): count for kind, count in self.health.items()},
            realtime=granted,
        )
