"""Missions in Python on plants whose sensors fail: nothing is squeezed or lifted blind, nothing held is dropped."""

from __future__ import annotations

import numpy as np
import pytest

from continuum_grasp.control import Controller
from tests.mission_cases import carried, fails, runner

pytestmark = pytest.mark.deep


def tension(run, since=0.0, until=np.inf):
    """Commanded tensions of the tendon that closes [N] between two instants [s]."""
    return run.u[(run.t[:-1] >= since) & (run.t[:-1] < until), 0]


@pytest.mark.parametrize(
    ("spoilt", "why"),
    [
        (lambda y, last: np.full_like(y, np.nan), "nothing was measured"),
        (lambda y, last: last, "a reading is frozen"),
        (lambda y, last: np.where(np.isin(np.arange(y.size), (2, 3)), y, np.nan), "no sensor shows the shape"),
    ],
)
@pytest.mark.parametrize("since", [0.2, 0.6])
def test_a_finger_that_is_blind_before_the_lift_lets_go(since, spoilt, why, monkeypatch):
    well = carried("mug").runs[0]
    fails(monkeypatch, since, spoilt=spoilt)
    mission = runner("mug").run()
    run, verdict = mission.runs[0], mission.verdict
    assert verdict.status in ("not_lifted", "tripped")
    assert why in verdict.refused.text
    assert verdict.released
    assert verdict.drop is None
    assert since + 0.2 < verdict.refused.time < since + 0.4
    assert tension(run).max() < tension(well, until=verdict.refused.time).max() + 2.0
    left = tension(run, verdict.refused.time + 0.5)
    if why == "no sensor shows the shape":
        # The tensions that are read still close the loop, with their noise.
        assert left.max() < 2.5
    else:
        assert left == pytest.approx(1.0)
    assert [name for _, name in run.events][-2:] == ["release", "end"]
    assert "lift" not in dict(map(reversed, run.events))


def test_a_finger_that_is_blind_for_a_while_after_the_lift_goes_on(monkeypatch):
    hold = carried("mug").timetable.span("hold")
    fails(monkeypatch, hold.start, hold.start + 0.25)
    mission = runner("mug").run()
    least = mission.assignments[0].holding[0][0]
    assert mission.verdict.status == "finished"
    assert tension(mission.runs[0], hold.start, hold.start + 0.27).min() > least - 1e-6
    pull = mission.timetable.span("pull 2")
    assert tension(mission.runs[0], pull.start, pull.end).max() > least + 2.0


@pytest.mark.parametrize("rearms", [False, True])
def test_a_finger_that_tripped_while_it_held_follows_its_force_when_it_is_rearmed(rearms, monkeypatch):
    """Without it holds as in the grasp, and lets go in time."""
    hold, step = carried("mug").timetable.span("hold"), Controller.step
    fails(monkeypatch, hold.start, hold.start + 1.1)

    def stepped(control, *given, **named):
        command = step(control, *given, **named)
        if rearms and command.trip:
            control.rearm()
        return command

    monkeypatch.setattr(Controller, "step", stepped)
    mission = runner("mug").run()
    run, grasp, lower = mission.runs[0], mission.assignments[0].held[0], mission.timetable.span("lower")
    assert mission.verdict.status == "tripped"
    assert mission.verdict.held
    assert mission.verdict.released
    assert (tension(run, hold.start + 1.3, lower.start).max() > grasp + 2.0) == rearms


@pytest.mark.parametrize("finger", ["lower", "upper"])
def test_two_fingers_of_which_one_is_blind(finger, monkeypatch):
    """Before the lift both let go; after it the blind one holds what the other presses on."""
    squeeze, hold = (carried("pinch").timetable.span(name) for name in ("squeeze", "hold"))
    with monkeypatch.context() as patch:
        fails(patch, squeeze.start + 0.1, finger=finger)
        mission = runner("pinch").run()
    assert mission.verdict.refused is not None
    assert f"what {finger} bears is not known" in mission.verdict.refused.text
    assert mission.verdict.released
    opened = [dict(map(reversed, run.events))["release"] for run in mission.runs]
    assert np.ptp(opened) < 0.03
    fails(monkeypatch, hold.start, finger=finger)
    mission = runner("pinch").run()
    assert mission.verdict.held
    assert mission.verdict.refused is None
    assert mission.verdict.released
