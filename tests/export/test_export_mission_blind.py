"""Fingers that are blind, tripped, late or stopped: the table of docs/missions.md, cell by cell, by exported C.

Rows are those that a mission of Python measured, spoilt from a call on.
"""

from __future__ import annotations

import subprocess
from dataclasses import dataclass

import numpy as np
import pytest

from continuum_grasp.export import export_c
from tests.export_cases import STRICT, needs, run, shared_library
from tests.mission_cases import SHORT, carried

pytestmark = [pytest.mark.deep, needs("cc")]

LONG = f"phases={SHORT.replace('hold: 0.3', 'hold: 0.8').replace('squeeze: 0.6', 'squeeze: 0.5')}"
"""Time enough to be blind, and to come to rest so, while the object is held; each solve converges."""
HORIZON = 20
"""Calls of a plan, after which a finger that sees nothing is blind."""
OPENING = 50
"""Calls of `release`."""
OPENED = OPENING + 5
"""Calls in which blind fingers come to the least tensions: their drives are slower than setpoints that fall within the
phase."""


def measured(away=False):
    """Readings of a mission on a mug in its place, or on one out of reach, which is let go after `confirm`."""
    return carried("mug", LONG, shift=(0.03, 0.0) if away else (0.0, 0.0)).runs[0].y


@dataclass(frozen=True)
class Loop:
    """The example program of a package."""

    program: str
    phases: tuple[str, ...]

    def passed(self, lines):
        """Commands (K, nu) and phases for lines that are read."""
        text = "".join(f"{line}\n" for line in lines)
        out = subprocess.run([self.program], input=text, capture_output=True, text=True, check=True).stdout
        rows = [[float(entry) for entry in line.split(",")] for line in out.splitlines()]
        return np.array(rows)[:, :-2], [self.phases[int(row[-1])] for row in rows]


@pytest.fixture(scope="module", params=["double", "float"])
def mug(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param)
    export_c(carried("mug", LONG), folder, real=request.param)
    sources = [*(folder / "src").glob("*.c"), folder / "examples/mission_loop.c"]
    run("cc", *STRICT, "-O1", f"-I{folder / 'include'}", *sources, "-o", folder / "loop")
    return Loop(str(folder / "loop"), tuple(phase.name for phase in carried("mug", LONG).timetable.phases()))


@pytest.fixture(scope="module")
def well(mug):
    """Commands and phases of missions that nothing spoils, on a mug in its place and on one out of reach."""
    return {away: mug.passed(lines(away)) for away in (False, True)}


def line(readings):
    return ",".join(f"{value:.17g}" for value in readings)


def changed(y, value, *entries):
    """Readings of which some, or all, are something else."""
    y = y.copy()
    y[list(entries) or slice(None)] = value
    return y


CAMERA, TENSIONS, ANGLES = (0, 1), (2, 3), tuple(range(4, 11))
SPOILT = {
    "missing": lambda y, at, k: changed(y[k], np.nan),
    "infinite": lambda y, at, k: changed(y[k], np.inf),
    "absurd": lambda y, at, k: changed(y[k], 1e12),
    "tensions alone": lambda y, at, k: changed(y[k], np.nan, *CAMERA, *ANGLES),
    "stuck": lambda y, at, k: y[at],
    "one stuck": lambda y, at, k: changed(y[k], y[at, 6], 6),
    # The camera shows another finger, until the supervisor trips.
    "contradicted": lambda y, at, k: y[k] + changed(np.zeros(len(y[k])), 0.05, *CAMERA),
}
"""Readings of a call ``k`` that are spoilt since the call ``at``."""


def lines(away=False, at=10**9, what="", asked=""):
    """Lines for the program, in which readings are spoilt, and something is asked for in each call or, 5 calls later,
    once.
    """
    y, written = measured(away), []
    for k in range(len(y)):
        if (k >= at and asked == "late") or (k == at + 5 and asked in ("abort", "release")):
            written.append(asked)
        written.append(line(SPOILT[what](y, at, k) if what and k >= at else y[k]))
    return written


def opens(u, begin):
    """Whether commands go to the least tensions from a call on, and stay there."""
    closing = np.diff(u[begin:], axis=0).max(initial=0.0)
    return closing < 1e-4 and np.abs(u[begin + OPENED :] - 1.0).max(initial=0.0) < 1e-4


SEES_NOTHING = ("missing", "infinite", "absurd")
LETS_GO = {
    **dict.fromkeys((*SEES_NOTHING, "tensions alone"), range(HORIZON + 1, HORIZON + 2)),
    # 20 calls and the delay of readings, from the first motion of the command on.
    **dict.fromkeys(("stuck", "one stuck"), range(HORIZON + 4, HORIZON + 12)),
    # Half a second until a trip.
    "contradicted": range(1, 80),
    "late": range(HORIZON, HORIZON + 1),
    **dict.fromkeys(("abort", "release"), range(5, 6)),
}
"""Calls until a finger lets go before the lift."""
GOES_ON = 6.0
"""Tension [N] that a finger may pull more while it is shown readings of one that goes on closing."""


