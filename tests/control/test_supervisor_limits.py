"""Every limit and duration of the supervisor's C and of its checks of numbers: held just below, broken just above.

The C runs alone, with two sensors of one reading each: a camera and a drive. What its means hold is set by hand, so
that a call judges exactly that.
"""

from __future__ import annotations

import ctypes
import math
from functools import lru_cache

import pytest

from continuum_grasp.control import Health, MeasurementVerdict, Trip, template
from continuum_grasp.core import Compiler

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")

W = 20
"""Window [1]."""
DELAY = 4
"""Calls before innovations count [1]."""
FAR = 0.018
"""Distance beyond which a tip is away [m]."""
SETTLING, OFFSET = 50, 0.002
"""Calls that a loop needs for a setpoint that stands, and distance from it at which a tip is off [m]."""
NOISE = (0.3, 0.1)
"""Standard deviation of each reading."""
STILL = 2.0**-7
"""Greatest change of a reading at rest; a sum of such changes is exact."""
CHANGE = (6.0, 3.0)
"""Change of a command per call at activity 1."""

_HEAD = """
#include <stddef.h>
typedef double real;
#define CONTROLLER_NM 2
#define CONTROLLER_NS 2
#define RTI_NU 2
"""
_TAIL = """
size_t sizes(int k) { return k == 0 ? sizeof(supervisor_settings) : k == 1 ? sizeof(supervisor_state)
                           : k == 2 ? sizeof(supervisor_evidence) : sizeof(supervisor_report); }
int verdict(double a, double least, double most) { return cg_verdict(a, least, most); }
double limited(double a, double least, double most, int *outside) { *outside = cg_limit(&a, least, most); return a; }
"""

TWO, THREE, INTS = 2 * ctypes.c_double, 3 * ctypes.c_double, 2 * ctypes.c_int


def _structure(name, **members):
    """A structure of C whose members of one type stand together, separated by spaces."""
    fields = [(member, kind) for names, kind in members.values() for member in names.split()]
    return type(name, (ctypes.Structure,), {"_fields_": fields})


REAL, INT = ctypes.c_double, ctypes.c_int
Settings = _structure(
    "Settings",
    a=("window delay rungs", INT),
    b=("sensor shape drive cause", INTS),
    c=("still noise hidden change", TWO),
    d=("tip setpoint", INT),
    e=("far", REAL),
    f=("settling", INT),
    g=("offset", REAL),
)
State = _structure(
    "State",
    a=("last", TWO),
    b=("still", INTS),
    c=("path", TWO),
    d=("mismatch", THREE),
    e=("activity", REAL),
    f=("echo along travel ahead change usual before common caused silent together", TWO),
    g=("calls rung raises since calm doubted late", INT),
    h=("swinging contradicted away unseen implausible tripped trips since_rearmed suspect stood off", INT),
    i=("mean", TWO),
    j=("offset", REAL),
)
Evidence = _structure(
    "Evidence",
    a=("nis echo along travel ahead change y expected verdict", ctypes.c_void_p),
    b=("implausible", INT),
    c=("elapsed distance", REAL),
    d=("origin", TWO),
    e=("moves", INT),
)
Report = _structure(
    "Report",
    a=("health sensor entry reason rung contradicts ahead cause", INT),
    b=("mismatch activity offset", REAL),
)


@lru_cache
def library() -> ctypes.CDLL:
    files = [template(name) for name in ("checks.h", "supervisor.h", "supervisor.c")]
    text = "\n".join([_HEAD, *files, _TAIL]).replace('#include "checks.h"', "")
    found = Compiler.load(text, "the supervisor")
    found.limited.restype = REAL
    found.verdict.argtypes, found.limited.argtypes = [REAL] * 3, [REAL] * 3 + [ctypes.c_void_p]
    for k, kind in enumerate((Settings, State, Evidence, Report)):
        found.sizes.restype = ctypes.c_size_t
        assert found.sizes(k) == ctypes.sizeof(kind)
    return found


