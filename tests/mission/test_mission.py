"""Missions: setpoints, verdicts, plants, short runs; from inside: records made by hand, and plants without a run.

Missions: what is asked for when, the verdict, plants that differ, and short runs that hold, drop and repeat.
"""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from continuum_grasp.addons.mission import NotLifted, Outcome, PlantVariation, Trials, TrialsResult
from continuum_grasp.addons.mission import run as runs
from continuum_grasp.addons.mission.causes import Drop
from continuum_grasp.addons.mission.from_grasp import _Task, assign
from continuum_grasp.addons.mission.lift import Doubted, Slipped
from continuum_grasp.addons.mission.pictures import _draw_moved
from continuum_grasp.addons.mission.plant import MissionPlant, Timetable, mission_plant_model
from continuum_grasp.addons.mission.record import MissionRecord
from continuum_grasp.addons.mission.result import verdict_data
from continuum_grasp.addons.mission.run import MissionRunner
from continuum_grasp.addons.mission.verdict import judge
from continuum_grasp.addons.web.plant import plant_of_loop
from continuum_grasp.addons.web.record import loop_record
from continuum_grasp.base import InputError, Interrupted, NumericalError, SolverError
from continuum_grasp.cli import app
from continuum_grasp.control import Prediction, stages_of
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.results import read_run
from continuum_grasp.scene import DataTable, load
from continuum_grasp.simulation import simulate
from tests.declared import assert_declared
from tests.mission_cases import COARSE, MUG, QUICK, SHORT, begun, planned, straight_grasp

COSTLY_FIXTURES = ("held",)


@pytest.fixture(scope="module")
def grasp():
    return optimize_grasp(load(MUG, QUICK).grasp)


@pytest.fixture(scope="module")
def assignment(grasp):
    return assign(load(MUG, QUICK), grasp)[0]


@pytest.fixture(scope="module")
def table(assignment):
    return Timetable(assignment)


@pytest.fixture(scope="module")
def runner(assignment):
    return MissionRunner([assignment])


@pytest.fixture(scope="module")
def held(runner):
    return runner.run()


@pytest.mark.deep
def test_a_mission_is_simulated_open_loop_by_another_integrator(held):
    """From approach to release: what sinks with its table is held, pulled at and set down as in the closed loop."""
    motion = simulate(held)
    assert motion.t == pytest.approx(held.t)
    assert np.abs(held.object_pose[:, 3]).max() < 0.01  # the table sinks by 50 mm
    assert np.linalg.norm(motion.tip - held.run.tip, axis=1).max() < 1e-4
    assert np.abs(motion.object_pose - held.object_pose)[:, [0, 1, 3]].max() < 1e-4


@pytest.mark.parametrize(
    ("name", "value"),
    [("stiffness", 0.0), ("mass", -1.0), ("friction", -0.1), ("friction_fall", 1.1), ("damping", np.nan)],
)
def test_a_plant_that_cannot_be_is_refused_by_name(name, value):
    with pytest.raises(InputError, match=rf"^{name}: expected a number from .* got {value}"):
        PlantVariation(**{name: value})
    with pytest.raises(InputError, match=r"^shift: .* got \(0.0, inf\)"):
        PlantVariation(shift=(0.0, np.inf))


# -- what is to be done -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stations", "elements"),
    [((0.1,), [0.05, 0.05, 0.04, 0.04]), ((0.06, 0.12), [0.03, 0.03, 0.06, 0.03, 0.03])],
)
def test_elements_of_the_controller_end_at_the_contacts(stations, elements):
    mission = load(MUG, [*QUICK, "controller.elements=[2, 2]"])
    control = _Task(mission, straight_grasp(mission, *stations), mission.grasp.setups[0].name).control
    assert control.fidelity.elements == pytest.approx(elements)
    assert control.contacts == stations


def test_the_assignment_is_that_of_the_grasp(assignment, grasp):
    finger, control = grasp.fingers["finger"], assignment.control
    middle = grasp.contact("finger.middle")
    assert assignment.force == middle.normal_force
    assert control.contacts == (middle.station,)
    assert control.finger.tendons.max_tension == 60.0
    angles = np.unwrap(finger.backbone[:, 3])
    assert assignment.posture.sum() == pytest.approx(angles[-1] - angles[0])
    assert np.all(assignment.rest <= assignment.before)
    assert np.all(assignment.before <= assignment.tensions + 1e-9)
    resistance = grasp.quality.resistance
    assert assignment.pulls == pytest.approx(np.minimum(resistance.factors, 5.0)[:, None] * resistance.wrenches)