def faulty(what):
    return {"what": what} if what in SPOILT else {"asked": what}


@pytest.mark.parametrize("phase", ["approach", "squeeze", "confirm"])
@pytest.mark.parametrize("what", LETS_GO)
def test_before_the_lift_a_finger_lets_go(phase, what, mug, well):
    away = phase == "confirm"
    usual, names = well[away]
    at = names.index(phase) + 10
    u, phases = mug.passed(lines(away, at, **faulty(what)))
    begin = phases.index("release")
    assert begin - at in LETS_GO[what]
    assert phases[begin:] == (["release"] * OPENING + ["end"] * len(u))[: len(u) - begin]
    assert "lift" not in phases
    assert u[at:, 0].max() < usual[: begin + 1, 0].max() + GOES_ON
    if what in SEES_NOTHING:
        assert u[at:, 0].max() < 1.02 * usual[: begin + 1, 0].max() + 1.0
        assert opens(u, begin)


@pytest.mark.parametrize("phase", ["approach", "squeeze", "confirm"])
@pytest.mark.parametrize("asked", ["abort", "release"])
def test_before_the_lift_a_blind_finger_lets_go_when_asked(phase, asked, mug, well):
    away = phase == "confirm"
    at = well[away][1].index(phase) + 10
    u, phases = mug.passed(lines(away, at, "missing", asked))
    assert phases.index("release") == at + 5
    assert opens(u, at + HORIZON + 1)


@pytest.mark.parametrize("phase", ["lift", "hold", "pull 1", "rest"])
@pytest.mark.parametrize("what", [what for what in LETS_GO if what not in ("abort", "release")])
def test_after_the_lift_a_finger_holds_until_its_time(phase, what, mug, well):
    usual, names = well[False]
    at, begin = names.index(phase) + 5, names.index("release")
    (of,) = carried("mug", LONG).assignments
    u, phases = mug.passed(lines(False, at, **faulty(what)))
    assert phases == names
    assert u[at:begin, 0].min() > of.holding[0][0] - 1e-3
    assert u[at:begin, 0].max() < usual[:, 0].max() + 1.0
    # From 60 N at 118 N/s it takes 15 calls.
    if what in (*SEES_NOTHING, "late"):
        assert u[at + HORIZON + 17 : begin, 0] == pytest.approx(of.held[0], abs=1e-3)
        assert opens(u, begin)


@pytest.mark.parametrize("phase", ["lift", "hold", "pull 1", "rest", "lower"])
@pytest.mark.parametrize("asked", ["abort", "release"])
@pytest.mark.parametrize("what", ["", "missing"])
def test_after_the_lift_a_finger_lets_go_when_asked(phase, asked, what, mug, well):
    names = well[False][1]
    at = names.index(phase) + 2
    u, phases = mug.passed(lines(False, at, what, asked))
    asked_at, planned = at + 5, names.index("release")
    begin = asked_at if asked == "abort" else planned if phase == "lower" else asked_at + names.count("lower")
    assert phases[asked_at] == ("release" if asked == "abort" else "lower")
    assert phases[begin:] == (["release"] * OPENING + ["end"] * len(u))[: len(u) - begin]
    if what:
        assert opens(u, max(begin, at + HORIZON + 1))


@pytest.mark.parametrize("phase", ["lower", "release", "end"])
@pytest.mark.parametrize("what", ["missing", "late"])
def test_at_the_end_a_finger_opens_all_the_same(phase, what, mug, well):
    names = well[False][1]
    at = names.index(phase) + 2
    u, phases = mug.passed(lines(False, at, **faulty(what)))
    assert phases == names
    assert opens(u, max(names.index("release"), at + HORIZON + 1))


def went_on(phases, names):
    """Whether phases are the usual ones, with a wait before the lift of half of the squeeze at most."""
    passed = [phase for phase in dict.fromkeys(phases) if phase not in ("confirm", "end")]
    usual = [phase for phase in dict.fromkeys(names) if phase not in ("confirm", "end")]
    return passed == usual and phases.index("lift") - names.index("lift") <= 30


@pytest.mark.parametrize("at", [10, 70, 99, 105, 130])
def test_a_single_late_command_changes_nothing(at, mug, well):
    written = lines()
    written[at] = f"late\n{written[at]}"
    assert went_on(mug.passed(written)[1], well[False][1])