class Watch:
    """A supervisor after its first calls, whose state is set by name."""

    def __init__(self, **state) -> None:
        self.settings = Settings(
            W,
            DELAY,
            2,
            INTS(0, 1),
            INTS(1, 0),
            INTS(0, 1),
            INTS(-1, 0),
            TWO(STILL, -1.0),
            TWO(*NOISE),
            TWO(0.0, 0.0),
            TWO(*CHANGE),
            0,
            0,
            FAR,
            SETTLING,
            OFFSET,
        )
        self.state = State(calls=DELAY, since=5 * W)
        self.put(**state)

    def put(self, **state) -> None:
        for name, value in state.items():
            setattr(self.state, name, type(getattr(self.state, name))(*value) if isinstance(value, tuple) else value)

    def judge(
        self,
        nis=(-1.0, -1.0),
        echo=(0.0, 0.0),
        behind=(0.0, 0.0),
        verdict=(0, 0),
        y=None,
        expected=(0.0, 0.0),
        **others,
    ) -> Report:
        """A call; without a reading the camera's is an outlier, so that what is known of it stays."""
        readings, report = TWO(*(y or (0.0, 0.0))), Report()
        verdicts = INTS(*verdict) if y is not None or verdict[0] else INTS(MeasurementVerdict.OUTLIER, verdict[1])
        library().supervisor_screen(*map(ctypes.byref, (self.state, self.settings, readings, report)))
        if math.isnan(readings[0]) and y is not None:
            verdicts[0] = MeasurementVerdict.FROZEN
        along, travel = TWO(0.0, behind[0]), TWO(0.0, behind[1])  # of the drive
        ahead, change = TWO(0.0, 0.0), TWO(0.0, 0.0)
        arrays = TWO(*nis), TWO(*echo), along, travel, ahead, change, readings, TWO(*expected), verdicts
        seen = Evidence(*map(ctypes.addressof, arrays), **{"elapsed": -1.0, "distance": -1.0, **others})
        library().supervisor_judge(*map(ctypes.byref, (self.state, self.settings, seen, report)))
        return report

    def note(self, *change: float) -> None:
        library().supervisor_note(ctypes.byref(self.state), ctypes.byref(self.settings), TWO(*change))

    def rearm(self) -> bool:
        return bool(library().supervisor_rearm(ctypes.byref(self.state), ctypes.byref(self.settings)))

    def when(self, happens, most=400, **call) -> int:
        """The number of the call after which something is so; one beyond the last where it never is."""
        return next((k for k in range(1, most + 1) if happens(self.judge(**call))), most + 1)


def tripped(reason):
    return lambda report: report.reason == reason


def health(value):
    return lambda report: report.health == value


def raised(report) -> bool:
    return report.rung > 0


LONG = 2 * W + W // 2
"""2.5 windows [1]."""


def seen(happens, **state):
    """Calls until something happens with an entry of the state: the greatest mismatch, or the drive's echo."""

    def calls(name, value):
        entry = {"mismatch": (0.0, value, 0.0), "echo": (0.0, value), "along": (0.0, value)}
        entry = {**entry, "ahead": (0.0, value)}.get(name, value)
        return Watch(**{**state, name: entry}).when(happens)

    return calls


ACTIVE, DOUBTED = {"activity": 0.01}, {"mismatch": (0.0, 5.0, 0.0)}
RAISED = {"rung": 1, "raises": 1}
# Of a state: what is limited, its limit, calls until something happens below it and above (401: it does not).
LIMITS = {
    "mismatch reported": (seen(health(Health.MISMATCH)), "mismatch", 2.5, 401, 1),
    "mismatch that contradicts now": (seen(lambda r: r.contradicts, **RAISED), "mismatch", 2.5, 401, 1),
    # 1.5 = (0.15 (14 + 1))^0.5
    "a drive that falls behind": (seen(health(Health.MISMATCH), travel=(0.0, 14.0)), "along", 1.5, 401, 1),
    # 1.5 = (0.15 15)^0.5
    "a drive that runs ahead": (seen(lambda r: r.ahead > 0, change=(0.0, 15.0)), "ahead", 1.5, 401, 1),
    "a drive that does not follow": (seen(lambda r: r.ahead < 0, change=(0.0, 15.0)), "ahead", -1.5, 401, 1),
    "mismatch that lasts": (seen(raised, **ACTIVE), "mismatch", 3.0, 401, LONG),
    "severe mismatch": (seen(raised, **ACTIVE), "mismatch", 10.0, LONG, 1),
    "activity of a loop that is detuned": (seen(raised, **DOUBTED), "activity", 0.002, 401, LONG),
    "mismatch of calm": (seen(lambda r: not r.rung, **RAISED), "mismatch", 1.5, 5 * W, 401),
    "activity of calm": (seen(lambda r: not r.rung, **RAISED), "activity", 0.002, 5 * W, 401),
    "echo of calm": (seen(lambda r: not r.rung, **RAISED), "echo", 0.15, 5 * W, 401),
    "echo of a late drive": (seen(raised), "echo", 0.15, 401, LONG),
    "mismatch that contradicts": (seen(tripped(Trip.CONTRADICTED)), "mismatch", 20.0, 401, LONG),
    "mismatch of a loop that swings": (
        seen(tripped(Trip.SWINGING), activity=1.0, rung=2),
        "mismatch",
        3.0,
        401,
        LONG,
    ),
    "activity of a loop that swings": (seen(tripped(Trip.SWINGING), rung=2, **DOUBTED), "activity", 0.1, 401, LONG),
}