def test_the_finger_that_is_about_to_touch_is_near_the_object(assignment):
    """The free finger is an arc under its tip moment: its distance from the circle, sampled finely."""
    finger, body = assignment.control.finger, assignment.control.object
    moment = finger.tendons.offset * (assignment.before[0] - assignment.before[1])
    s = np.linspace(0.0, finger.rod.length, 2001)
    kappa, heading = moment / finger.rod.stiffness, finger.base.angle
    turned = heading + 0.5 * kappa * s  # a chord's direction
    chord = s * np.sinc(0.5 * kappa * s / np.pi)
    points = np.array(finger.base.position) + chord[:, None] * np.stack([-np.sin(turned), np.cos(turned)], axis=1)
    gap = np.linalg.norm(points - body.position, axis=1).min() - 0.04 - finger.thickness_radius
    assert 0.003 <= gap < 0.004


def test_setpoints_are_smooth(table, assignment):
    names = ("contact_force_finger.1 [N]", "tension_1 [N]", "tension_2 [N]", "bending_1 [rad]", "something [1]")
    t = np.arange(0.0, table.duration, 1e-3)
    rows = planned(table, names, t)
    most = np.abs(rows).max(axis=0) + 1e-12
    assert np.all(np.abs(np.diff(rows, axis=0)).max(axis=0) / most < 1e-3 * 2.0 / 0.4)
    assert np.all(np.abs(np.diff(rows, 2, axis=0)).max(axis=0) / most < 1e-6 * 6.0 / 0.4**2)
    hold = planned(table, names, [table.span("hold").start])[0]
    assert hold == pytest.approx([assignment.force, *assignment.tensions, assignment.posture[0], 0.0])
    ends = planned(table, names, [0.0, table.duration])
    assert ends == pytest.approx(np.tile([0.0, *assignment.rest, 0.0, 0.0], (2, 1)), abs=1e-9)


def test_the_last_share_of_the_force_rises_while_it_is_followed(grasp):
    """By the posture up to a share, by the force from there: never more than before the lift, and never less again."""
    phases = SHORT.replace("lift:", "settle: 0.4, squeeze_share: 0.8, lift:")
    assigned = assign(load(MUG, [COARSE, f"phases={phases}", *QUICK[2:]]), grasp)[0]
    table = Timetable(assigned)
    squeezed, settled, lift = table.span("squeeze"), table.span("settle"), table.span("lift")
    assert (squeezed.end, settled.end) == pytest.approx((settled.start, lift.start))
    t = np.linspace(0.0, lift.end, 1001)
    force, bend = planned(table, ("contact_force_finger.1 [N]", "bending_1 [rad]"), t).T
    assert np.all(np.diff(force) >= -1e-12)
    of = {at: np.interp(at, t, force) / assigned.force for at in (squeezed.end, 0.5 * (squeezed.end + settled.end))}
    assert list(of.values()) == pytest.approx([0.8, 0.9], abs=1e-3)
    assert (force[-1], bend[-1]) == pytest.approx((assigned.force, assigned.posture[0]))
    assert np.interp(squeezed.end, t, bend) == pytest.approx(0.8 * bend[-1] + 0.2 * assigned.bends[0], rel=1e-3)


def test_positions_that_are_retained_whole_let_nothing_out(grasp, assignment):
    """Where they are at the lift is the least that is commanded then; by default, 85 % of the tension."""
    winch = (
        "tendons={offset: 0.005, max_tension: 65, friction: 0.15, axial_stiffness: 10e3, series_stiffness: 33e3, "
        "drive: {kind: length, arrangement: one_pulley, time_constant: 0.02, pretension: 2}}"
    )
    own = (
        winch,
        "drive_tension=null",
        "controller.input={lengths: [-0.025, 0.025]}",
        "controller.effort=1e3",
        "controller.input_rate=300",
    )
    least = {}
    for share in (0.85, 1.0):
        scene = load(MUG, [*QUICK, *own, f"controller.retained={share}", "estimator.measured.length=5e-5"])
        assigned = assign(scene, grasp)[0]
        stages = SimpleNamespace(r_names=(), weights=np.ones(0), u_min=np.full(1, -0.025), u_max=np.full(1, 0.025))
        plant = SimpleNamespace(command=assigned.held + 5e-4)
        least[share] = float(begun(Timetable(assigned), stages, plant)["lift"]["u_min"][0])
    assert least[1.0] == pytest.approx(float(plant.command[0]))
    assert least[0.85] < least[1.0] - 1e-4