@pytest.mark.parametrize("lost", [15, 30])
@pytest.mark.parametrize("phase", ["approach", "squeeze"])
def test_sensors_return_before_the_lift(lost, phase, mug, well):
    """Within a plan nothing changes; after it the finger stays open, and begins anew when it is started."""
    usual, names = well[False]
    at, written = names.index(phase) + 5, lines()
    written[at : at + lost] = [line(changed(y, np.nan)) for y in measured()[at : at + lost]]
    u, phases = mug.passed([*written, "start", *lines()])
    again = len(names)
    assert phases[again:] == names
    assert u[again:] == pytest.approx(usual, abs=1e-6)
    if lost == 15:
        assert went_on(phases[:again], names)
    else:
        begin = phases.index("release")
        assert begin == at + HORIZON + 1
        assert "lift" not in phases[:again]
        assert u[begin:again, 0].max() < usual[:begin, 0].max() + GOES_ON


@pytest.mark.parametrize("name", ["mug_servo", "turn_block", "cup_lying", "mug_hard"])
def test_blind_fingers_of_other_missions_let_go_before_the_lift_and_hold_after_it(name, tmp_path):
    """Also those that command positions, turn the object first, or lift in the plane."""
    mission = carried(name)
    export_c(mission, tmp_path / "package")
    finger, library = shared_library(tmp_path / "package", tmp_path)
    (of,), (done,) = mission.assignments, mission.runs
    names, rows = [phase.name for phase in mission.timetable.phases()], [*done.y, *[done.y[-1]] * OPENED]

    def passed(blind_at):
        """Commands and phases of a mission that is blind from a call on."""
        one, u, phases = finger.Mission(library), [], []
        for k, y in enumerate(rows):
            command = one.step(finger.Measurement(*(changed(y, np.nan) if k >= blind_at else y)))
            u.append([getattr(command, field) for field, _ in command._fields_])
            phases.append(one.phase())
        return np.array(u), phases, one.forces()

    usual = passed(len(rows))[1]
    for phase in dict.fromkeys(usual):
        at = usual.index(phase) + 2
        u, phases, forces = passed(at)
        if phase <= names.index("confirm"):
            assert phases.index(names.index("release")) == at + of.control.controller.horizon.stages + 1
            assert forces == 4
        else:
            assert phases == usual
        lifted = [k for k, each in enumerate(phases) if names.index("lift") <= each < names.index("lower")]
        rest = lifted[-1] if lifted else 0
        assert not lifted or name == "mug_servo" or np.all(u[rest] > of.holding[0] - 1e-3)
        assert u[-1] == pytest.approx(of.control.rest_input, abs=1e-3)


def phases_of(done):
    """Phase in which each command of a run was given."""
    starts, names = zip(*done.events, strict=True)
    return [names[k - 1] for k in np.searchsorted(starts, done.t[:-1] + 1e-9)]


@pytest.mark.parametrize("name", ["pinch", "pinch_palm"])
@pytest.mark.parametrize("blind", [0, 1])
def test_where_one_of_two_fingers_is_blind_both_let_go_before_the_lift(name, blind, tmp_path):
    """After it the blind one holds what it held, and the other goes on."""
    mission, libraries = carried(name), []
    for of in mission.assignments:
        export_c(mission, tmp_path / of.name, finger=of.name)
        libraries.append(shared_library(tmp_path / of.name, tmp_path / of.name))
    names = [phase.name for phase in mission.timetable.phases()]
    usual = phases_of(mission.runs[0])
    for phase in ("approach", "squeeze", "lift", "hold", "lower"):
        fingers, at = [finger.Mission(library) for finger, library in libraries], usual.index(phase) + 2
        opened, u = {}, []
        for k, measured_now in enumerate(zip(*(done.y for done in mission.runs), strict=True)):
            first = fingers[0]
            if word := fingers[1].forces():
                (first.others_bear, first.others_lack, first.others_doubt, first.others_blind)[word - 1]()
            for j, (one, y) in enumerate(zip(fingers, measured_now, strict=True)):
                if j and fingers[0].decision():
                    (one.lift if fingers[0].decision() == 1 else one.let_go)()
                lost = j == blind and k >= at
                found = one.step(libraries[j][0].Measurement(*(changed(y, np.nan) if lost else y)))
                u += [found.tension_1] if lost else []
                if names[one.phase()] == "release":
                    opened.setdefault(j, k)
        if phase in ("approach", "squeeze"):
            assert opened[blind] == at + HORIZON + 1
            assert opened[1 - blind] <= at + HORIZON + 3
            assert [one.decision() for one in fingers] == [2, 2]
        else:
            assert set(opened.values()) == {usual.index("release")}
            held = u[: max(usual.index("lower") - at, 0)]
            assert min(held, default=np.inf) > mission.assignments[blind].holding[0][0] - 1e-3
        assert u[-1] == pytest.approx(mission.assignments[blind].control.rest_input[0], abs=1e-3)