@pytest.mark.parametrize("case", LIMITS)
def test_a_limit_of_a_mean_is_held_below_and_broken_above(case):
    calls, name, limit, below, above = LIMITS[case]
    assert (calls(name, 0.999 * limit), calls(name, 1.001 * limit)) == (below, above)
    assert calls(name, limit) == (below if name == "echo" else max(below, above))  # at the limit nothing happens


def test_a_drive_that_falls_behind_or_runs_ahead_is_reported_alone():
    """By a sum that grows with the motion; noise of one standard deviation that follows itself at rest is none."""
    for along, travel, expected in ((1.6, 14.0, 1), (-1.6, 14.0, 1), (1.0, 1.0, 1), (0.3, 0.3, -1)):
        report = Watch(along=(9.0, along), travel=(1.0, travel)).judge()  # the camera is no drive
        assert (report.health, report.contradicts) == (Health.MISMATCH if expected >= 0 else Health.OK, 0)
        assert report.sensor == max(expected, 0)
    watch = Watch(along=(0.0, 9.0))
    assert watch.judge().sensor == 1
    watch.put(mismatch=(5.0, 0.0, 0.0))  # what contradicts most is named first
    assert (watch.judge().sensor, watch.judge().contradicts) == (0, 1)
    watch = Watch()
    assert watch.when(raised, nis=(1.0, 1.0), behind=(20.0, 40.0)) == 401  # a report, no action
    assert watch.judge().health == Health.MISMATCH


def test_a_tip_is_away_beyond_the_distance_only_with_a_mismatch():
    for distance, mismatch, expected in (
        (1.001, 3.003, 5 * W),
        (1.0, 3.003, 401),
        (0.999, 3.003, 401),
        (1.001, 2.997, 401),
    ):
        watch = Watch(mismatch=(mismatch, 0.0, 0.0))
        assert watch.when(tripped(Trip.AWAY), distance=distance * FAR) == expected
        assert watch.state.away == (0 if expected > 400 else 5 * W)


@pytest.mark.parametrize(("away", "near"), [(9, 1), (7, 3), (13, 7), (6, 4)])
def test_a_tip_that_swings_through_its_setpoint_is_away_where_it_is_so_two_thirds_of_the_time(away, near):
    """Each call near the setpoint takes back two; what is gained per swing adds up to five windows, or never."""
    watch, cycle, gain = Watch(mismatch=(5.0, 0.0, 0.0)), away + near, away - 2 * near
    distances = [FAR * (2.0 if call % cycle < away else 0.5) for call in range(50 * W)]
    lost = [watch.judge(distance=distance).reason == Trip.AWAY for distance in distances]
    assert any(lost) is (gain > 0)
    if gain > 0:
        assert (5 * W - away) / gain <= (lost.index(True) + 1) / cycle <= 5 * W / gain


def stays(watch: Watch, x: float, y: float = 0.0, **others) -> Report:
    """A call in which the tip is off by so much [m]."""
    return watch.judge(distance=math.hypot(x, y), origin=TWO(x, y), **others)


