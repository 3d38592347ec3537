"""The loop around a driver: on a clock of its own, with drivers that fail, and over a pseudo-terminal."""

from __future__ import annotations

import os
import signal
import threading
import time
import tty
import zlib
from time import sleep
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.addons.identification import replay
from continuum_grasp.base import InputError, Interrupted
from continuum_grasp.closed_loop import RealTime, SerialBoard, SimulatedBench, run_hardware
from continuum_grasp.control import CommandStatus, Controller, Health
from continuum_grasp.scene import Connection, DataTable, Mounting
from tests.identification.test_replay import PLANT, SCENE, scene

REST = 1.0


class Clock:
    """Goes on by what is slept, by what steps take, and a nanosecond for every look."""

    def __init__(self) -> None:
        self.now = 100.0

    def perf_counter(self) -> float:
        self.now += 1e-9
        return self.now

    def sleep(self, time: float) -> None:
        self.now += time + 1e-5


class Sent(SimpleNamespace):
    """A command as a driver sees it."""

    def with_input(self, u, status=None):
        return Sent(**{**vars(self), "u": u, "status": status or self.status})


class Steps(Controller):
    """A controller of 10 ms whose steps take as long as they are set to, and that wants a given input."""

    period = 0.01
    measurement_names = ("tip_x [m]", "tip_y [m]")
    stages = SimpleNamespace(u_names=("tension_1 [N]",), nu=1)

    def __init__(self, clock, durations, wanted=5.0, health=None, mounting=None) -> None:
        self.clock, self.durations, self.calls, self.wanted = clock, iter(durations), [], wanted
        self.health, self.started, self.times = iter(health or []), None, []
        self.parts = SimpleNamespace(calls=SimpleNamespace(ramp=0.5))
        self.scene = SimpleNamespace(mounting=mounting, rest_input=(REST,), input_limits=((REST,), (60.0,)))

    def reset(self, state=None, u=None):
        self.started = u

    def step(self, measurement, *, late=None, applied=None, time=None):
        self.calls.append((measurement, late, applied))
        self.times.append(time)
        self.clock.now += next(self.durations, 0.0)
        health = next(self.health, Health.OK)
        u = np.array([REST if health is Health.TRIPPED else self.wanted])
        return Sent(u=u, status=CommandStatus.SOLVED, health=health, health_text="tripped: it swings")


class Fake:
    """A driver that reads what it is given, and remembers what it was sent."""

    def __init__(self, read=lambda: [0.0, 0.18], fails_at=None) -> None:
        self.read, self.sent, self.fails_at = read, [], fails_at

    def write(self, command) -> None:
        if len(self.sent) == self.fails_at:
            self.fails_at = None
            raise OSError("the cable is out")
        self.sent.append((float(command.u[0]), command.status))


@pytest.fixture
def clock(monkeypatch):
    made = Clock()
    monkeypatch.setattr(time, "perf_counter", made.perf_counter)
    monkeypatch.setattr(time, "sleep", made.sleep)
    return made


def ran(control, driver, **options):
    return run_hardware(control, driver, duration=0.1, **{"soft_start": 0.0, "hold": True, **options})


def test_cycles_keep_their_instants(clock):
    control, driver = Steps(clock, [0.002, 0.006] * 5), Fake()
    found = ran(control, driver)
    assert (len(found.jitter), found.overruns, found.skipped, found.ended) == (10, 0, 0, "finished")
    assert found.jitter == pytest.approx(1e-5, abs=1e-7)
    assert found.latency == pytest.approx([0.002, 0.006] * 5, abs=1e-7)
    assert [late for _, late, _ in control.calls] == [None] * 10
    assert found.summary()["cycles"] == found.status["solved"] == found.health["ok"] == 10


def test_spinning_takes_out_what_sleeping_adds(clock):
    assert ran(Steps(clock, [0.002] * 10), Fake(), spin=2e-5).jitter == pytest.approx(0.0, abs=1e-7)


def test_missed_cycles_are_stamped_and_logged(clock):
    control = Steps(clock, [0.002, 0.035] + [0.002] * 6)
    found = ran(control, Fake())
    assert (found.overruns, found.skipped, len(found.jitter), len(found.log.t)) == (1, 2, 8, 10)
    assert [late for _, late, _ in control.calls] == [None, None, True] + [None] * 5
    # cycles 2 and 3 are missed
    assert np.diff(control.times) == pytest.approx([0.01, 0.03] + [0.01] * 5)
    assert np.isnan(found.log.y[2:4]).all()
    assert not np.isnan(found.log.y[4:]).any()
    assert found.log.t == pytest.approx(0.01 * np.arange(10))


def test_the_rest_of_a_period_is_the_drivers(clock):
    rests, driver = iter([0.001, 0.011, 0.001] + [0.0] * 7), Fake()
    driver.idle = lambda: clock.sleep(next(rests))
    found = ran(Steps(clock, [0.002] * 10), driver)
    assert (found.overruns, found.skipped) == (1, 0)