def test_the_table_sinks_and_every_pull_is_whole(table, assignment):
    outside = table.outside()
    names = ("object_force_x [N]", "object_force_y [N]", "object_moment [N m]")
    for k, wrench in enumerate(assignment.pulls):
        span = table.span(f"pull {k + 1}")
        during = np.linspace(span.start, span.end, 5)
        pulled = np.stack([outside[name](during) for name in names], axis=1)
        assert pulled == pytest.approx(np.outer([0, 1, 1, 1, 0], wrench), abs=1e-9)
    lift, lower = table.span("lift"), table.span("lower")
    at = np.array([lift.start, lift.end, lower.start, lower.end])
    assert outside["table_height [m]"](at) == pytest.approx([0.0, -0.05, -0.05, 0.0])
    starts = [span.start for span in table.spans[1:]]
    assert starts == pytest.approx([span.end for span in table.spans[:-1]])
    calm = np.array([span.start + 0.5 * (span.end - span.start) for span in table.spans if "pull" not in span.name])
    assert all(np.abs(outside[name](calm)).max() < 1e-12 for name in names)


@pytest.mark.parametrize("most", [60.0, 40.0])
def test_what_is_held_is_held_with_most_of_the_grasps_tension(most, table, assignment):
    """As far as the drive has it; before and after all limits are those of the drive."""
    stages = SimpleNamespace(
        r_names=("tension_1 [N]",), weights=np.ones(1), stage=0.01, u_min=np.full(2, 1.0), u_max=np.full(2, most)
    )
    said = begun(table, stages, SimpleNamespace(command=np.full(2, 1.0)))
    pulling = int(np.argmax(assignment.tensions))
    least = min(0.85 * assignment.tensions[pulling], most)
    assert said["lift"]["u_min"][pulling] == pytest.approx(least)
    assert said["lift"]["u_max"][1 - pulling] == pytest.approx(assignment.rest[1 - pulling] + 3.0)
    for name in ("approach", "release"):
        assert (said[name]["u_min"].tolist(), said[name]["u_max"].tolist()) == ([1.0, 1.0], [most, most])


# -- plants that differ -----------------------------------------------------------------------------------------------


def test_plants_are_drawn_within_their_ranges():
    asked = Trials(count=400, seed=3)
    drawn = runs.variations(asked)
    assert drawn == runs.variations(asked)
    assert drawn != runs.variations(Trials(count=400, seed=4))
    assert drawn[:7] == runs.variations(Trials(count=7, seed=3))
    for name in ("stiffness", "damping", "mass", "friction"):
        reach, away = getattr(asked, name), np.array([getattr(one, name) for one in drawn]) - 1.0
        assert np.abs(away).max() <= reach
        assert away.min() < -0.95 * reach
        assert away.max() > 0.95 * reach
        assert abs(away.mean()) < 0.1 * reach
    assert np.abs([one.shift for one in drawn]).max() <= asked.position
    assert len({one.seed for one in drawn}) == 400


def test_an_object_is_shifted_into_no_support(assignment):
    """Beside a palm it goes as far as asked, towards it no further than it stands; in a groove it comes out of it."""
    table, (x, y) = Timetable(assignment), assignment.control.object.position
    plain, model = Prediction(assignment.control), mission_plant_model(assignment)

    def placed(shift):
        return MissionPlant(assignment, table, plain, PlantVariation(shift=shift), model).x[model.system.object_states][
            :2
        ]

    assert placed((1e-3, 5e-4)) == pytest.approx([x + 1e-3, y + 5e-4], abs=1e-15)
    assert placed((-1e-3, 5e-4)) == pytest.approx([x, y + 5e-4], abs=1e-8)
    # Between two walls at 60 degrees, both of which it touches: up is free, down is not, aside it climbs along a wall.
    half = np.pi / 6
    walls = {
        f"wall_{k}": {"type": "palm", "point": [x - 0.04 * np.cos(a), y - 0.04 * np.sin(a)], "normal_angle": a}
        for k, a in enumerate((half, np.pi - half))
    }
    corner = load(MUG, [*QUICK, f"grasp.supports={json.dumps(walls)}"])
    assignment = replace(assignment, mission=corner)
    model = mission_plant_model(assignment)
    assert placed((0.0, 1e-3)) == pytest.approx([x, y + 1e-3], abs=1e-15)
    assert placed((0.0, -1e-3)) == pytest.approx([x, y], abs=1e-8)
    away = placed((1e-3, -1e-4)) - [x, y]
    # Off the left wall, out of the right one along its normal.
    normal = np.array([-np.cos(half), np.sin(half)])
    asked = np.array([1e-3, -1e-4])
    assert away == pytest.approx(asked - (asked @ normal) * normal, abs=1e-8)