@pytest.mark.parametrize(("distance", "windows"), [(0.99, None), (1.5, 20), (3.0, 5), (4.0, 10 / 3), (9.0, 10 / 3)])
def test_a_tip_that_stays_away_from_a_setpoint_that_stands_is_off(distance, windows):
    """A window counts by the excess over the limit, three at most; ten are enough, from a window after settling on."""
    watch, angle = Watch(), 0.7
    x, y = distance * OFFSET * math.cos(angle), distance * OFFSET * math.sin(angle)
    calls = [stays(watch, x, y) for _ in range(SETTLING + 40 * W)]
    off = [k for k, report in enumerate(calls, start=1) if report.health == Health.OFFSET]
    if windows is None:
        assert not off
    else:
        assert off[0] == pytest.approx(SETTLING + W + windows * W, abs=2)
        assert off == [*range(off[0], len(calls) + 1)]
        assert (calls[-1].sensor, calls[-1].offset) == (0, pytest.approx(distance * OFFSET))
    assert all(report.offset == 0.0 for report in calls[: off[0] - 1 if off else None])


def test_a_tip_that_swings_about_its_setpoint_or_follows_one_that_moves_is_not_off():
    watch = Watch()
    for call in range(50 * W):
        assert stays(watch, 9.0 * OFFSET * math.cos(2.0 * math.pi * call / W)).health == Health.OK
    for call in range(50 * W):
        assert stays(watch, 9.0 * OFFSET, moves=int(call % (SETTLING + W) == 0)).health == Health.OK


def test_an_offset_ends_with_the_distance_the_setpoint_or_a_trip_and_yields_to_a_raised_weight():
    def off() -> Watch:
        watch = Watch()
        for _ in range(SETTLING + 6 * W):
            report = stays(watch, 3.0 * OFFSET, 3.0 * OFFSET)
        assert report.health == Health.OFFSET
        return watch

    assert stays(off(), 3.0 * OFFSET, moves=1).offset == 0.0
    watch = off()
    reports = [stays(watch, 0.0) for _ in range(20 * W)]
    lasts = [report.health for report in reports].index(Health.OK)
    # The mean, r = 18^0.5 exp(-t / 5) in windows, is within the limit from 7.23 on; then half of the evidence goes in
    # s = 9.2 more: s - 5 (1 - exp(-s / 5)) = 5.
    assert lasts == pytest.approx((7.23 + 9.2) * W, abs=5)
    uneasy = {"rung": 1, "mismatch": (2.0, 0.0, 0.0)}  # not calm, or the rung would fall
    for state, expected in ((uneasy, Health.DETUNED), ({"mismatch": (5.0, 0.0, 0.0)}, Health.OFFSET)):
        watch = off()
        watch.put(**state)
        report = stays(watch, 3.0 * OFFSET, 3.0 * OFFSET)
        assert (report.health, report.offset > OFFSET) == (expected, True)
    watch = off()
    watch.put(tripped=int(Trip.AWAY))
    assert (stays(watch, 3.0 * OFFSET).health, watch.judge().offset) == (Health.TRIPPED, 0.0)


