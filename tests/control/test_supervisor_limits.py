"""Every limit and duration of the supervisor's C and of its checks of numbers: held just below, broken just above.

The C runs alone, with two sensors of one reading each: a camera and a drive. What its means hold is set by hand, so
that a call judges exactly that.
"""

from __future__ import annotations

import ctypes
import math
from functools import lru_cache

import pytest

from continuum_grasp.control.rti.source import load_library, template
from continuum_grasp.control.status import Health, Trip, Verdict
from continuum_grasp.core.compiler import find_compiler

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="no C compiler here")

W = 20
"""Window [1]."""
DELAY = 4
"""Calls before innovations count [1]."""
FAR = 0.018
"""Distance beyond which a tip is away [m]."""
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
)
State = _structure(
    "State",
    a=("last", TWO),
    b=("still", INTS),
    c=("path", TWO),
    d=("mismatch", THREE),
    e=("activity", REAL),
    f=("echo usual before common caused silent together", TWO),
    g=("calls rung raises since calm doubted late", INT),
    h=("swinging contradicted away unseen implausible tripped trips since_rearmed suspect", INT),
)
Evidence = _structure(
    "Evidence", a=("nis echo y expected verdict", ctypes.c_void_p), b=("implausible", INT), c=("elapsed distance", REAL)
)
Report = _structure("Report", a=("health sensor entry reason rung", INT), b=("mismatch activity", REAL))


@lru_cache
def library() -> ctypes.CDLL:
    files = [template(name) for name in ("checks.h", "supervisor.h", "supervisor.c")]
    text = "\n".join([_HEAD, *files, _TAIL]).replace('#include "checks.h"', "")
    found = load_library(text, "the supervisor")
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
        )
        self.state = State(calls=DELAY, since=5 * W)
        self.put(**state)

    def put(self, **state) -> None:
        for name, value in state.items():
            setattr(self.state, name, type(getattr(self.state, name))(*value) if isinstance(value, tuple) else value)

    def judge(self, nis=(-1.0, -1.0), echo=(0.0, 0.0), verdict=(0, 0), y=None, expected=(0.0, 0.0), **others) -> Report:
        """A call; without a reading the camera's is an outlier, so that what is known of it stays."""
        readings, report = TWO(*(y or (0.0, 0.0))), Report()
        verdicts = INTS(*verdict) if y is not None or verdict[0] else INTS(Verdict.OUTLIER, verdict[1])
        library().supervisor_screen(*map(ctypes.byref, (self.state, self.settings, readings, report)))
        if math.isnan(readings[0]) and y is not None:
            verdicts[0] = Verdict.FROZEN
        arrays = TWO(*nis), TWO(*echo), readings, TWO(*expected), verdicts
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
        entry = {"mismatch": (0.0, value, 0.0), "echo": (0.0, value)}.get(name, value)
        return Watch(**{**state, name: entry}).when(happens)

    return calls


ACTIVE, DOUBTED = {"activity": 0.01}, {"mismatch": (0.0, 5.0, 0.0)}
RAISED = {"rung": 1, "raises": 1}
# Of a state: what is limited, its limit, calls until something happens below it and above (401: it does not).
LIMITS = {
    "mismatch reported": (seen(health(Health.MISMATCH)), "mismatch", 2.5, 401, 1),
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


@pytest.mark.parametrize("verdict", [Verdict.MISSING, Verdict.ABSURD, Verdict.FROZEN, Verdict.OUTLIER])
def test_a_shape_that_nothing_shows_trips(verdict):
    """Five windows without a reading, 1.5 with one that is frozen; neither drives nor outliers count."""
    expected = {Verdict.FROZEN: W + W // 2, Verdict.OUTLIER: 401}.get(verdict, 5 * W)
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


def moving(watch, caused, moved, calls=1):
    """Calls with a motion that drives cause and that of the reading, both about slow means, in standard deviations."""
    for _ in range(calls):
        watch.put(usual=(-moved * NOISE[0] / (1.0 - 2.0 / W), 0.0))
        report = watch.judge(y=(0.0, 0.0), expected=(caused * NOISE[0], 0.0))
    return report


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


@pytest.mark.parametrize(
    ("off", "expected"), [(0.2, 1.0), (-0.2, 1.0), (0.999 * 0.2 * 30**0.5, 30 * 0.999**2), (2.0, 30.0), (-1.0, 25.0)]
)
def test_the_time_between_calls_is_a_sensor(off, expected):
    watch = Watch()
    report = watch.judge(elapsed=1.0 + off)
    assert watch.state.mismatch[2] == pytest.approx(expected / W)
    assert report.sensor == 2


@pytest.mark.parametrize(("raises", "windows"), [(0, 5), (1, 5), (2, 10), (3, 20), (8, 640), (9, 640), (12, 640)])
def test_calm_takes_twice_as_long_after_each_raise(raises, windows):
    watch = Watch(rung=2, raises=raises)
    assert watch.when(lambda r: r.rung == 1, most=641 * W) == windows * W
    assert watch.state.raises == raises
    assert (watch.state.calm, watch.state.since) == (0, 0)
    assert Watch(raises=raises).when(lambda r: r.rung, most=windows * W) == windows * W + 1


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


def test_the_first_trip_stays():
    watch = Watch(mismatch=(0.0, 30.0, 0.0), contradicted=LONG - 1)
    first = watch.judge()
    assert (first.health, first.reason, first.sensor) == (Health.TRIPPED, Trip.CONTRADICTED, 1)
    watch.put(mismatch=(9.0, 0.0, 0.0), unseen=5 * W - 1)
    last = watch.judge(verdict=(Verdict.MISSING, 0))
    assert (last.reason, last.sensor, watch.state.trips, last.rung) == (Trip.CONTRADICTED, 1, 1, 0)


@pytest.mark.parametrize(
    ("value", "verdict"),
    [
        (0.999 * 2.0, Verdict.USED),
        (2.0, Verdict.USED),
        (1.001 * 2.0, Verdict.ABSURD),
        (-0.999, Verdict.USED),
        (-1.0, Verdict.USED),
        (-1.001, Verdict.ABSURD),
        (math.inf, Verdict.ABSURD),
        (-math.inf, Verdict.ABSURD),
        (math.nan, Verdict.MISSING),
    ],
)
def test_a_number_is_checked_against_its_limits(value, verdict):
    assert library().verdict(value, -1.0, 2.0) == verdict
    if math.isfinite(value):
        outside = ctypes.c_int()
        assert library().limited(value, -1.0, 2.0, ctypes.byref(outside)) == min(max(value, -1.0), 2.0)
        assert bool(outside.value) is (verdict == Verdict.ABSURD)