@pytest.mark.deep
def test_a_variation_is_that_of_the_equations(assignment, runner):
    """A mug in the air, which falls with its weight and goes with what pushes it, tells its mass."""
    model = mission_plant_model(assignment)
    system, control = model.system, runner._controllers[0].prediction
    nominal = np.array(system.p_nominal)
    w = np.zeros(system.nw)
    w[system.w_names.index("object_force_x [N]")] = 2.0
    w[system.w_names.index("table_height [m]")] = -0.05
    at = system.object_states

    def falling(variation):
        plant = MissionPlant(assignment, Timetable(assignment), control, variation, model)
        x = plant.x[: system.nx].copy()
        x[at.start] += 0.01  # clear of the palm
        found = np.array(system.forward_dynamics(x, [1.0, 1.0], w, model.p)).ravel()
        return plant, found[at.stop : at.stop + 4]

    plain, moved = falling(PlantVariation())
    assert moved == pytest.approx([2.0 / 0.3, 0.0, 0.0, -9.81])
    other, moved = falling(
        PlantVariation(
            stiffness=0.9, damping=0.8, mass=1.5, friction=0.5, shift=(1e-3, -2e-3), seed=5, tendon_friction=1.2
        )
    )
    assert moved == pytest.approx([2.0 / 0.45, 0.0, 0.0, -9.81])
    assert other.x[at][:2] - plain.x[at][:2] == pytest.approx([1e-3, -2e-3])
    assert model.p / nominal == pytest.approx([0.9 / 1.1, 0.8 / 1.3, 1.2, 1.5, 0.5])
    assert not np.array_equal(other.measure(), plain.measure())


# -- the verdict ------------------------------------------------------------------------------------------------------


def judged(
    t,
    *,
    height=None,
    normal=5.0,
    shear=1.0,
    status="solved",
    fall=0.0,
    firmer=0.0,
    incidents=(),
    slipped=None,
    away=0.0,
):
    """A closed loop by hand: one contact of the finger and a palm, a force of 5 N, from 2 s on firmer by a share; and
    the verdict on it.
    """
    asked = SimpleNamespace(
        contact_law=SimpleNamespace(friction=0.5),
        grasp=SimpleNamespace(places=(SimpleNamespace(name="palm", friction=1.0),)),
        object_height=lambda pose: pose[:, 3],
        more_contacts=(),
        turn=None,
    )
    spans = {"lift": (1.0, 2.0), "hold": (2.0, 4.0), "lower": (6.0, 7.0)}
    table = SimpleNamespace(
        span=lambda name: SimpleNamespace(start=spans[name][0], end=spans[name][1]),
        spans=[SimpleNamespace(name="all", start=0.0, end=9.0)],
        fallen=lambda variation, t: fall * (t > 3.0),
    )
    certified = SimpleNamespace(contacts=(), fingers={"finger": None})
    force = np.where(t < 7.0, normal, 0.0) * np.ones(len(t))
    pose = np.zeros((len(t), 4))
    pose[:, 0], pose[:, 3] = away, 0.0 if height is None else height(t)
    contacts = SimpleNamespace(
        names=("finger.1", "palm", "table"),
        normal_force=np.stack([force, force, 0.0 * t], axis=1),
        shear=np.stack([shear + 0.0 * t, shear + 0.0 * t, 9.0 + 0.0 * t], axis=1),
        on_finger=lambda name: name == "finger.1",
    )
    # A standard deviation of 0.1 N, in the second half of the hold of 0.2 N.
    std = np.where((t[:-1] >= 3.0) & (t[:-1] <= 4.05), 0.2, 0.1)
    run = SimpleNamespace(
        t=t,
        object_pose=pose,
        tracked=force[:, None],
        r=np.where(t < 7.0, 5.0 * (1.0 + firmer * (t > 2.0)), 0.0)[:, None],
        r_names=("contact_force_finger.1 [N]",),
        period=0.1,
        status=(status,) * (len(t) - 1),
        incidents=incidents,
        touch_names=("finger.1",),
        contact_force_estimate=np.full((len(t) - 1, 1), 5.5),
        contact_force_std=std[:, None],
    )
    control = SimpleNamespace(contacts=(0.1,))
    held = {"contact": "finger.1", "force": 5.0, "forces": {"finger.1": 5.0}, "middles": ("finger.middle",)}
    held["object_pose"] = (0.0, 0.0, 0.0)
    work = SimpleNamespace(mission=asked, grasp=certified, name="finger", control=control, **held)
    return judge(MissionRecord((work,), table, PlantVariation(friction=0.8), (run,), contacts), slipped=slipped)