@pytest.mark.parametrize(
    "verdict",
    [MeasurementVerdict.MISSING, MeasurementVerdict.ABSURD, MeasurementVerdict.FROZEN, MeasurementVerdict.OUTLIER],
)
def test_a_shape_that_nothing_shows_trips(verdict):
    """Five windows without a reading, 1.5 with one that is frozen; neither drives nor outliers count."""
    expected = {MeasurementVerdict.FROZEN: W + W // 2, MeasurementVerdict.OUTLIER: 401}.get(verdict, 5 * W)
    watch = Watch()
    assert watch.when(tripped(Trip.UNSEEN), verdict=(verdict, 0)) == expected
    assert Watch().when(tripped(Trip.UNSEEN), verdict=(0, verdict)) == 401
    if expected < 400:
        assert watch.judge().sensor == 0
        assert watch.state.unseen == 0
    # Of a finger that has drives alone, these are all that can be seen.
    watch = Watch()
    watch.settings.shape = INTS(0, 0)
    assert watch.when(tripped(Trip.UNSEEN), verdict=(verdict, verdict)) == expected


def test_a_drive_that_is_frozen_shortens_no_wait_for_the_camera():
    assert Watch().when(tripped(Trip.UNSEEN), verdict=(MeasurementVerdict.MISSING, MeasurementVerdict.FROZEN)) == 5 * W


def test_a_disturbance_at_its_limit_trips():
    watch = Watch()
    assert watch.when(tripped(Trip.IMPLAUSIBLE), implausible=1) == LONG
    watch = Watch()
    assert watch.when(tripped(Trip.IMPLAUSIBLE), most=LONG - 1, implausible=1) == LONG
    watch.judge()
    assert watch.when(tripped(Trip.IMPLAUSIBLE), most=LONG - 1, implausible=1) == LONG


@pytest.mark.parametrize(
    ("moved", "path", "expected"),
    [
        (0.999 * STILL, 0.0201, W + DELAY),
        (-0.999 * STILL, 0.0201, W + DELAY),
        (1.001 * STILL, 0.0201, 401),
        (-1.001 * STILL, 0.0201, 401),
        (STILL, 0.0201, W + DELAY),
        (-STILL, 0.0201, W + DELAY),
        (0.0, 0.01998, 401),
        (0.0, 0.02, 401),
        (0.0, 0.02002, W + DELAY),
    ],
)
def test_a_reading_at_rest_is_frozen_once_the_command_has_moved(moved, path, expected):
    """A reading that goes to and fro; a command that has been away for as long."""
    assert _frozen_after(Watch(), [1.0 + moved * (k % 2) for k in range(402)], path) == expected


def test_a_reading_that_creeps_moves():
    """Steps that are each as of a reading at rest, of a noiseless camera that shows a finger settle."""
    assert _frozen_after(Watch(), [1.0 + 0.4 * STILL * k for k in range(402)], 1.0) == 401


def test_a_reading_that_rested_before_the_command_moved_has_time_to_answer():
    watch = Watch()
    assert _frozen_after(watch, [1.0] * 402, 0.0) == 401  # at rest as well
    assert _frozen_after(watch, [1.0] * 402, 1.0) == W + DELAY


def _frozen_after(watch, readings, path) -> int:
    """Calls until the first reading is frozen, 401 if it never is, of a command that moves by so much in each."""
    watch.judge(y=(readings[0], 0.0))
    for calls, y in enumerate(readings[1:], start=1):
        watch.put(path=(path, 0.0))
        report = watch.judge(y=(y, 0.0))
        assert report.health == (Health.FROZEN if report.entry == 0 else Health.OK)
        if report.entry == 0:
            return calls
    return 401


def test_which_readings_are_compared():
    """None before the first one; one whose change may be zero at most; the first of two that are frozen is reported."""
    watch = Watch(calls=0)
    watch.judge(y=(0.0, 0.0))
    assert watch.state.still[0] == 0
    for still, entry in ((0.0, 0), (-1.0, -1)):
        watch = Watch(path=(1.0, 1.0))
        watch.settings.still = TWO(still, still)
        reports = []
        for _ in range(W + DELAY + 1):
            watch.put(path=(1.0, 1.0))
            reports.append(watch.judge(y=(1.0, 1.0)))
        assert reports[-1].entry == entry


def test_the_path_of_a_command_counts_for_what_it_moves():
    watch = Watch()
    watch.note(0.0, -0.01 * CHANGE[1])
    assert list(watch.state.path) == pytest.approx([0.01, 0.0])
    watch.note(0.005 * CHANGE[0], 0.0)
    assert list(watch.state.path) == pytest.approx([0.015, 0.005])
    assert watch.state.activity == pytest.approx((0.01**2 / 2 * (1 - 1 / W) + 0.005**2 / 2) / W)
    for path, expected in ((0.02 * 0.999, 1.02 - 0.00002), (0.02, 1.02), (0.02 * 1.001, 0.02002)):
        watch.put(path=(path, 0.0))
        watch.note(CHANGE[0], 0.0)
        assert watch.state.path[0] == pytest.approx(expected)


@pytest.mark.parametrize(("verdict", "calls"), [("MISSING", LONG), ("OUTLIER", LONG), ("FROZEN", 401)])
def test_a_device_contradicts_as_long_as_it_is_not_frozen(verdict, calls):
    """What was measured before a reading was found to be frozen is no evidence; without that nothing would end it."""
    watch = Watch(mismatch=(0.0, 30.0, 0.0), echo=(0.0, 1.0), ahead=(0.0, 2.0))
    assert watch.when(tripped(Trip.CONTRADICTED), verdict=(0, MeasurementVerdict[verdict])) == calls
    assert watch.state.mismatch[1] == (0.0 if verdict == "FROZEN" else 30.0)
    assert (watch.state.echo[1], watch.state.ahead[1]) == ((0.0, 0.0) if verdict == "FROZEN" else (1.0, 2.0))


def test_means_are_over_windows():
    """A window of innovations and motions, five of echoes, half a window of readings; none before the delay."""
    watch = Watch()
    watch.judge(nis=(2.0, 4.0), echo=(0.5, 1.0), behind=(2.0, 3.0), y=(3.0, 0.0))
    state = watch.state
    assert list(state.mismatch) == pytest.approx([2.0 / W, 4.0 / W, 0.0])
    assert list(state.echo) == pytest.approx([0.5 / (5 * W), 1.0 / (5 * W)])
    assert (state.along[1], state.travel[1]) == pytest.approx((2.0 / (5 * W), 3.0 / (5 * W)))
    assert state.usual[0] == pytest.approx(2.0 * 3.0 / W)
    watch = Watch(mismatch=(1.0, 1.0, 0.0))
    assert watch.judge(nis=(0.0, 0.0)).sensor == 0  # of two alike the first
    assert list(watch.state.mismatch[:2]) == pytest.approx([1.0 - 1.0 / W] * 2)
    for calls, expected in ((DELAY - 1, 0.0), (DELAY, 2.0 / W)):
        watch = Watch(calls=calls)
        watch.judge(nis=(2.0, -1.0))
        assert watch.state.mismatch[0] == pytest.approx(expected)
    watch = Watch(calls=0)
    watch.judge(y=(3.0, 0.0))
    assert watch.state.usual[0] == 3.0


def moving(watch, caused, moved, calls=1):
    """Calls with a motion that drives cause and that of the reading, both about slow means, in standard deviations."""
    for _ in range(calls):
        watch.put(usual=(-moved * NOISE[0] / (1.0 - 2.0 / W), 0.0))
        report = watch.judge(y=(0.0, 0.0), expected=(caused * NOISE[0], 0.0))
    return report


def evidence(caused, common, lasting, most=0.0):
    """Log-likelihood of white noise over noise with a known part, whose square in it is 0.3 of what drives cause."""
    part = max(0.3 * caused**2, most * (1.0 - 1.0 / W))
    return (0.15 * caused**2 - abs(common) - lasting) * part / (1.0 + part) ** 2


@pytest.mark.parametrize(
    ("caused", "moved", "state"),
    [
        (2.0, 0.0, {}),
        (2.0, 0.6, {}),
        (2.0, 0.6, {"before": 1.0}),  # what lasts from one reading to the next is no noise
        (2.0, 0.6, {"before": -1.0}),
        (2.0, 0.0, {"common": 1.0}),
        (2.0, 0.0, {"common": -1.0}),  # nor what is in step with the drives, against them where they are late
        (2.0, 0.0, {"caused": 300.0}),  # after a great motion
        (10.0, 0.0, {"before": -2.0}),
        (3.0, 3.0, {"before": 3.0}),
    ],
)
def test_evidence_of_an_old_image_by_call(caused, moved, state):
    watch = Watch(silent=(5.0, 0.0), together=(6.0, 0.0), **{name: (value, 0.0) for name, value in state.items()})
    common = state.get("common", 0.0) * (1.0 - 1.0 / W) + caused * moved / W
    more = min(max(evidence(caused, common, state.get("before", 0.0) * moved, state.get("caused", 0.0)), -1.0), 1.0)
    moving(watch, caused, moved)
    assert watch.state.silent[0] == pytest.approx(5.0 + more, abs=1e-12)
    assert watch.state.together[0] == pytest.approx(6.0 + more, abs=1e-12)
    assert watch.state.before[0] == pytest.approx(moved)
    assert watch.state.common[0] == pytest.approx(common)
    assert watch.state.caused[0] == pytest.approx(max(0.3 * caused**2, state.get("caused", 0.0) * (1.0 - 1.0 / W)))
    watch.settings.noise = TWO(-1.0, 0.1)  # below zero: not compared
    moving(watch, caused, moved)
    assert watch.state.silent[0] == pytest.approx(5.0 + more, abs=1e-12)


@pytest.mark.parametrize(("start", "trip"), [(0.999, False), (1.001, True)])
@pytest.mark.parametrize("kind", ["silent", "together"])
def test_an_old_image_trips_by_a_reading_and_by_all_of_a_device(kind, start, trip):
    part = 0.3 * 3.0**2  # of the square of what drives cause; log-likelihood of noise over noise with that part
    more = 0.15 * 3.0**2 * part / (1.0 + part) ** 2
    watch = Watch(**{kind: (start * (20.0 - more), 0.0)})
    assert moving(watch, 3.0, 0.0).reason == (Trip.UNANSWERED if trip else Trip.NONE)
    assert not trip or watch.state.suspect == 0
    moving(watch, 10.0, 0.0, 60)
    assert (watch.state.silent[0], watch.state.together[0]) == (20.0, 20.0)
    moving(watch, 10.0, 10.0, 30)
    assert (watch.state.silent[0], watch.state.together[0]) == (0.0, 0.0)


@pytest.mark.parametrize(("caused", "more"), [(2.999, False), (3.001, True)])
def test_what_friction_may_hold_is_no_evidence(caused, more):
    watch = Watch()
    watch.settings.hidden = TWO(9.0, 0.0)
    moving(watch, caused, 0.0, 20)
    assert (watch.state.silent[0] > 0.0) == more


def test_a_reading_that_moves_does_not_hide_one_that_is_old():
    watch = Watch()
    watch.settings.sensor, watch.settings.cause = INTS(0, 0), INTS(-1, -1)
    for _ in range(60):
        watch.put(usual=(0.0, -10.0 * NOISE[1] / (1.0 - 2.0 / W)))
        report = watch.judge(y=(0.0, 0.0), expected=(10.0 * NOISE[0], 10.0 * NOISE[1]))
    assert report.reason == Trip.UNANSWERED
    assert (watch.state.silent[1], watch.state.together[0]) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("off", "expected"), [(0.2, 1.0), (-0.2, 1.0), (0.999 * 0.2 * 30**0.5, 30 * 0.999**2), (2.0, 30.0), (-1.0, 25.0)]
)
def test_the_time_between_calls_is_a_sensor(off, expected):
    watch = Watch()
    report = watch.judge(elapsed=1.0 + off)
    assert watch.state.mismatch[2] == pytest.approx(expected / W)
    assert report.sensor == 2


