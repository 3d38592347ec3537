"""Before the lift: what contacts bear is compared with the certificate, on pads before the run and by the estimate."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.control.status import Anomaly, Health, Trip
from continuum_grasp.errors import SolverError
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.mission import check_mission, on_pads
from continuum_grasp.mission.assign import assign
from continuum_grasp.mission.lift import LiftCheck
from continuum_grasp.mission.plan import Plan
from continuum_grasp.mission.plant import Timetable
from continuum_grasp.mission.run import run_mission, run_trials
from continuum_grasp.scene.load import load
from tests.mission_cases import CERTIFIED, MUG, STEP, fingers

STAGES = SimpleNamespace(r_names=(), weights=np.zeros(0), u_min=np.zeros(2), u_max=np.full(2, 75.0))
NOTHING = Anomaly(0)


def carried_out(forces, *, tension=60.0, names=("lower", "upper"), trip=Trip.NONE, anomaly=NOTHING, health=Health.OK):
    """Schedules that are run with estimates ``forces(t)`` of all tips: timetable, phases by instant, the check."""
    of = fingers(*names)
    check = LiftCheck(of)
    plans = [check.schedule(k, STAGES) for k in range(len(of))]
    limits, passed = {}, []
    controller = SimpleNamespace(change=lambda u_min, u_max, **_: limits.update({plans[0].phase: (*u_min, *u_max)}))
    for plan in plans:
        plan.enter(0.0, controller, SimpleNamespace(command=np.zeros(2)))
    for k in range(1, 1000):
        t, going = k * STEP, []
        for plan, force in zip(plans, forces(k * STEP), strict=True):
            estimated = SimpleNamespace(force=np.array([force]), std=np.array([0.02]))
            seen = {"trip": trip, "anomaly": anomaly, "health": health}
            command = SimpleNamespace(contact_forces=estimated, u=np.array([tension, 1.0]), **seen)
            going.append(plan.advance(t, controller, SimpleNamespace(t=t, command=command.u), command))
        assert len(set(going)) == 1
        if not going[0]:
            break
        assert len({plan.phase for plan in plans}) == 1
        passed.append((t, plans[0].phase))
    # Squeezing on, the tendon that closes has its tension in the grasp, and the other does not pull against it.
    assert limits["confirm"] == (60.0, 0.0, 75.0, 4.0)
    assert limits.get("lift") == (None if check.refused else (51.0, 0.0, 75.0, 4.0))
    return check.timetable, passed, check.refused


@pytest.mark.parametrize("names", [("finger",), ("lower", "upper"), ("a", "b", "c")])
def test_fingers_that_bear_enough_lift_at_once(names):
    table, passed, refused = carried_out(lambda t: [2.002] * len(names), names=names)
    # Of several fingers the first decides with what the others estimated a period before.
    late = STEP * (len(names) > 1)
    assert refused is None
    assert table.span("lift").start == pytest.approx(1.6 + late)
    assert next(t for t, name in passed if name == "lift") == pytest.approx(1.6 + late)
    assert table.duration == pytest.approx(Timetable(fingers("a")[0]).duration + late)


@pytest.mark.parametrize("low", [0, 1])
def test_one_that_bears_too_little_is_waited_for_then_all_let_go(low):
    table, passed, refused = carried_out(lambda t: [1.998 if k == low else 4.0 for k in range(2)])
    assert [span.name for span in table.spans] == ["approach", "squeeze", "confirm", "release", "end"]
    assert (table.span("confirm").end, table.span("lift").start) == (pytest.approx(2.4), math.inf)
    assert [name for _, name in passed][-1] == "end"
    assert passed[-1][0] == pytest.approx(table.duration, abs=1.5 * STEP)
    contact = ("lower.tip", "upper.tip")[low]
    assert [(one.contact, one.std) for one in refused.shortfalls] == [(contact, 0.02)]
    for said in (f"{contact} bears 2.00 +- 0.02 N of 4.00 N certified", "2.40 s", "contact_law.stiffness", "4.00 N at"):
        assert said in refused.text


@pytest.mark.parametrize(
    ("seen", "why"),
    [
        ({"anomaly": Anomaly.BLIND}, "nothing was measured"),
        ({"trip": Trip.UNSEEN}, "the controller is tripped (unseen)"),
        ({"health": Health.FROZEN}, "a reading is frozen"),
        ({"anomaly": Anomaly.OUTLIER}, ""),
    ],
)
def test_forces_that_no_measurement_shows_lift_nothing(seen, why):
    _, passed, refused = carried_out(lambda t: [4.0, 4.0], **seen)
    assert ("lift" in [name for _, name in passed]) is (not why)
    assert (refused is None) is (not why)
    assert refused is None or (why in refused.text and "Look at the sensors" in refused.text)


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_drive_at_its_limit_is_the_cause(share):
    """Commands count as at the limit from 99.9 % of it on."""
    _, _, refused = carried_out(lambda t: [0.0], names=("finger",), tension=share * 0.999 * 75.0)
    assert ("at its limit of 75 N" in refused.cause) == (share > 1.0)


@pytest.mark.parametrize(
    ("k", "at_once", "phase"), [(50, False, "release"), (250, False, "lower"), (250, True, "release")]
)
def test_an_object_is_let_go_when_asked_without_a_jump(k, at_once, phase):
    """Setpoints go on from where they are; what was lifted is lowered first."""
    (of,) = fingers("finger")
    limits = np.zeros(2), np.full(2, 75.0)
    names = ("contact_force_finger.tip [N]",)
    stages = SimpleNamespace(r_names=names, weights=np.ones(1), u_min=limits[0], u_max=limits[1])
    plan, plant = Plan(Timetable(of), stages, np.zeros(1)), SimpleNamespace(command=np.zeros(2))
    forces = SimpleNamespace(force=np.full(1, CERTIFIED))
    command = SimpleNamespace(contact_forces=forces, trip=Trip.NONE, anomaly=NOTHING, health=Health.OK)
    controller, rows = SimpleNamespace(change=lambda **_: None), []
    plan.enter(0.0, controller, plant)
    for step in range(1, 800):
        if not plan.advance(step * STEP, controller, plant, command):
            break
        if step == k:
            plan.release(step * STEP, controller, plant, at_once=at_once)
            assert plan.phase == phase
        rows.append(plan.rows(np.array([step * STEP]))[0, 0])
    assert plan.phase == "end"
    assert np.abs(np.diff(rows)).max() < 2.0 * CERTIFIED * STEP / 0.8
    assert rows[-1] == pytest.approx(0.0, abs=1e-12)
    events = [name for _, name in plan.events]
    assert events[events.index(phase) :] == ["lower", "release", "end"][phase == "release" :]


def test_what_follows_a_lift_that_is_late_is_late():
    """Table, pulls and setpoints are those of the plan, moved by the wait."""
    table, _, refused = carried_out(lambda t: [4.0 * (t > 1.995)], names=("finger",))
    plan, t = Timetable(fingers("finger")[0]), np.linspace(0.0, 9.0, 901)
    assert refused is None
    assert table.span("confirm").end == pytest.approx(2.0)
    for name, function in table.outside().items():
        wanted = np.where(t < 1.6, plan.outside()[name](t), plan.outside()[name](np.maximum(t - 0.4, 1.6)))
        assert function(t) == pytest.approx(wanted, abs=1e-12)
    assert table.span("pull 2").start == pytest.approx(plan.span("pull 2").start + 0.4)


# -- on pads ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def assignments():
    mission = load(MUG, ["grasp.solver.effort=quick"])
    return assign(mission, optimize_grasp(mission.grasp))


@pytest.fixture(scope="module")
def states(assignments):
    return list(on_pads.closed(assignments))


@pytest.mark.deep
def test_pads_at_rest_press_as_their_springs_do(assignments, states):
    """N = k depth, and the object is where forces of finger and palm balance: the palm bears what x has of the pads."""
    last, law = states[-1], assignments[0].mission.contact_law
    assert last.tension == pytest.approx(assignments[0].mission.drive_tension, rel=1e-3)
    assert last.normal_force == pytest.approx(-law.stiffness * last.gap, rel=0.02)
    assert states[0].tension == pytest.approx(assignments[0].tensions.max(), rel=1e-3)


@pytest.mark.deep
def test_more_is_needed_than_is_borne_at_any_tension(assignments, states, monkeypatch):
    """The mission is refused from the share of the certificate on that the worst contact bears at best."""
    monkeypatch.setattr(on_pads, "closed", lambda of, stiffer=1.0: iter(states[:1]))
    forces = {c.name: c.normal_force for c in assignments[0].grasp.contacts}
    borne = states[0].normal_force / [forces["finger.middle"], forces["finger.tip"]]
    contact, least = ("finger.1", "finger.tip")[int(np.argmin(borne))], float(borne.min())

    def check(share, entry=check_mission):
        mission = assignments[0].mission
        entry(mission.replaced(phases=mission.phases.replaced(lift_share=share)), grasp=assignments[0].grasp)

    check(0.999 * least)
    for entry in (check_mission, run_mission, run_trials):
        with pytest.raises(SolverError, match=r"not reached on pads of 2e\+03 N/m") as error:
            check(1.001 * least, entry)
        assert (error.value.status, [text.split()[0] for text in error.value.violated]) == ("not_loaded", [contact])