def test_a_command_fades_in_and_the_controller_knows(clock):
    control, driver = Steps(clock, [], wanted=11.0), Fake()
    ran(control, driver, soft_start=0.05)
    assert [u for u, _ in driver.sent] == pytest.approx([3.0, 5.0, 7.0, 9.0, 11.0] + [11.0] * 5)
    assert [None if applied is None else applied[0] for *_, applied in control.calls[:6]] == pytest.approx(
        [None, 3.0, 5.0, 7.0, 9.0, None], nan_ok=True
    )


@pytest.mark.parametrize("failing", ["read", "write", "step"])
def test_whatever_fails_ends_at_rest(clock, failing):
    reads = iter([[0.0, 0.18]] * 3)
    control = Steps(clock, [], wanted=30.0)
    driver = Fake(lambda: next(reads)) if failing == "read" else Fake(fails_at=3 if failing == "write" else None)
    if failing == "step":
        control.health = iter([Health.OK, Health.OK, "no health"])
    with pytest.raises((StopIteration, OSError, ValueError)) as raised:
        ran(control, driver)
    found = raised.value.result
    assert found.ended == "failed"
    assert "input at rest" in raised.value.__notes__[0]
    ramp = [u for u, status in driver.sent if status is CommandStatus.SAFE_RAMP]
    assert ramp[-1] == REST
    assert len(ramp) == 25
    assert np.all(np.diff(ramp) < 0.0)


def test_ctrl_c_ends_at_rest(clock):
    reads = iter([[0.0, 0.18]] * 3)

    def read():
        try:
            return next(reads)
        except StopIteration:
            signal.raise_signal(signal.SIGINT)

    driver = Fake(read)
    with pytest.raises(Interrupted) as raised:
        ran(Steps(clock, []), driver)
    assert raised.value.result.ended == "interrupted"
    assert driver.sent[-1] == (REST, CommandStatus.SAFE_RAMP)


def test_a_trip_ends_when_the_command_rests(clock):
    driver = Fake()
    found = ran(Steps(clock, [], health=[Health.OK] * 3 + [Health.TRIPPED] * 7), driver)
    assert (found.ended, found.cause, len(found.jitter)) == ("tripped", "tripped: it swings", 4)
    assert driver.sent[-1][0] == REST


@pytest.mark.parametrize("silence", [lambda: None, lambda: [np.nan, np.nan]])
def test_silence_ends_the_loop(clock, silence):
    driver = Fake(silence)
    found = ran(Steps(clock, []), driver, watchdog=0.035)
    assert found.ended == "silent"
    assert len(found.jitter) == 4
    assert driver.sent[-1] == (REST, CommandStatus.SAFE_RAMP)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs timers of Unix")
@pytest.mark.parametrize("hanging", ["read", "write"])
def test_a_driver_that_hangs_is_broken_off(clock, hanging):
    driver = Fake(lambda: sleep(5.0)) if hanging == "read" else Fake()
    if hanging == "write":
        hangs = iter([5.0])
        write = driver.write
        driver.write = lambda command: (sleep(next(hangs, 0.0)), write(command))
    began = time.monotonic()
    found = ran(Steps(clock, []), driver, watchdog=0.05)
    assert found.ended == "silent"
    assert "did not return" in found.cause
    assert time.monotonic() - began < 4.0
    assert driver.sent[-1] == (REST, CommandStatus.SAFE_RAMP)


def test_the_bench_counts_in_its_own_way(clock):
    mounting = Mounting(
        camera={"position": (0.01, 0.0), "scale": 2.0, "mirrored": True}, drives=(Connection(of=1, sign=-1, zero=0.5),)
    )
    control, driver = Steps(clock, [], mounting=mounting), Fake(lambda: [0.02, -0.36])
    found = ran(control, driver)
    assert control.calls[0][0] == pytest.approx([0.02, 0.18])  # 0.02 / 2 + 0.01, and y the other way round
    assert driver.sent[0][0] == pytest.approx(-4.5)
    assert found.log.u[0, 0] == 5.0  # as the controller counts


def test_the_operating_system_says_what_it_granted(clock):
    own = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [0]
    found = ran(Steps(clock, []), Fake(), realtime=RealTime(priority=10, core=own[0], lock_memory=False))
    assert [one.partition(":")[0] for one in found.realtime] == [f"core {own[0]}", "priority 10"]
    assert all(one.endswith("granted") or "refused (" in one for one in found.realtime)
    assert not hasattr(os, "sched_getaffinity") or sorted(os.sched_getaffinity(0)) == own
    absent = ran(Steps(clock, []), Fake(), realtime=RealTime(core=4095)).realtime
    assert "refused (" in absent[0]


