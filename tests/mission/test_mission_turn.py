"""Missions that turn their object before they grasp it; from inside: records made by hand, and the plant without a run.

Missions that turn their object before they grasp it: setpoints, plant, verdict and its reasons, a short run.
"""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from continuum_grasp.addons.mission import Outcome, PlantVariation, TrialsResult, run_trials
from continuum_grasp.addons.mission.causes import Turned, find_turned
from continuum_grasp.addons.mission.from_grasp import assign
from continuum_grasp.addons.mission.plant import Timetable, mission_plant_model
from continuum_grasp.addons.mission.precheck import exceeded, exceeded_by_trials
from continuum_grasp.addons.mission.record import MissionRecord
from continuum_grasp.addons.mission.run import MissionRunner
from continuum_grasp.base import InputError
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.results import read_run
from continuum_grasp.scene import load
from tests.declared import assert_declared
from tests.marks import few
from tests.mission_cases import BLOCK, MUG, PINCH, begun, planned

SHORT = (
    "{touch: 0.5, stroke: 1.4, leave: 0.4, approach: 0.5, squeeze: 0.6, settle: 0.3, lift: 0.2, hold: 0.3, pull: 0.16, "
    "rest: 0.06, lower: 0.2, release: 0.5}"
)
QUICK = ("plant.fidelity.elements=3", f"phases={SHORT}", "pull_share=0.0")
ANGLE = math.radians(30.0)


COSTLY_FIXTURES = ("turned",)


@pytest.fixture(scope="module")
def grasp():
    return optimize_grasp(load(BLOCK).grasp)


@pytest.fixture(scope="module")
def assignment(grasp):
    return assign(load(BLOCK, QUICK), grasp)[0]


@pytest.fixture(scope="module")
def table(assignment):
    return Timetable(assignment)


# -- what is to be done -----------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_the_controller_knows_the_object_before_its_turn_and_what_holds_it(assignment, grasp):
    control, mission = assignment.control, assignment.mission
    assert control.object.position == mission.turn.position
    assert control.object.angle == pytest.approx(grasp.object_pose[2] - ANGLE)
    assert control.object.mass == 0.12
    assert assignment.object_pose == pytest.approx(tuple(grasp.object_pose))
    assert control.object_moves
    assert control.table.stays
    assert control.contact_law.friction == 0.5
    assert control.contact_law.presliding is None
    assert list(control.supports) == ["palm"]
    plant = mission_plant_model(assignment)
    # The plant's table sinks, its friction sticks, and the object begins at the same place.
    assert not plant.scene.table.stays
    assert plant.scene.table.friction_radius == 0.0175
    assert plant.scene.contact_law.presliding is None
    assert plant.scene.contact_law.slip_speed is None
    assert plant.start[plant.system.object_states][:3] == pytest.approx([0.029, -0.008, -ANGLE])


@pytest.mark.deep
def test_setpoints_lead_to_the_object_turn_it_and_leave_it(table, assignment):
    names = ("gap_finger.tip [m]", "object_angle [rad]", "bending_1 [rad]")
    starts = {span.name: span.start for span in table.spans}
    assert list(starts)[:7] == ["touch 1", "turn 1", "leave 1", "touch 2", "turn 2", "leave 2", "approach"]
    at = [starts[name] for name in ("touch 1", "turn 1", "leave 1", "touch 2", "turn 2", "leave 2", "approach")]
    gap, angle, bend = planned(table, names, at).T
    assert gap == pytest.approx([0.02, 0.0, 0.0, 0.02, 0.0, 0.0, 0.02])
    assert np.degrees(angle) == pytest.approx([-30.0, -30.0, -15.0, -15.0, -15.0, 0.0, 0.0], abs=1e-9)
    # The last stroke is left from about where the grasp touches, the finger is straight before the approach.
    assert bend[-2:] == pytest.approx([assignment.bends[0], 0.0])
    t = np.arange(0.0, table.duration, 1e-3)
    rows = planned(table, names, t)
    assert np.abs(np.diff(rows, 2, axis=0)).max() < 1e-6 * 6.0 * np.abs(rows).max() / 0.4**2


