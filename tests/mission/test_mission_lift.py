"""Before the lift: contacts and the certificate; from inside: the check gets commands made here, one by one.

Before the lift: what contacts bear is compared with the certificate, on pads before the run and by the estimate.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.addons.mission import check_mission, on_pads, run_mission, run_trials
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.lift import LiftCheck
from continuum_grasp.addons.mission.plan import Bearing, LiftDecision, PhasePlan
from continuum_grasp.addons.mission.plant import Timetable
from continuum_grasp.base import SolverError
from continuum_grasp.control import Anomaly, CommandStatus, Health, Sight, Trip
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import load
from tests.mission_cases import CERTIFIED, MUG, STAGES, STEP, carried_out, commanded, fingers


def lifted(forces, *, tension=60.0, names=("lower", "upper"), **seen):
    """Schedules that are run with estimates ``forces(t)`` of all tips: timetable, phases by instant, the refusal."""
    run = carried_out(fingers(*names), forces, std=0.02, u=np.array([tension, 1.0]), **seen)
    refused = run.check.refused
    # Squeezing on, the tendon that closes has its tension in the grasp, and the other does not pull against it.
    assert run.limits["confirm"] == (60.0, 0.0, 75.0, 4.0)
    assert run.limits.get("lift") == (None if refused else (51.0, 0.0, 75.0, 4.0))
    return run.table, run.passed, refused


@pytest.mark.parametrize("names", [("finger",), ("lower", "upper"), ("a", "b", "c")])
def test_fingers_that_bear_enough_lift_at_once(names):
    table, passed, refused = lifted(lambda t: [2.002] * len(names), names=names)
    # Of several fingers the first decides with what the others estimated a period before.
    late = STEP * (len(names) > 1)
    assert refused is None
    assert table.span("lift").start == pytest.approx(1.6 + late)
    assert next(t for t, name in passed if name == "lift") == pytest.approx(1.6 + late)
    assert table.duration == pytest.approx(Timetable(fingers("a")[0]).duration + late)


@pytest.mark.parametrize("low", [0, 1])
def test_one_that_bears_too_little_is_waited_for_then_all_let_go(low):
    table, passed, refused = lifted(lambda t: [1.998 if k == low else 4.0 for k in range(2)])
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
        ({"sight": Sight.PREDICTS}, "no sensor shows the shape"),
        ({"health": Health.DETUNED}, ""),
        ({"anomaly": Anomaly.OUTLIER}, ""),
    ],
)
def test_forces_that_no_measurement_shows_lift_nothing(seen, why):
    _, passed, refused = lifted(lambda t: [4.0, 4.0], **seen)
    assert ("lift" in [name for _, name in passed]) is (not why)
    assert (refused is None) is (not why)
    assert refused is None or (why in refused.text and "Look at the sensors" in refused.text)


@pytest.mark.parametrize("names", [("finger",), ("lower", "upper"), ("a", "b", "c")])
@pytest.mark.parametrize("blind", [0, -1])
@pytest.mark.parametrize("since", [1, 30, 120, 160, 190])
def test_fingers_let_go_at_once_where_one_is_blind_before_the_lift(since, blind, names):
    """In whichever phase; the others learn of it from the first one, which learns of it a period later."""
    check, limits, begun = LiftCheck(fingers(*names)), [], {}
    plans = [check.schedule(k, STAGES) for k in range(len(names))]
    plant, usual = SimpleNamespace(command=np.zeros(2), height=math.nan), commanded(0.0, u=np.zeros(2))
    controller = SimpleNamespace(change=lambda u_min, **_: limits.append(u_min[0]))
    for plan in plans:
        plan.enter(0.0, controller, plant)
    for k in range(1, 400):
        lost = commanded(CERTIFIED, u=np.zeros(2), sight=Sight.BLIND, anomaly=Anomaly.BLIND)
        commands = [usual] * len(names)
        commands[blind] = lost if k >= since else usual
        for name, plan, command in zip(names, plans, commands, strict=True):
            plan.advance(k * STEP, controller, plant, command)
            if plan.phase == "release":
                begun.setdefault(name, k)
    later = blind == -1 and len(names) > 1
    assert begun[names[blind]] == since
    assert max(begun.values()) == begun[names[0]] == since + later
    assert {plan.phase for plan in plans} == {"end"}
    assert all("lift" not in dict(map(reversed, plan.events)) for plan in plans)
    assert (60.0 in limits) == (since + later > 160)  # those of `confirm`
    assert limits[-1] == 0.0
    assert (plans[0].decision, plans[blind].bears) == (LiftDecision.LETS_GO, Bearing.BLIND)
    assert f"nothing was measured, and what {names[blind]} bears is not known" in check.refused.text
    assert [span.name for span in check.timetable.spans][-2:] == ["release", "end"]
    assert check.timetable.span("release").start == pytest.approx(STEP * begun[names[0]])
    heights = check.timetable.outside()["table_height [m]"](np.linspace(0.0, 4.0, 401))
    assert not heights.any()


@pytest.mark.parametrize(
    ("seen", "why"),
    [
        ({"anomaly": Anomaly.BLIND}, "nothing was measured"),
        ({"trip": Trip.UNSEEN}, "the controller is tripped (unseen)"),
        ({"health": Health.FROZEN}, "a reading is frozen"),
        ({"status": CommandStatus.SAFE_RAMP}, "no plan was found for a whole horizon"),
        ({}, "no sensor shows the shape"),
    ],
)
def test_a_refusal_says_why_a_finger_is_blind(seen, why):
    run = carried_out(fingers("finger"), lambda t: [CERTIFIED], seen=lambda t: {"sight": Sight.BLIND, **seen})
    assert run.check.refused.text.startswith(f"not lifted at 0.01 s: {why}, and what finger bears is not known. Look")


@pytest.mark.parametrize("names", [("finger",), ("lower", "upper")])
@pytest.mark.parametrize("since", [1.8, 2.4, 3.0])
def test_what_is_lifted_is_held_by_blind_fingers_and_set_down_in_time(since, names):
    """As if they saw: the limits of the command hold it, as in the grasp, until it is lowered and let go."""
    blind = {"sight": Sight.BLIND, "anomaly": Anomaly.BLIND}
    runs = [
        carried_out(
            fingers(*names, slip={}),
            lambda t, after=after: [CERTIFIED if t < since else after] * len(names),
            seen=lambda t, after=after: blind if t >= since and not after else {},
        )
        for after in (CERTIFIED, 0.0)
    ]
    assert runs[0].passed == runs[1].passed
    # Who sees at the lift may hold with 85 % of the grasp's tension.
    assert runs[1].limits["lift"][:2] == (60.0 if since == 1.8 else 51.0, 0.0)
    assert (runs[1].check.refused, runs[1].check.slipped) == (None, None)


@pytest.mark.parametrize(("seen", "lift"), [([0, 1, 1, 0, 0, 0, 1], 6), ([0, 0, 0, 0, 1, 1, 0, 0, 1], 8)])
def test_forces_are_counted_in_calls_that_measure(seen, lift):
    """Three of them in a row, with predictions in between."""
    begin = 1.65
    run = carried_out(
        fingers("finger"),
        lambda t: [CERTIFIED * (t > begin - STEP / 2)],
        seen=lambda t: {} if [*seen, *[1] * 999][max(round((t - begin) / STEP), 0)] else {"sight": Sight.PREDICTS},
    )
    assert run.table.span("lift").start == pytest.approx(begin + lift * STEP)


@pytest.mark.parametrize(("calls", "lifts"), [(2, False), (3, True)])
def test_an_estimate_that_jumps_lifts_nothing(calls, lifts):
    """Of a finger that closes on nothing two estimates in a row were 5 N with a deviation of 1 N."""
    _, passed, refused = lifted(lambda t: [CERTIFIED * (1.795 < t < 1.795 + calls * STEP)], names=("finger",))
    assert ("lift" in [name for _, name in passed]) is lifts
    assert (refused is None) is lifts
    assert lifts or "See that the object stands where the grasp has it" in refused.text


def test_without_a_share_it_is_lifted_whatever_the_estimate():
    (of,) = fingers("finger")
    of.mission.phases = of.mission.phases.replaced(lift_share=0.0)
    run = carried_out([of], lambda t: [-0.5])
    assert (run.check.refused, run.table.span("lift").start) == (None, pytest.approx(1.6))


CONTRADICTED = {"health": Health.DETUNED, "sight": Sight.CONTRADICTED, "suspect": "bending", "mismatch": 4.25}


@pytest.mark.parametrize("names", [("finger",), ("lower", "upper")])
@pytest.mark.parametrize(("until", "lift"), [(1.8, 1.8), (2.38, 2.38), (2.45, 2.4)])
def test_a_lift_waits_until_sensors_agree_with_the_model(until, lift, names):
    """With all forces there: as soon as they agree, else in doubt after the time of a squeeze."""
    run = carried_out(
        fingers(*names),
        lambda t: [CERTIFIED] * len(names),
        seen=lambda t: CONTRADICTED if t < until - STEP / 2 else {},
    )
    # Of several fingers the first decides with what the others estimated a period before.
    late, doubted = STEP * (len(names) > 1 and lift == until), run.check.doubted
    assert run.check.refused is None
    assert run.table.span("lift").start == pytest.approx(lift + late)
    assert (doubted is None) == (lift == until)
    if doubted is not None:
        assert doubted.time == pytest.approx(lift)
        assert all(f"bending contradicts the model of {name} (mismatch 4.25)" in doubted.text for name in names)


@pytest.mark.parametrize("low", [0, 1])
def test_forces_that_are_doubted_and_too_low_lift_nothing(low):
    forces = [1.0 if k == low else CERTIFIED for k in range(2)]
    run = carried_out(fingers("lower", "upper"), lambda t: forces, seen=lambda t: CONTRADICTED)
    assert run.check.doubted is None
    assert "bears 1.00 +- 0.10 N" in run.check.refused.text
    assert "bending contradicts the model, and what lower bears is not known" in run.check.refused.text
    assert "Look at the sensors" in run.check.refused.text


@pytest.mark.parametrize("share", [0.999, 1.001])
def test_a_drive_at_its_limit_is_the_cause(share):
    """Commands count as at the limit from 99.9 % of it on."""
    _, _, refused = lifted(lambda t: [0.0], names=("finger",), tension=share * 0.999 * 75.0)
    assert ("at its limit of 75 N" in refused.cause) == (share > 1.0)


@pytest.mark.parametrize(
    ("k", "at_once", "phase"), [(50, False, "release"), (250, False, "lower"), (250, True, "release")]
)
def test_an_object_is_let_go_when_asked_without_a_jump(k, at_once, phase):
    """Setpoints go on from where they are; what was lifted is lowered first."""
    (of,) = fingers("finger")
    plan, plant = PhasePlan(Timetable(of), STAGES, np.zeros(1)), SimpleNamespace(command=np.zeros(2))
    command, controller, rows = commanded(CERTIFIED), SimpleNamespace(change=lambda **_: None), []
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
    table, _, refused = lifted(lambda t: [4.0 * (t > 1.975)], names=("finger",))
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
        with pytest.raises(SolverError, match=r"do not reach the grasp on pads of 2000 N/m") as error:
            check(1.001 * least, entry)
        assert (error.value.status, [text.split()[0] for text in error.value.violated]) == ("not_loaded", [contact])
