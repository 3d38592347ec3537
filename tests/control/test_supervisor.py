"""The supervisor: what it reports of loops with a wrong plant or a broken sensor, and that it is silent otherwise.

Each loop is that of ``configs/mpc/steady_tip.yaml``.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import groupby

import numpy as np
import pytest

from continuum_grasp.base import InputError
from continuum_grasp.closed_loop import Plant, SimulatedBench, run_closed_loop
from continuum_grasp.control import Anomaly, Controller, Health, MeasurementVerdict, OffsetCause, Sight, Trip
from continuum_grasp.core import Compiler
from continuum_grasp.scene import ControlScene, load
from tests.control_cases import ARCS_ESTIMATOR, ARCS_LOOP
from tests.marks import few

pytestmark = pytest.mark.skipif(Compiler.find() is None, reason="no C compiler here")

SCENE = "configs/mpc/steady_tip.yaml"
OFF = np.array([0.1, 0.0, 0.0, 0.0])
START = 1.0
"""Time at which faults begin [s]."""


@lru_cache
def controller(*changes: str) -> Controller:
    return Controller(load(SCENE, changes), deadline=math.inf)


class Faulty(Plant):
    """The plant with a fault of its sensors or its wiring from ``START`` on."""

    def __init__(self, scene, sensors=None, commands=None, start=START) -> None:
        super().__init__(scene)
        self._sensors, self._commands, self._start = sensors, commands, start
        self.last = None
        self.rng = np.random.default_rng(9)

    @property
    def broken(self) -> bool:
        return self.t > self._start - 1e-9

    def measure(self):
        y = super().measure()
        if self._sensors is not None and self.broken:
            y = self._sensors(self, y)
        else:
            self.last = y
        return y

    def advance(self, u):
        return super().advance(self._commands(u) if self._commands is not None and self.broken else u)


def run(*changes: str, duration=3.0, **faults):
    scene = load(SCENE, (f"duration={duration}", *changes))
    control = controller(*[c for c in changes if not c.startswith("plant.")])
    return run_closed_loop(scene, controller=control, plant=Faulty(scene, **faults) if faults else None)


def error(found) -> float:
    """R.m.s. distance of the tip from its setpoint over the last second [m]."""
    away = np.linalg.norm(found.tip - found.r[:, :2], axis=1)
    return float(np.sqrt(np.mean(away[found.t > found.t[-1] - 1.0] ** 2)))


def first(found, *healths: str) -> float:
    """When one of these was reported first [s]."""
    at = [t for t, health in zip(found.t, found.health, strict=False) if health in healths]
    return at[0] if at else math.inf


@pytest.mark.deep
@pytest.mark.parametrize(
    "change",
    few(
        [
            *[f"plant.{wrong}" for wrong in ("time_constant=0.08", "delay=0.03", "stiffness=0.5")],
            *[f"plant.{wrong}" for wrong in ("delay=0", "delay=0.02", "stiffness=2.0")],
        ],
        1,
    ),
)
def test_wrong_plants_are_held(change):
    found = run(change)
    assert error(found) < 4e-3
    assert not found.tripped


@pytest.mark.deep
@pytest.mark.parametrize(("slower", "reported"), [(1.0, False), (3.0, True), (4.0, True)])
def test_a_slow_drive_is_reported_where_the_tip_falls_behind_although_nothing_swings(slower, reported):
    """12 cm to and fro at 1 Hz: the tip follows by the rise of the ramp that lag adds, which no single call shows."""
    path = "configs/mpc/tip_arc.yaml"
    found = run_closed_loop(load(path, [f"plant.time_constant={slower * 0.02}"]))
    assert found.mismatch.max() < 3.0
    # A critically damped lag of time T follows a ramp by 2 T; r.m.s. of the setpoint's speed times that, and friction.
    behind = 2.0 * (slower - 1.0) * 0.02 * np.linalg.norm(np.gradient(found.r[:, :2], found.t, axis=0), axis=1)
    assert error(found) == pytest.approx(np.sqrt(np.mean(behind[found.t > 2.0] ** 2)), abs=4e-3)
    later = [health for t, health in zip(found.t, found.health, strict=False) if t > 1.0]
    assert set(later) == ({"mismatch"} if reported else {"ok"})
    assert all("tension" in text for text in found.health_texts[-50:]) is reported
    assert all("longer delay or lag" in text for text in found.health_texts[-50:]) is reported


@pytest.mark.deep
@pytest.mark.parametrize(
    ("known", "true", "word"),
    [(0.06, 0.02, "shorter"), (0.04, 0.01, "shorter"), (0.02, 0.08, "longer"), (0.03, 0.03, "")],
)
def test_the_report_says_whether_the_lag_is_longer_or_shorter(known, true, word):
    """The tip is led to and fro; the drive's measured tensions run ahead of the model's, or fall behind."""
    tips = [[-0.03, 0.175], [0.03, 0.175]] * 5
    path = {"times": [0.4 * k for k in range(10)], "values": tips}
    given = {
        **ARCS_LOOP,
        "estimator": {**ARCS_ESTIMATOR, "delay": 0.0},
        "reference": {"tip": path},
        "plant": {"fidelity": ARCS_LOOP["fidelity"], "time_constant": true},
        "duration": 3.0,
    }
    scene = ControlScene(**given)
    found = run_closed_loop(scene.replaced(finger=scene.finger.with_tendons(time_constant=known)))
    texts = [text for t, text in zip(found.t, found.health_texts, strict=False) if text and t > 1.0]
    assert bool(texts) is bool(word)
    other = {"shorter": "longer", "longer": "shorter"}.get(word)
    assert not any(f"{other} delay or lag" in text for text in texts)
    assert sum(f"{word} delay or lag" in text for text in texts) >= 0.8 * len(texts)


def swapped(*pairs):
    order = np.arange(4)
    for i, j in pairs:
        order[[i, j]] = j, i
    return lambda plant, y: y[order]


def stuck(*entries):
    return lambda plant, y: np.where(np.isin(np.arange(4), entries), plant.last, y)


def scaled(plant, y):
    return y * [1.05, 1.05, 1.0, 1.0]


def held(share, *axes):
    """A camera of which some axes show an old image, with noise in shares of what is declared."""
    axes = list(axes or (0, 1))

    def sensors(plant, y):
        seen = y.copy()
        seen[axes] = plant.last[axes] + 0.3e-3 * share * plant.rng.normal(size=len(axes))
        return seen

    return sensors


def camera(factor):
    return lambda plant, y: y * [factor, factor, 1.0, 1.0]


# Reported within and tripped within, after the fault [s].
FAULTS = {
    "tip axes swapped": ({"sensors": swapped((0, 1))}, 0.1, 1.5),
    "tensions swapped": ({"sensors": swapped((2, 3))}, 0.1, 2.0),
    "commands swapped": ({"commands": lambda u: u[::-1]}, 0.16, 2.6),
    "tip stuck": ({"sensors": stuck(0, 1)}, 0.3, 0.7),
    "tip_x stuck": ({"sensors": stuck(0)}, 0.3, 0.7),
    "a tension stuck": ({"sensors": stuck(2)}, 0.3, math.inf),
    "camera's scale 5 % wrong": ({"sensors": scaled}, 0.12, 1.8),
    "old image with noise": ({"sensors": held(1.0)}, 1.0, 1.0),
    # What a camera is off is estimated as shipped, and takes up a part of what an old image shows.
    "old image with noise, tip_offset": ({"sensors": held(1.0)}, 1.6, 1.6),
    "old image with twice the noise": ({"sensors": held(2.0)}, 1.0, 1.0),
    "no camera": ({"sensors": camera(math.nan)}, 1.01, 1.01),
    "camera in mm": ({"sensors": camera(1e3)}, 1.01, 1.01),
}
NO_OFFSET = "estimator.disturbances={tip_moment: 0.01}"
# The cause that the trip names, of those that leave no doubt.
UNSEEN = "is missing, beyond its limits or does not move, and nothing else shows the shape"
UNANSWERED = "does not respond to the drives"
REASONS = {
    "tip stuck": UNSEEN,
    "old image with noise": UNANSWERED,
    "no camera": UNSEEN,
    "camera in mm": UNSEEN,
}


@pytest.mark.deep
@pytest.mark.parametrize("fault", few(FAULTS, 3))
def test_faults_are_reported_and_end_in_the_safe_state(fault):
    faults, reported, tripped = FAULTS[fault]
    alone = () if "tip_offset" in fault else (NO_OFFSET,)
    found = run(*alone, duration=START + min(max(tripped, 1.0), 3.5) + 0.5, **faults)
    assert set(found.health[: round(START / found.period)]) == {"ok"}
    assert first(found, "mismatch", "detuned", "frozen", "tripped") - START < reported
    if math.isinf(tripped):
        assert not found.tripped
        assert error(found) < 4e-3
        return
    assert first(found, "tripped") - START < tripped
    assert found.ended == "tripped"
    if fault in REASONS:
        assert REASONS[fault] in found.health_texts[-1]
        assert found.health_texts[-1].startswith(("tip ", "tip_x "))
    after = found.t[:-1] >= first(found, "tripped")
    assert set(np.array(found.status)[after]) == {"safe_ramp"}
    # At the rate of the ramp, 59 N in half a second, down to the least tensions.
    change = np.diff(found.u[after], axis=0)
    assert np.abs(change).max() <= 59.0 / (6.5 * found.scene.finger.rod.natural_time) * found.period * (1 + 1e-9)
    assert np.all(change <= 1e-12)
    assert found.u[-1] == pytest.approx([1.0, 1.0]) or found.t[-1] < first(found, "tripped") + 0.5


LATE = ("estimator.delay=0.02", "fidelity.elements=4")


@pytest.mark.deep
@pytest.mark.parametrize(
    ("changes", "seed", "share", "axes", "within"),
    [
        ((NO_OFFSET,), 1, 1.0, (), 1.3),  # drifts by 14 mm until then
        ((), 1, 1.0, (), 2.4),
        ((), 0, 1.0, (0,), 1.0),  # the other axis moves
        ((), 0, 1.0, (1,), 2.6),
        (LATE, 2, 1.0, (), 3.0),
    ],
)
def test_an_old_image_near_the_setpoint_trips(changes, seed, share, axes, within):
    """The tip rests within 1 mm of its setpoint, and drifts off slowly: without a trip by 16 to 56 mm within 3 s.

    The less the command moves, which is all that an image could answer, the later: noise of tension sensors is none.
    """
    found = run(*changes, f"plant.seed={seed}", duration=3.0 + within, sensors=held(share, *axes), start=2.0)
    assert set(found.health[:200]) == {"ok"}
    assert first(found, "tripped") < 2.0 + within
    assert UNANSWERED in found.health_texts[-1]
    assert np.linalg.norm(found.tip[found.t < first(found, "tripped")][-1] - found.tip[199]) < 0.02


WINCHES = "configs/mpc/winches.yaml"


@pytest.mark.parametrize(
    ("scene", "delay"),
    few([("configs/mpc/unknown_drive.yaml", 0.04), (SCENE, 0.04), (SCENE, 0.06)], 1),
)
def test_a_delay_that_is_longer_than_stated_detunes_and_ends_the_swing(scene, delay):
    """Three and five periods; the supervisor raises the weight once a second."""
    asked = load(scene, (f"plant.delay={delay}", "duration=4.0" if delay > 0.04 else "duration=3.0"))
    found = run_closed_loop(asked, controller=Controller(asked, deadline=math.inf))
    assert first(found, "detuned") < 0.7
    assert error(found) < 4e-3
    assert not found.tripped


def test_nothing_at_all_is_no_measurement_without_an_estimator_either():
    control = Controller(load(SCENE, ("estimator=null", "controller.horizon.stages=10")), deadline=math.inf)
    commands = [control.step(None) for _ in range(101)]
    assert [command.health for command in commands[98:]] == [Health.OK, Health.TRIPPED, Health.TRIPPED]
    assert commands[-1].trip == Trip.UNSEEN
    assert commands[-1].suspect is None


def outliers(share):
    def sensors(plant, y):
        hit = plant.rng.random(4) < share
        return y + hit * plant.rng.choice([-1.0, 1.0], 4) * [0.05, 0.05, 10.0, 10.0]

    return sensors


def glitches(plant, y):
    """Both axes of the camera see something else for a frame."""
    return y + (plant.rng.random() < 0.02) * np.array([0.03, -0.05, 0.0, 0.0])


def gone(plant, y):
    """No sensor at all for fifty periods."""
    return y * np.nan if plant.t < START + 0.5 - 1e-9 else y


@pytest.mark.deep
@pytest.mark.parametrize(
    ("sensors", "said"), few([(outliers(0.01), "outlier rejected"), (glitches, "outlier rejected"), (gone, "")], 1)
)
def test_what_ends_by_itself_costs_nothing(sensors, said):
    found = run(sensors=sensors)
    assert error(found) < 1.3e-3
    assert set(found.health) == {"ok"}
    assert any(said in word for words in found.anomalies for word in words)


QUIET = [
    ("a long nominal run", SCENE, ("plant.stiffness=0.9", "plant.seed=5", "duration=20.0")),
    ("a finger that rests without noise", SCENE, ("plant.noise=0", "duration=6.0")),
    # Under eight times gravity, what drives cause grows of itself where no sensor corrects it.
    ("a finger that topples alone", SCENE, ("gravity=[0.0, -80.0]", "duration=3.0")),
    # It answers none of what winches move to hold it, five seconds long.
    ("a tip that friction holds", WINCHES, ("plant.seed=106", "plant.fidelity.elements=4", "duration=8.0")),
]


@pytest.mark.deep
@pytest.mark.parametrize(("scene", "changes"), [row[1:] for row in QUIET], ids=[row[0] for row in QUIET])
def test_nothing_is_reported_of_loops_without_fault(scene, changes):
    asked = load(scene, changes)
    found = run_closed_loop(asked, controller=Controller(asked, deadline=math.inf))
    assert set(found.health) == {"ok"}
    assert scene != SCENE or found.mismatch.max() < 2.5


@pytest.mark.deep
def test_a_tip_answers_nothing_while_the_command_rests_at_its_limit():
    """Tension sensors are noisy, and the drives stand still: a setpoint out of reach stands for ten seconds."""
    changes = ["reference.tip=[-0.1254, 0.0897]", "plant.fidelity.elements=3", "duration=10.0"]
    asked = load("configs/mpc/saturation.yaml", changes)
    found = run_closed_loop(asked, controller=Controller(asked, deadline=math.inf))
    assert np.ptp(found.u[200:], axis=0).max() == 0.0
    assert set(found.health) == {"ok", "offset"}
    assert "an input at its limit" in found.health_texts[-1]


@pytest.mark.deep
def test_a_trip_stays_until_it_is_left_and_is_part_of_the_saved_state():
    control = controller()
    scene = control.scene
    plant = Faulty(scene, sensors=swapped((0, 1)), start=0.5)
    control.reset()
    saved = b""
    for _ in range(300):
        command = control.step(plant.measure())
        plant.advance(command.u)
        if command.health == Health.TRIPPED and not saved:
            assert not control.rearm()  # it does not rest yet
            saved = control.save_state()
    assert command.health == Health.TRIPPED
    assert command.suspect == "tip"
    assert command.trip in (Trip.CONTRADICTED, Trip.AWAY, Trip.SWINGING)
    assert "axes" in command.health_text
    control.reset()
    control.restore(saved)
    assert control.step(None).health == Health.TRIPPED

    # The cable is put right; once the estimator agrees again, and not before, the trip can be left.
    plant._sensors = None
    waited = 0
    while not control.rearm():
        command = control.step(plant.measure())
        plant.advance(command.u)
        waited += 1
        assert waited < 400
    assert command.mismatch < 1.5
    assert waited > 20
    command = control.step(plant.measure())
    assert (command.health, command.rung) == (Health.DETUNED, 3)
    for _ in range(200):
        plant.advance(command.u)
        command = control.step(plant.measure())
    assert not command.fallback
    assert np.linalg.norm(plant.measure()[:2] - [-0.0827, 0.1515]) < 4e-3


@pytest.mark.deep
def test_half_the_call_rate_is_noticed_by_the_clock():
    control = controller()
    plant = Faulty(control.scene)
    control.reset()
    seen = []
    for k in range(100):
        command = control.step(plant.measure(), time=100.0 + 2 * k * control.period)
        plant.advance(command.u)
        plant.advance(command.u)
        seen.append(command)
    reported = next(k for k, c in enumerate(seen) if c.health)
    assert 2 * reported * control.period < 0.3
    assert any(c.suspect == "call rate" for c in seen[: reported + 10])
    assert 2 * control.period * next(k for k, c in enumerate(seen) if c.health == Health.TRIPPED) < 2.0


@pytest.mark.parametrize("time", [math.nan, math.inf, -math.inf, 10**400, -5.0])
def test_a_clock_that_means_nothing_is_no_matter(time):
    control = controller()
    control.reset()
    for _ in range(30):
        command = control.step(None, time=time)
    assert command.health == Health.OK
    for wrong in ("noon", [0.0, 1.0], 1j):
        with pytest.raises(InputError, match="time"):
            control.step(None, time=wrong)


def test_verdicts_are_those_of_the_device():
    control = controller()
    control.reset()
    plant = Faulty(control.scene)
    for _ in range(100):
        y = plant.measure()
        plant.advance(control.step(y).u)
    state, y = control.save_state(), plant.measure()
    control.step(y + OFF)
    command = control.step(y + OFF)
    assert command.anomaly == Anomaly.OUTLIER
    assert command.anomalies == ("tip_x: outlier rejected",)
    assert command._part("verdict").tolist() == [
        MeasurementVerdict.OUTLIER,
        MeasurementVerdict.ALONE,
        MeasurementVerdict.USED,
        MeasurementVerdict.USED,
    ]
    # Both of its axes are rejected: the other's value is of no matter.
    control.restore(state)
    one = control.step(y + OFF).estimate.x
    control.restore(state)
    assert np.array_equal(one, control.step(y + OFF + np.array([0.0, 5e-4, 0.0, 0.0])).estimate.x)


_TIP, _TENSIONS, _ALL = slice(0, 2), slice(2, 4), slice(None)


def at_rest(control, count):
    """Readings of the straight finger, and commands that leave it as it is."""
    rng = np.random.default_rng(0)
    control.reset()
    for k in range(count):
        yield k, np.array([0.0, 0.18, 1.0, 1.0]) + rng.normal(size=4) * [5e-4, 5e-4, 0.05, 0.05]


def sight(control, readings, **given):
    return control.step(readings, reference={"tip": [0.0, 0.18]}, **given).sight


@pytest.mark.parametrize(
    ("entries", "value", "calls", "expected"),
    [
        (_ALL, math.nan, 20, "P20 S"),
        (_ALL, math.nan, 40, "P30 B10 S"),
        (_ALL, math.inf, 40, "P30 B10 S"),
        (_TIP, math.nan, 40, "P30 B10 S"),
        (slice(1, 2), math.nan, 40, "P30 B10 S"),
        (_TENSIONS, math.nan, 40, "S"),
        # Tripped after a second, until it is rearmed.
        (_ALL, math.nan, 120, "P30 B"),
    ],
)
def test_an_estimate_is_blind_when_nothing_shows_the_shape_for_as_long_as_a_plan_lasts(entries, value, calls, expected):
    control, seen = controller(), []
    for k, y in at_rest(control, 150):
        y[entries] = value if 20 <= k < 20 + calls else y[entries]
        seen.append(sight(control, y))
    runs = [(name, len([*group])) for name, group in groupby(each.name[0] for each in seen[20:])]
    assert " ".join([*(f"{name}{count}" for name, count in runs[:-1]), runs[-1][0]]) == expected
    assert control.rearm() == (calls > 100)
    assert sight(control, np.array([0.0, 0.18, 1.0, 1.0])) is Sight.SEES


@pytest.mark.parametrize("first", [0, 10])
def test_an_estimate_of_no_use_to_a_plan_is_blind_too(first):
    """As where commands are late all the time: from the end of the last plan on, or of one that never was."""
    control = controller()
    seen = [sight(control, y, late=first <= k < first + 35) for k, y in at_rest(control, first + 45)]
    assert [each is Sight.BLIND for each in seen] == [False] * (first + 29) + [True] * 6 + [False] * 10


def test_a_reading_that_is_frozen_makes_blind_at_once():
    control, commands = controller(), []
    for _, y in at_rest(control, 60):
        y[2] = 1.0
        commands.append(control.step(y, reference={"tip": [0.02, 0.17]}))
    blind = [command.sight is Sight.BLIND for command in commands]
    assert blind == [command.health is Health.FROZEN for command in commands]
    assert blind[-1]


OFFSETS = {
    "a camera whose scale is 1 % off, for which no unknown stands": (
        (-0.0827, 0.1515),
        1.01,
        OffsetCause.UNEXPECTED,
        "camera (scale, shift, turn)",
    ),
    "a camera whose scale is 3 % off": ((-0.0827, 0.1515), 1.03, OffsetCause.UNREACHED, "one curve"),
    "a setpoint beside the curve": ((-0.0727, 0.1415), 1.0, OffsetCause.UNREACHED, "one curve"),
    "tensions at their limit": ((-0.1254, 0.0897), 1.0, OffsetCause.LIMITED, "at its limit"),
    "all is well": ((-0.0827, 0.1515), 1.0, OffsetCause.NONE, ""),
}


@pytest.mark.deep
@pytest.mark.parametrize("case", OFFSETS)
def test_a_tip_that_stays_off_is_reported_with_its_distance_and_cause(case):
    """The distance is that of the measured tip from its setpoint, by its mean over the last second."""
    setpoint, scale, cause, words = OFFSETS[case]
    changes = ["finger.tendons.max_tension=14"] if "limit" in case else []
    if "no unknown" in case:
        changes.append("estimator.disturbances={tip_moment: 0.01}")
    scene = load(SCENE, [f"reference.tip={list(setpoint)}", *changes])
    control, bench = Controller(scene, deadline=math.inf), SimulatedBench(scene)
    measured = []
    for _ in range(350):
        y = np.array(bench.read()) * [scale, scale, 1.0, 1.0]
        command = control.step(y)
        bench.write(command)
        bench.idle()
        measured.append(y[:2])
    off = np.linalg.norm(np.mean(measured[-100:], axis=0) - setpoint)
    assert (command.health, command.offset_cause) == (Health.OFFSET if cause else Health.OK, cause)
    assert words in command.health_text
    assert command.offset == (pytest.approx(off, rel=0.05) if cause else 0.0)
    assert (f"stays {1e3 * command.offset:.3g} mm" in command.health_text) is bool(cause)
    assert bool(cause) or off < 1e-3