@pytest.mark.deep
def test_what_is_followed_changes_with_the_phase(table):
    names = ("bending_1 [rad]", "contact_force_finger.tip [N]", "gap_finger.tip [m]", "object_angle [rad]")
    stages = SimpleNamespace(
        r_names=names, weights=np.ones(4), stage=0.01, u_min=np.full(2, 1.0), u_max=np.full(2, 95.0)
    )
    said = begun(table, stages, SimpleNamespace(command=np.full(2, 1.0)))
    followed = {name: {names[k].split("_")[0] for k in np.flatnonzero(new["weights"])} for name, new in said.items()}
    expected = {
        ("touch 1", "leave 1", "touch 2"): {"gap"},
        ("turn 1", "turn 2"): {"gap", "object"},
        ("leave 2", "approach", "release"): {"bending"},
        ("settle", "confirm", "lift"): {"contact"},
    }
    assert followed == {name: of for phases, of in expected.items() for name in phases}


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (["estimator.measured.object=null"], "turn: needs estimator.measured.object"),
        (["turn=null"], "estimator.measured.object: needs a turn"),
        (["turn.angle=0.0"], "angle must not be zero"),
        (["turn.tolerance=40 deg"], "tolerance = 0.698132 rad is not less than the angle, 0.523599 rad"),
        (["turn.strokes=0"], "turn.strokes"),
        (["turn.stroke=2"], "turn.stroke"),
        (["estimator.disturbances.object_position=0.004"], "has no effect with a turn"),
        (
            ["grasp.gravity=[0.0, -9.81, 0.0]", "grasp.upright=false", "table_friction_radius=0"],
            "turn: works only for a table below",
        ),
        (
            ["grasp.gravity=[0.0, -9.81, 0.0]", "grasp.upright=false"],
            "table_friction_radius: works only for a table below",
        ),
    ],
)
def test_what_makes_no_turn_is_named(change, said):
    with pytest.raises(InputError, match=said):
        load(BLOCK, change)


def test_several_fingers_do_not_turn():
    camera = "estimator.measured.object={position: 0.0003, angle: 0.005}"
    with pytest.raises(InputError, match="turn: needs a grasp of one finger"):
        load(PINCH, [camera, "turn={angle: 0.5, position: [0.08, 0.0]}", "estimator.disturbances.object_position=null"])


@pytest.mark.deep
@pytest.mark.parametrize(
    ("position", "said"),
    few(
        [
            ([0.020, -0.008], "lies 6.86 mm inside palm"),
            ([0.080, -0.008], "the object overlaps the straight finger"),
            ([0.029, 0.200], "out of reach"),
            ([0.030, -0.070], "first at 0.072 m of its length, not at the tip"),
        ],
        2,
    ),
)
def test_an_object_that_the_tip_cannot_turn_is_refused(grasp, position, said):
    with pytest.raises(InputError, match=f"turn.position: .*{said}"):
        assign(load(BLOCK, [f"turn.position={position}"]), grasp)


def test_friction_of_the_table_is_compared_with_the_tips_force(assignment, grasp):
    """Coulomb: friction times weight."""
    assert exceeded([assignment], PlantVariation()) == ()
    rough = replace(assignment, mission=load(BLOCK, ["table_friction=3.0", "pull_share=0.0"]))
    (one,) = exceeded([rough], PlantVariation(mass=1.05))
    assert (one.name, one.key, one.unit) == ("turn", "table_friction", "N")
    assert one.given == pytest.approx(3.0 * 1.05 * 0.12 * 9.81)
    assert one.certified == grasp.contact("finger.tip").normal_force
    assert f"{one.given:.3g} N against sliding" in one.text
    # Trials are compared at their heavy and rough end as well.
    drawn = [PlantVariation(), PlantVariation(friction=1.1)]
    edge = one.certified / (1.05 * 0.12 * 9.81)
    rough = replace(assignment, mission=load(BLOCK, [f"table_friction={edge}", "pull_share=0.0"]))
    head, text = exceeded_by_trials([rough], drawn)
    assert head == "1 of 2 plants are beyond the certificate"
    assert text.startswith("at the heavy and rough end of trials: the table holds the object with")


# -- the verdict ------------------------------------------------------------------------------------------------------