@pytest.mark.parametrize(
    ("state", "since", "below", "above"),
    [
        # Half a window since the last raise; five windows for an echo, but for the first raise.
        ({"mismatch": (20.0, 0.0, 0.0), "activity": 1.0, **RAISED}, W // 2 - 1, 1, 2),
        ({"echo": (0.0, 1.0), "late": LONG, **RAISED}, 5 * W - 1, 1, 2),
        ({"echo": (0.0, 1.0), "late": LONG, **RAISED}, 5 * W - 2, 1, 1),
        ({"echo": (0.0, 1.0), "late": LONG}, W // 2 - 1, 0, 1),
        ({"echo": (0.0, 1.0), "late": LONG}, W // 2 - 2, 0, 0),
    ],
)
def test_a_raise_waits_for_the_last_one(state, since, below, above):
    watch = Watch(**state)
    watch.put(since=since - 1 if below != above else since)
    assert watch.judge().rung == below
    watch.put(since=since, **{key: state[key] for key in ("mismatch", "echo") if key in state})
    assert watch.judge().rung == above
    assert watch.state.raises == above


def test_there_are_as_many_raises_as_the_settings_say():
    watch = Watch(mismatch=(20.0, 0.0, 0.0), activity=1.0)
    assert [watch.judge().rung for _ in range(W + 2)] == [1] * (W // 2) + [2] * (W // 2 + 2)
    assert watch.state.since == W // 2 + 1


@pytest.mark.parametrize(("raises", "windows"), [(0, 5), (1, 5), (2, 10), (3, 20), (8, 640), (9, 640), (12, 640)])
def test_calm_takes_twice_as_long_after_each_raise(raises, windows):
    watch = Watch(rung=2, raises=raises)
    assert watch.when(lambda r: r.rung == 1, most=641 * W) == windows * W
    assert watch.state.raises == raises
    assert (watch.state.calm, watch.state.since) == (0, 0)
    assert Watch(raises=raises).when(lambda r: r.rung, most=windows * W) == windows * W + 1


def test_raises_are_counted_up_to_nine():
    for raises, expected in ((7, 8), (8, 9), (9, 9)):
        watch = Watch(mismatch=(20.0, 0.0, 0.0), activity=1.0, raises=raises)
        watch.judge()
        assert watch.state.raises == expected


@pytest.mark.parametrize(("since", "expected"), [(LONG - 2, LONG + 1), (LONG - 1, LONG)])
def test_a_loop_has_time_to_become_calm(since, expected):
    watch = Watch(mismatch=(5.0, 0.0, 0.0), activity=1.0, rung=2, raises=2, since=since)
    assert watch.when(tripped(Trip.SWINGING)) == expected


TRIPPED = {"tripped": Trip.AWAY, "trips": 1}


@pytest.mark.parametrize(
    ("state", "left"),
    [
        ({"tripped": 0}, False),
        ({}, True),
        ({"activity": 0.999 * 0.002}, True),
        ({"activity": 0.002}, False),
        ({"activity": 1.001 * 0.002}, False),
        *[({"mismatch": tuple(0.999 * 1.5 * (k == at) for k in range(3))}, True) for at in range(3)],
        *[({"mismatch": tuple(1.001 * 1.5 * (k == at) for k in range(3))}, False) for at in range(3)],
        ({"unseen": 1}, False),
        ({"trips": 2, "since_rearmed": 150 * W - 1}, False),
        ({"trips": 2, "since_rearmed": 150 * W}, True),
    ],
)
def test_a_trip_is_left_where_all_is_well(state, left):
    counts = dict.fromkeys(("swinging", "away", "implausible", "since"), 9)
    watch = Watch(**{**TRIPPED, **counts, "silent": (9.0, 0.0), "together": (9.0, 0.0), **state})
    assert watch.rearm() is left
    if left:
        after = watch.state
        assert (after.tripped, after.rung, after.since_rearmed, after.away, after.silent[0]) == (0, 2, 0, 0, 0.0)
        assert after.together[0] == 0.0
        assert (after.swinging, after.implausible, after.since) == (0, 0, 0)


def test_time_since_a_trip_was_left_is_counted_to_its_end():
    watch = Watch(since_rearmed=150 * W - 1)
    watch.judge()
    watch.judge()
    assert watch.state.since_rearmed == 150 * W
    watch = Watch(since_rearmed=7, **TRIPPED)
    watch.judge()
    assert watch.state.since_rearmed == 7


def test_the_first_trip_stays():
    watch = Watch(mismatch=(0.0, 30.0, 0.0), contradicted=LONG - 1)
    first = watch.judge()
    assert (first.health, first.reason, first.sensor) == (Health.TRIPPED, Trip.CONTRADICTED, 1)
    watch.put(mismatch=(9.0, 0.0, 0.0), unseen=5 * W - 1)
    last = watch.judge(verdict=(MeasurementVerdict.MISSING, 0))
    assert (last.reason, last.sensor, watch.state.trips, last.rung) == (Trip.CONTRADICTED, 1, 1, 0)


@pytest.mark.parametrize(
    ("value", "verdict"),
    [
        (0.999 * 2.0, MeasurementVerdict.USED),
        (2.0, MeasurementVerdict.USED),
        (1.001 * 2.0, MeasurementVerdict.ABSURD),
        (-0.999, MeasurementVerdict.USED),
        (-1.0, MeasurementVerdict.USED),
        (-1.001, MeasurementVerdict.ABSURD),
        (math.inf, MeasurementVerdict.ABSURD),
        (-math.inf, MeasurementVerdict.ABSURD),
        (math.nan, MeasurementVerdict.MISSING),
    ],
)
def test_a_number_is_checked_against_its_limits(value, verdict):
    assert library().verdict(value, -1.0, 2.0) == verdict
    if math.isfinite(value):
        outside = ctypes.c_int()
        assert library().limited(value, -1.0, 2.0, ctypes.byref(outside)) == min(max(value, -1.0), 2.0)
        assert bool(outside.value) is (verdict == MeasurementVerdict.ABSURD)