INSTANTS = np.arange(0.0, 8.05, 0.1)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, {"held": True, "released": True, "force_error": 0.0, "sunk": 0.0, "force_estimate_error": 0.1}),
        ({"normal": 4.0}, {"force_error": 0.2, "force_mean_error": -0.2, "force_estimate_std": 0.04}),
        ({"normal": 6.0, "firmer": 0.2}, {"force_error": 0.0, "force_mean_error": 0.0, "force_estimate_error": -0.1}),
        ({"shear": 1.0}, {"slip_margin": 1.0 - 1.0 / (0.8 * 0.5 * 5.0)}),
        ({"shear": 1.0, "fall": 0.3}, {"slip_margin": 1.0 - 1.0 / (0.7 * 0.8 * 0.5 * 5.0)}),
        ({"height": lambda t: -0.999 * 0.005 * (t > 3.0)}, {"held": True, "sunk": 0.999 * 0.005}),
        ({"height": lambda t: -1.001 * 0.005 * (t > 3.0)}, {"held": False, "sunk": 1.001 * 0.005}),
        ({"height": lambda t: -0.009 * (t > 6.5)}, {"held": True, "sunk": 0.0}),
        ({"height": lambda t: -0.011 * (t > 6.5)}, {"held": False, "sunk": 0.0}),
        ({"height": lambda t: -0.02 * (t > 7.0)}, {"held": True, "sunk": 0.0}),
        ({"status": "safe_ramp"}, {"fallbacks": 80}),
    ],
)
def test_verdicts_of_closed_loops_by_hand(given, expected):
    found = judged(INSTANTS, **given)
    assert {name: getattr(found, name) for name in expected} == pytest.approx(expected)


@pytest.mark.parametrize(("slid", "held"), [(0.0099, True), (0.0101, False)])
def test_what_falls_while_it_is_set_down_is_dropped(slid, held):
    """Up to 10 mm it slides in the hand, as far as it would fall to 0.4 m/s."""
    noticed = Slipped(5.0, "sinks", 1e-3, 0.2, down=6.0)
    found = judged(INSTANTS, height=lambda t: -slid * (t > 6.5), slipped=noticed)
    assert (found.held, found.sunk, found.slipped.slid) == (held, 0.0, pytest.approx(slid))
    assert (found.word, found.status) == (("set down and released", "set_down") if held else ("dropped", "dropped"))
    assert ("it slid by" if held else "it fell by") in found.texts["slipped"]
    assert (found.drop is None) == held


@pytest.mark.parametrize(
    ("change", "status", "word"),
    [
        ({"doubted": Doubted(2.4, ("tip ...",))}, "lifted_in_doubt", "held and released, lifted in doubt"),
        ({}, "finished", "held and released"),
        ({"released": False}, "not_released", "held, not released"),
        ({"held": False, "drop": Drop(3.0, "hold", ())}, "dropped", "dropped"),
    ],
)
def test_a_status_says_what_prevents_success(change, status, word):
    found = replace(judged(INSTANTS), **change)
    assert (found.status, found.word) == (status, word)
    assert found.succeeded == (status in ("finished", "lifted_in_doubt"))


def test_a_mission_that_was_stopped_is_not_held():
    found = judged(INSTANTS[:15])
    assert (found.held, found.drop, found.word, found.status) == (False, None, "stopped", "stopped")
    assert np.isnan(found.force_error)
    assert np.isnan(found.slip_margin)
    assert not judged(INSTANTS[:65]).released


@pytest.mark.parametrize(
    ("away", "why"), [(0.0029, "try more time (phases.release)"), (0.0031, "in the way of fingers")]
)
def test_what_still_touches_is_named(away, why):
    """An object that stands beside its place is touched by fingers that open to 3 mm from there."""
    found = judged(INSTANTS[:65], away=away)
    assert (found.released, found.status) == (False, "not_released")
    assert "finger.1 presses with 5 N in the end" in found.texts["not released"]
    assert why in found.texts["not released"]
    assert found.texts["not released"] in Outcome(PlantVariation(), found).text
    assert judged(INSTANTS, away=away).touching is None


def test_what_was_not_lifted_says_so():
    found = replace(judged(INSTANTS), held=False, refused=NotLifted(2.4, (), "the drive is at its limit"))
    assert (found.word, found.status) == ("not lifted, released", "not_lifted")
    assert found.pairs()["not lifted"] == verdict_data(found)["refused"]["text"] == found.refused.text
    assert found.refused.text in Outcome(PlantVariation(), found).text


def test_what_a_controller_held_that_tripped_is_no_success():
    """Limits of the phases keep a grip at the safe input: what is held is held, and the outcome says how."""
    found = judged(INSTANTS, incidents=((1.4, "mismatch", "tip ..."), (1.8, "tripped", "tip contradicts the model")))
    assert (found.held, found.released, found.succeeded) == (True, True, False)
    assert (found.word, found.status) == ("tripped, held and released", "tripped")
    said = "finger at 1.80 s: tip contradicts the model"
    assert found.pairs()["tripped"] == verdict_data(found)["tripped"]["text"] == said
    run = TrialsResult(load(MUG), (Outcome(PlantVariation(), found), Outcome(PlantVariation(), judged(INSTANTS))))
    assert (run.summary.held, run.summary.succeeded, run.summary.failed) == (2, 1, (0,))
    assert run.to_pandas()["tripped"].to_list() == [said, ""]