@pytest.mark.parametrize(
    "wrong",
    [{"duration": 0.0}, {"duration": 1e300}, {"spin": 0.01}, {"spin": -1.0}, {"watchdog": 0.0}, {"soft_start": -1.0}],
)
def test_arguments_are_checked(clock, wrong):
    with pytest.raises(InputError):
        run_hardware(Steps(clock, []), Fake(), **{"duration": 1.0, **wrong})
    with pytest.raises(InputError, match="driver"):
        run_hardware(Steps(clock, []), object(), duration=1.0)


@pytest.mark.deep
def test_a_simulated_bench_is_held_and_its_log_replayed():
    """Of a plant that is stiffer than the model; the log is consistent, and a second controller goes on smoothly."""
    tried = scene(stiffness=1.1)
    controller = Controller(tried, deadline=1e9)
    bench = SimulatedBench(tried)
    found = run_hardware(controller, bench, duration=0.8, hold=True)
    assert found.ended == "finished"
    assert replay(tried, found.log).status == "consistent"
    last = controller.step(bench.read(), late=True)
    again = run_hardware(controller, bench, duration=0.4, start=last, soft_start=0.0)
    assert np.abs(again.log.u[0] - last.u).max() <= 600.0 * 0.01 + 1e-9  # N, the rate limit
    handed = run_hardware(controller, bench, duration=0.2, start=[4.0, 2.0], soft_start=0.1)
    assert np.abs(handed.log.u[0] - [4.0, 2.0]).max() < 2.0
    assert np.abs(handed.log.u[-1] - handed.log.u[-2]).max() < 6.0


@pytest.mark.deep
def test_a_board_behind_a_serial_line():
    """An emulated board with the plant in it, whose lines are damaged now and then."""
    pytest.importorskip("serial")
    ours, theirs = os.openpty()
    for end in (ours, theirs):
        tty.setraw(end)
    tried, stop = scene(), threading.Event()
    bench = SimulatedBench(tried)
    bench.idle()  # compiled
    statuses: list[str] = []

    def board():
        number, rest = 0, b""
        while not stop.is_set():
            values = ",".join("" if np.isnan(one) else f"{one:.6g}" for one in bench.read())
            line = checked(f"y,{number},{values}")
            os.write(ours, line.replace(b"y", b"z") if number % 10 == 9 else line)
            number += 1
            time.sleep(0.008)
            while select_ready(ours):
                rest += os.read(ours, 4096)
            *lines, rest = rest.split(b"\n")
            for text in lines:
                fields = text.decode().split("*")[0].split(",")
                statuses.append(fields[2])
                bench.write(SimpleNamespace(u=np.array([float(one) for one in fields[3:]])))
            bench.idle()

    serial = SerialBoard(os.ttyname(theirs), len(SCENE["estimator"]["measured"]) + 3)
    thread = threading.Thread(target=board)
    thread.start()
    try:
        found = run_hardware(Controller(tried, deadline=1e9), serial, duration=0.6, watchdog=1.0)
    finally:
        stop.set()
        thread.join()
        serial.close()
        os.close(ours)
    assert found.ended == "finished"
    assert serial.damaged > 0
    assert np.isfinite(found.log.y).all(axis=1).sum() > 10
    assert statuses[-1] == "safe_ramp"
    assert PLANT


def checked(text: str) -> bytes:
    """A line of the protocol: text, and its CRC-32."""
    return f"{text}*{zlib.crc32(text.encode()):08x}\n".encode()


def select_ready(end) -> bool:
    import select

    return bool(select.select([end], [], [], 0.0)[0])


def test_a_bag_has_the_log_and_the_beliefs(tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="bags; in the extra 'test'")
    tried = scene()
    controller = Controller(tried, deadline=1e9)
    before = time.time_ns()
    found = run_hardware(controller, SimulatedBench(tried), duration=0.1, soft_start=0.0, mcap=tmp_path / "run.mcap")
    table = DataTable.read(tmp_path / "run.mcap")
    rows = [column.split(" ")[0] for column in found.log.y_names]
    read = np.column_stack([table.numbers(name, gaps=True) for name in rows])
    assert np.array_equal(read, found.log.y, equal_nan=True)
    assert np.array_equal(table.numbers("commanded_tension_1"), found.log.u[:, 0])
    assert table.numbers("reference_tip_y") == pytest.approx(0.172)
    # A machine under load skips periods: these have a row in the log, and no estimate.
    assert np.isnan(table.numbers("estimated_theta_1", gaps=True)).sum() == found.skipped
    with open(tmp_path / "run.mcap", "rb") as stream:
        summary = reader.make_reader(stream).get_summary()
    assert before < summary.statistics.message_start_time < time.time_ns()
    topics = {"/measured", "/estimate", "/commands", "/reference", "/health"}
    assert {channel.topic for channel in summary.channels.values()} == topics