def judged(table, assignment, *, first=15.0, second=30.0, end=30.0, shear=0.1, normal=1.0, u=20.0, until=math.inf):
    """A turn by hand: angles after both strokes and in the end [deg], and how the tip pushes in each stroke."""
    t = np.arange(0.0, table.duration + 1e-9, 0.01)
    at = [table.span(name).end for name in ("touch 1", "turn 1", "touch 2", "turn 2", "squeeze", "release")]
    angle = np.interp(t, at, [0.0, first, first, second, second, end])
    pose = np.stack([0.0125 + 0.0 * t, -0.012 + 0.003 + 0.0 * t, np.radians(angle) - ANGLE, 0.0 * t], axis=1)
    pushing = sum((t > table.span(f"turn {k}").start) & (t < table.span(f"turn {k}").end) for k in (1, 2)) > 0
    force = np.where(pushing & ((t < until) | (t > table.span("touch 2").start)), normal, 0.0)
    contacts = SimpleNamespace(
        names=("finger.tip", "palm.1", "table"),
        on_finger=lambda name: name == "finger.tip",
        normal_force=np.stack([force, 0.5 * force, 1.0 + 0.0 * t], axis=1),
        shear=np.stack([shear * force, 0.0 * t, 0.0 * t], axis=1),
    )
    u = np.full((len(t) - 1, 2), u)
    run = SimpleNamespace(t=t, u=u, u_max=np.array([95.0, 95.0]), health=("ok",), object_pose=pose)
    return find_turned(MissionRecord((assignment,), table, PlantVariation(), (run,), contacts))


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({}, ""),
        ({"first": 9.0}, ""),
        ({"second": 25.0}, "it stood still, or needs more time: finger.tip presses with 1.00 N, palm bears 0.50 N"),
        ({"second": 35.0, "end": 35.0}, "finger.tip pushed it 5 deg too far (turn 2)"),
        ({"second": 25.0, "normal": 0.0}, "finger.tip did not touch it (turn 2)"),
        ({"second": 25.0, "u": 94.0}, "the drive is at its limit: finger.tip presses with 1.00 N (turn 2)"),
        ({"second": 25.0, "shear": 0.5}, "finger.tip slides on it with friction of 0.50: finger.tip presses"),
        ({"first": 5.0, "second": 20.0, "until": 0.6}, "finger.tip lost it at 0.59 s (turn 1)"),
        ({"end": 20.0}, "it turned away by -10 deg while it was held and let go"),
    ],
)
def test_a_turn_that_fell_short_is_explained(table, assignment, given, reason):
    found = judged(table, assignment, **given)
    assert found.achieved == (reason == "")
    assert found.reason.startswith(reason)
    assert np.degrees(found.strokes) == pytest.approx([given.get("first", 15.0), given.get("second", 30.0)], abs=0.2)
    assert math.degrees(found.end_error) == pytest.approx(given.get("end", 30.0) - 30.0, abs=1e-6)
    assert found.shift == pytest.approx(0.003, abs=1e-9)


def test_no_turn_has_no_verdict(table, assignment):
    plain = replace(assignment, mission=load(MUG))
    assert find_turned(MissionRecord((plain,), table, PlantVariation(), (SimpleNamespace(t=None),), None)) is None


# -- end to end -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def turned(assignment):
    return MissionRunner([assignment]).run()


@pytest.mark.deep
def test_a_block_is_turned_in_two_strokes_then_grasped_held_and_released(turned, table):
    verdict = turned.verdict
    assert turned.outcome == "turned, held and released"
    assert verdict.succeeded
    assert verdict.fallbacks == 0
    assert abs(verdict.turned.error) < math.radians(2.0)
    first, second = np.degrees(verdict.turned.strokes)
    assert 10.0 < first < 20.0 < second
    # Between the strokes nothing of the finger touches it, and it stands still.
    t, pose = turned.t, turned.object_pose
    tip = turned.contacts.normal_force[:, turned.contacts.names.index("finger.tip")]
    apart = (t > table.span("leave 1").end) & (t < table.span("touch 2").start + 0.2)
    assert np.all(tip[apart] == 0.0)
    assert np.ptp(pose[apart, 2]) < math.radians(0.05)
    assert tip[(t > table.span("turn 1").start) & (t < table.span("turn 1").end)].max() > 0.1
    # What the camera and the model say of it, against the plant.
    run = turned.run
    believed = run.estimate[:, run.estimated_names.index("object_angle [rad]")]
    turning = (t[:-1] > table.span("turn 1").start) & (t[:-1] < table.span("leave 2").end)
    assert np.sqrt(np.mean((believed - pose[:-1, 2])[turning] ** 2)) < math.radians(1.0)


@pytest.mark.deep
def test_it_is_reported_saved_and_drawn(turned, tmp_path):
    assert_declared(turned)
    report = turned.report()
    assert "turned, held and released" in report
    assert "after its strokes" in report
    saved = read_run(turned.save(tmp_path / "run"))
    assert saved.meta["verdict"]["turned"]["achieved"]
    axes = turned.plot(picture="timeline").axes
    assert "object's angle [deg]" in [ax.get_ylabel() for ax in axes]
    titles = [ax.get_title(loc="left") for ax in turned.plot(picture="snapshots").axes]
    assert any(title.startswith("turn 1 done") for title in titles)
    outcome = Outcome(turned.variation, turned.verdict)
    short = Turned(0.4, -0.12, -0.12, 0.0, (0.2, 0.4), 0.03, "finger.tip did not touch it (turn 2)")
    other = Outcome(turned.variation, replace(turned.verdict, turned=short))
    trials = TrialsResult(turned.mission, (outcome, other))
    assert_declared(trials)
    assert trials.summary.failed == (1,)
    assert trials.summary.turned == 1
    assert "not turned" in other.text
    assert trials.outcome == "1 of 2 plants turned, held and released the object"
    text = (trials.save(tmp_path / "trials") / "trials.csv").read_text(encoding="utf-8")
    assert "turn_error" in text.splitlines()[0]
    assert "finger.tip did not touch it (turn 2)" in text


@pytest.mark.deep
def test_three_plants_are_turned(grasp):
    found = run_trials(load(BLOCK, ["plant.fidelity.elements=4", "trials.count=3"]), grasp=grasp, jobs=1)
    assert [outcome.text for outcome in found if not outcome.succeeded] == []