def test_outcomes_are_counted_and_written(tmp_path):
    good = judged(INSTANTS)
    refused = NotLifted(2.4, (), "the drive is at its limit")
    bad = replace(good, held=False, refused=refused, sunk=0.05, force_error=0.5, fallbacks=3)
    drawn = runs.variations(Trials(count=4))
    outcomes = [Outcome(v, verdict) for v, verdict in zip(drawn[:3], (good, bad, good), strict=True)]
    outcomes.append(Outcome(drawn[3], None, 'not finite,\n"lost"'))
    run = TrialsResult(load(MUG), tuple(outcomes))
    found = run.summary
    assert_declared(run)
    assert run.to_pandas()["held"].to_list() == [True, False, True, False]
    assert (found.plants, found.held, found.succeeded, found.fallbacks, found.failed) == (4, 2, 2, 3, (1, 3))
    assert (found.force_error_median, found.force_error_worst, found.sunk_worst) == pytest.approx((0.0, 0.5, 0.05))
    assert found.estimate_error_normalized == pytest.approx(0.5 / 0.2)
    with open(run.save(tmp_path / "new") / "trials.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["held"] for row in rows] == ["True", "False", "True", ""]
    assert [row["refused"] for row in rows] == run.to_pandas()["refused"].to_list() == ["", refused.text, "", ""]
    assert float(rows[2]["stiffness"]) == pytest.approx(drawn[2].stiffness)
    assert rows[3]["error"] == 'not finite, "lost"'
    figure = run.plot()
    crosses = [line.get_xdata() for line in figure.axes[0].lines if line.get_marker() == "x"]
    assert [list(x) for x in crosses] == [[drawn[1].stiffness]]


def test_motion_is_drawn_since_the_lift_began():
    from matplotlib.figure import Figure

    t = np.linspace(0.0, 4.0, 81)
    pose = np.stack([t, 2.0 * t, 0.1 * t, 3.0 * t], axis=1)
    mission = SimpleNamespace(t=t, spans=[SimpleNamespace(name="lift", start=1.5)], object_pose=pose)
    axes = Figure().subplots()
    _draw_moved(axes, mission)
    for line, rate in zip(axes.lines, (1.0, 2.0, 3.0), strict=True):
        assert line.get_ydata() == pytest.approx(1e3 * rate * (t - 1.5), abs=1e-9)


# -- end to end -------------------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_a_short_mission_holds_and_lets_go(held, assignment):
    run = held.run
    assert held.verdict.succeeded
    assert held.verdict.fallbacks == 0
    hold, weight, names = held.timetable.span("hold"), 0.3 * 9.81, run.contacts.names
    during = (run.t > hold.start) & (run.t < hold.end)
    bearing = [k for k, name in enumerate(names) if name != "table"]
    assert run.contacts.lift[during][:, bearing].sum(axis=1).mean() == pytest.approx(weight, rel=0.02)
    assert np.all(run.contacts.normal_force[during, names.index("table")] == 0.0)
    stands = run.contacts.normal_force[-1, names.index("table")] + run.contacts.lift[-1, bearing].sum()
    assert stands == pytest.approx(weight, rel=0.02)
    assert held.force_estimate[during[:-1]].mean() == pytest.approx(assignment.force, rel=0.2)
    assert np.nanmax(held.friction_use) < 1.0 + 1e-6
    assert np.all((run.u <= run.u_max + 1e-9) & (run.u >= run.u_min - 1e-9))


@pytest.mark.deep
def test_it_is_saved_reported_and_drawn(held, tmp_path):
    held.save(tmp_path)
    stored, report = read_run(tmp_path), held.report()
    assert stored.meta["verdict"]["held"] is True
    assert [phase["name"] for phase in stored.meta["phases"]] == [span.name for span in held.spans]
    assert stored.arrays["force_estimate"] == pytest.approx(held.force_estimate)
    assert stored.arrays["force_std"] == pytest.approx(held.force_std)
    assert stored.meta["config"]["phases"] == held.mission.phases.model_dump(mode="json")
    assert read_run(tmp_path / "finger").arrays["contact_force_std"].shape == (len(held.run.u), 2)
    assert stored.arrays["pulls"].shape == (6, 3)
    assert_declared(held, stored.arrays)
    assert repr(held).startswith('MissionRun "mug, from approach to release": held and released')
    gaps = held.to_xarray()["contact_gap"].sel(contact="finger.tip")
    assert gaps.values == pytest.approx(held.contacts.gap[:, held.contacts.names.index("finger.tip")])
    # Whether the search proves its optimum within its iterations is a matter of rounding here; it holds either way.
    assert read_run(tmp_path / "grasp").meta["status"] in ("optimal", "feasible")
    assert (tmp_path / "report.txt").read_text() == report
    for word in ("held and released", "mN m about z", "pull 6", "fallbacks"):
        assert word in report
    assert {path.name for path in held.save_pictures(tmp_path)} == {"timeline.png", "snapshots.png"}
    assert held.animate(tmp_path / "a.gif", fps=2).stat().st_size > 10_000


@pytest.mark.deep
def test_a_page_plays_it_back_and_goes_on_with_its_weights(held):
    loop = held.run
    stages = stages_of(loop.scene)
    plant, _ = plant_of_loop(loop.scene, stages, loop.readings.plant)
    record = loop_record(loop, plant)
    np.testing.assert_allclose(record.x[-1], loop.x[-1], rtol=1e-6, atol=1e-9)
    table = plant.system.w_names.index("table_height [m]")
    lowest = loop.w[:, loop.readings.plant.w_names.index("table_height [m]")].min()
    assert min(row[table] for row in record.w) == pytest.approx(lowest, rel=1e-6)
    assert plant.p == pytest.approx(loop.readings.plant.p)
    changes = held.controller_changes(stages)
    starts = {name: held.timetable.span(name).start for name in ("approach", "confirm", "lift", "release")}
    # Contact is confirmed only where contacts bear too little before the lift.
    starts = {name: start for name, start in starts.items() if start < np.inf}
    assert [change["t"] for change in changes] == list(starts.values())
    # A posture is followed until it is there, a force until the object is let go.
    force = [name.startswith("contact_force") and "rate" not in name for name in loop.r_names]
    weights = np.array([change["weights"] for change in changes])
    assert (weights[:, force].max(axis=1) > 0.0).tolist() == [name in ("confirm", "lift") for name in starts]
    with pytest.raises(InputError, match="one finger, not 2"):
        replace(held, runs=(loop, loop)).show()
    with pytest.raises(InputError, match="constant friction"):
        replace(held, variation=PlantVariation(friction_fall=0.3)).show()


@pytest.mark.deep
def test_it_stays_on_the_ground_without_friction_and_repeats_bit_for_bit(runner, held):
    """Other plants in between leave no trace, nor do they change what is read off a run."""
    before = held.run.readings.plant.p
    slipping = runner.run(PlantVariation(friction=0.3))
    assert not np.array_equal(slipping.run.readings.plant.p, before)
    assert np.array_equal(held.run.readings.plant.p, before)
    read = held.run.readings.contacts(held.run.x, np.vstack([held.run.u, held.run.u[-1:]]), held.run.w)
    assert np.array_equal(read.force, held.run.contacts.force)
    assert (slipping.status, slipping.verdict.held, slipping.verdict.sunk) == ("not_lifted", False, 0.0)
    again = runner.run()
    assert np.array_equal(again.run.x, held.run.x)
    assert np.array_equal(again.run.u, held.run.u)
    assert again.verdict == held.verdict


# -- commands and errors ----------------------------------------------------------------------------------------------


def command(monkeypatch, found, *arguments, error=None):
    """``continuum-grasp mpc`` of the mug, with what is computed in its place."""

    def instead(*_, **__):
        if error is not None:
            raise error
        return found

    grasp = SimpleNamespace(statistics={"interrupted": False})
    monkeypatch.setattr("continuum_grasp.grasp.optimize_grasp", lambda scene: grasp)
    monkeypatch.setattr("continuum_grasp.addons.mission.run_mission", instead)
    monkeypatch.setattr("continuum_grasp.addons.mission.run_trials", instead)
    return CliRunner().invoke(app, ["mpc", str(MUG), *map(str, arguments)])


def test_the_command_keeps_what_there_is(monkeypatch, held, tmp_path):
    stop = Interrupted("interrupted after t = 1 s", result=held)
    done = command(monkeypatch, None, "--out", tmp_path / "one", error=stop)
    assert done.exit_code == 130
    assert read_run(tmp_path / "one").meta["verdict"]["held"]
    outcomes = tuple(Outcome(variation, held.verdict) for variation in runs.variations(Trials(count=3)))
    some = TrialsResult(held.mission, outcomes)
    stop = Interrupted("interrupted after 3 of 100 plants", result=some)
    done = command(monkeypatch, None, "--trials", "all", "--out", tmp_path / "many", "--no-pictures", error=stop)
    assert done.exit_code == 130
    assert "3 of 3 plants" in done.output
    assert len((tmp_path / "many/trials.csv").read_text().splitlines()) == 4


def test_the_command_writes_a_bag_of_a_mission(monkeypatch, held, tmp_path):
    """Read back to the bit, with the topics of each finger where there are several."""
    pytest.importorskip("mcap", reason="bags; in the extra 'test'")
    done = command(monkeypatch, held, "--mcap", tmp_path / "mug.mcap", "--out", tmp_path / "one", "--no-pictures")
    assert done.exit_code == 0, done.output
    assert "mug.mcap" in done.output
    (run,) = held.fingers.values()
    table = DataTable.read(tmp_path / "mug.mcap", columns=["/commands.commanded_tension_1", "/measured.tip_x"])
    assert np.array_equal(table.numbers("/commands.commanded_tension_1"), run.u[:, 0])
    assert np.array_equal(table.numbers("/measured.tip_x", gaps=True), run.y[:, 0], equal_nan=True)
    run.write_mcap(tmp_path / "two.mcap", {"left": run, "right": run})
    both = DataTable.read(tmp_path / "two.mcap", columns=[f"/{name}/measured.tip_x" for name in ("left", "right")])
    for name in ("left", "right"):
        assert np.array_equal(both.numbers(f"/{name}/measured.tip_x", gaps=True), run.y[:, 0], equal_nan=True)
    refused = command(monkeypatch, held, "--mcap", tmp_path / "mug.mcap", "--trials", "3", "--out", tmp_path / "many")
    assert refused.exit_code == 2


def test_the_command_of_many_plants_fails_with_one(monkeypatch, held, tmp_path):
    drawn = runs.variations(Trials(count=3))
    some = [Outcome(variation, held.verdict) for variation in drawn[:2]]
    some.append(Outcome(drawn[2], replace(held.verdict, held=False, sunk=0.05)))
    found = TrialsResult(held.mission, tuple(some))
    done = command(monkeypatch, found, "--trials", "3", "--out", tmp_path)
    assert done.exit_code == 1
    assert "2 of 3 plants" in done.output
    assert "plant 3: stiffness" in done.output
    assert "sunk 50 mm" in done.output
    assert (tmp_path / "trials.png").is_file()


def test_trials_stop_on_the_keyboard_with_what_was_done(assignment, grasp, monkeypatch):
    class Runner:
        def __init__(self, assignments, runs):
            self.count = 0

        def run(self, variation):
            self.count += 1
            if self.count == 3:
                raise KeyboardInterrupt
            raise NumericalError("-")

    monkeypatch.setattr(runs, "MissionRunner", Runner)
    with pytest.raises(Interrupted, match="2 of 100") as stopped:
        runs.run_trials(assignment.mission, grasp=grasp, jobs=1)
    assert [outcome.variation for outcome in stopped.value.result] == runs.variations(Trials(count=2))


_DRIVE = "{kind: motor, winch_radius: 0.008, inertia: 2.0e-6, torque_max: 0.5}"
_CABLE = "offset: 0.005, max_tension: 60, axial_stiffness: 1.0e4, series_stiffness: 3.0e4"
_TORQUES = ["drive_tension=null", f"tendons={{{_CABLE}, drive: {_DRIVE}}}"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("grasp.finger.tendons=null", "grasp.finger.tendons"),
        ("grasp.finger.tendons.time_constant=null", "needs a time_constant"),
        (["grasp.gravity=[0.0, 0.0, 0.0]", "grasp.upright=false"], "grasp.gravity: must be"),
        ("grasp.contacts.tip=off", "grasp.contacts.tip: must have"),
        (_TORQUES, r"[^.]tendons: a mission commands"),
        ("more_contacts=[0.3]", r"more_contacts\[0\]: 0.3 m is not before the tip"),
        ("controller.elements=[0, 2]", r"controller.elements\[0\]"),
        ("phases.squeeze_share=0.8", "squeeze_share: needs settle"),
        ("pull=1.0", "pull: unknown key"),
    ],
)
def test_what_makes_no_mission_is_named(change, said):
    with pytest.raises(InputError, match=said):
        load(MUG, change if isinstance(change, list) else [change])


@pytest.mark.deep
@pytest.mark.parametrize("status", ["infeasible", "unstable"])
def test_without_a_grasp_there_is_no_mission(grasp, assignment, status):
    from continuum_grasp.grasp import GraspStatus

    with pytest.raises(SolverError, match="no grasp to carry out") as caught:
        assign(assignment.mission, replace(grasp, status=GraspStatus(status)))
    assert caught.value.status == status


@pytest.mark.parametrize(
    "arguments",
    [("--trials", "few"), ("--trials", "2", "--animate", "gif"), ("--trials", "0")],
)
def test_options_that_do_not_fit_exit_with_2(arguments, tmp_path):
    assert CliRunner().invoke(app, ["mpc", str(MUG), "--out", str(tmp_path), *arguments]).exit_code == 2
