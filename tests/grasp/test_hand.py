"""Grasps of hands in space: against an independent program, symmetry, and what is said where nothing holds."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import continuum_grasp as cg
from continuum_grasp.base import InputError, SolverError
from continuum_grasp.grasp import GraspStatus, HandResult, Reason, optimize_grasp
from tests.marks import few

CONFIGS = Path(cg.__file__).parents[1] / "configs/hand"


def hand(name, changes=None):
    return cg.load(CONFIGS / f"{name}.yaml").changed(changes or {})


@pytest.fixture(scope="module")
def ball():
    return optimize_grasp(hand("ball"))


def test_a_ball_is_held_with_the_tensions_of_an_independent_program():
    """An independent program of weightless chains of linear curvature, its contacts points on a level surface: 5.580,
    5.645 and 6.191 N (eight elements).
    """
    scene = hand("ball", {"hand.finger.rod.linear_density": 1e-9})
    found = optimize_grasp(scene)
    left = [tensions[0] for tensions in found.tensions.values()]
    assert left == pytest.approx([5.580, 5.645, 6.191], rel=2e-4)
    assert max(tensions[1] for tensions in found.tensions.values()) < 1e-6


def test_three_elements_hold_the_ball_nearly_alike():
    """Each of few elements has two places that stay clear. The same independent program."""
    found = optimize_grasp(hand("ball", {"hand.finger.rod.linear_density": 1e-9, "fidelity.elements": 3}))
    left = [tensions[0] for tensions in found.tensions.values()]
    assert left == pytest.approx([5.580, 5.645, 6.191], rel=2e-3)


def test_forces_balance_the_weight_within_the_cones(ball):
    scene = ball.scene
    total = -sum(contact.force for contact in ball.contacts)
    assert total == pytest.approx([0.0, 0.0, 9.81 * scene.object.mass], abs=1e-8)
    moment = sum(np.cross(c.position - scene.object.position, -c.force) for c in ball.contacts)
    assert moment == pytest.approx(np.zeros(3), abs=1e-9)
    for contact in ball.contacts:
        assert np.linalg.norm(contact.position - scene.object.position) == pytest.approx(0.03, rel=1e-8)
        assert contact.friction_force <= 0.8 * 0.6 * contact.normal_force + 1e-7
    assert ball.certificate.passed
    assert ball.certificate.stable


@pytest.mark.parametrize("turn", few([0.4, 2.0], 1))
def test_a_hand_that_is_turned_with_all_that_it_holds_needs_the_same_tensions(ball, turn):
    rotation = Rotation.from_rotvec([0.0, 0.0, turn])
    other = hand(
        "ball",
        {"hand.ring.start": turn, "object.position": rotation.apply(ball.scene.object.position).tolist()},
    )
    assert optimize_grasp(other).tension == pytest.approx(ball.tension, rel=1e-6)


def test_a_hand_of_another_size_is_as_stable(ball):
    """Eight times as long, E I as L^2: forces as before, and the same least eigenvalue per E I / L."""
    longer = 8.0
    given = ball.scene
    finger = given.hand.finger
    other = given.changed(
        {
            "hand.finger.rod.length": longer * finger.rod.length,
            "hand.finger.rod.bending_stiffness": longer**2 * finger.rod.bending_stiffness,
            "hand.finger.rod.linear_density": finger.rod.linear_density / longer,
            "hand.finger.half_thickness": longer * finger.half_thickness,
            "hand.finger.tendons.offset": longer * finger.tendons.offset,
            "hand.ring.radius": longer * given.hand.ring.radius,
            "object.diameter": longer * given.object.diameter,
            "object.position": [longer * c for c in given.object.position],
        }
    )
    found = optimize_grasp(other)
    assert found.tension == pytest.approx(ball.tension, rel=1e-6)
    assert found.certificate.stability.eigenvalue == pytest.approx(ball.certificate.stability.eigenvalue, rel=1e-5)


@pytest.mark.deep
def test_a_mirrored_hand_needs_the_same_tensions():
    """At the plane y = 0: the first finger lies in it, the others change places."""
    egg = optimize_grasp(hand("egg"))
    x, y, z = egg.scene.object.position
    a, b, c = egg.scene.object.rotation
    other = optimize_grasp(hand("egg", {"object.position": [x, -y, z], "object.rotation": [-a, b, -c]}))
    assert other.tension == pytest.approx(egg.tension, rel=1e-6)


CONE = "hand.finger.rod.sections"


def test_cones_that_carry_tips_hold_a_ball():
    few = {"fidelity.elements": 4, "solver.effort": "quick", "hand.finger.masses": [{"at": 0.12, "mass": 4e-3}]}
    assert optimize_grasp(hand("cones", few)).certificate.passed


@pytest.mark.deep
def test_a_finger_that_hardly_changes_along_its_length_holds_as_a_uniform_one_does():
    """By a thousandth: tensions go with E I, which goes with the fourth power of the diameter."""
    rod = {"length": 0.12, "youngs_modulus": 12e6, "density": 1150.0}
    tendons = [{"offset": offset, "max_tension": 60.0} for offset in (5e-3, -5e-3)]
    changes = {"hand.finger.half_thickness": None, "hand.finger.section": None, "hand.finger.tendons": tendons}
    uniform = optimize_grasp(hand("ball", {**changes, "hand.finger.rod": {**rod, "diameter": 12e-3}}))
    ends = [12e-3 * (1.0 + 5e-4), 12e-3 * (1.0 - 5e-4)]
    graded = optimize_grasp(
        hand("ball", {**changes, "hand.finger.rod": {**rod, "sections": [{"to": 0.12, "diameter": ends}]}})
    )
    assert graded.tension == pytest.approx(uniform.tension, rel=2e-3)
    assert graded.certificate.stability.eigenvalue == pytest.approx(uniform.certificate.stability.eigenvalue, rel=0.01)


@pytest.mark.deep
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {CONE: [{"to": 0.06, "diameter": 13e-3}, {"to": 0.12, "diameter": 10e-3}], "hand.finger.half_thickness": 6e-3},
        {CONE: [{"to": 0.12, "diameter": [10e-3, 12e-3]}], "hand.finger.half_thickness": 7e-3},
        {"hand.finger.masses": [{"at": 0.12, "mass": 4e-3}]},
        {"fidelity.elements": 5, "hand.ring.count": 4},
    ],
    ids=["cones", "steps", "stiffer tips", "tip masses", "four of five elements"],
)
def test_fingers_that_change_along_their_length_hold(changes):
    """The certificate integrates stiffness, thickness and masses anew."""
    found = optimize_grasp(hand("cones", changes))
    assert found.certificate.passed


@pytest.mark.deep
def test_a_mass_on_the_tip_is_that_of_a_heavy_end():
    """4 g on the tip, and in the last millimeter."""
    mass, part = 4e-3, 1e-3
    light = 1150.0 * math.pi / 4.0 * (12e-3) ** 2
    rod = {"length": 0.12, "sections": [
        {"to": to, "bending_stiffness": 0.012, "linear_density": density}
        for to, density in ((0.12 - part, light), (0.12, light + mass / part))
    ]}  # fmt: skip
    with_rod = {"hand.finger.rod": rod, "hand.finger.section": {"shape": "round"}, "hand.finger.half_thickness": 6e-3}
    heavy = optimize_grasp(hand("ball", with_rod))
    even = {"length": 0.12, "bending_stiffness": 0.012, "linear_density": light}
    with_mass = {**with_rod, "hand.finger.rod": even, "hand.finger.masses": [{"at": 0.12, "mass": mass}]}
    assert optimize_grasp(hand("ball", with_mass)).tension == pytest.approx(heavy.tension, rel=1e-3)


@pytest.mark.deep
@pytest.mark.parametrize("name", ["can", "lying_can", "box", "egg"])
def test_shipped_hands_hold_and_are_stable(name):
    found = optimize_grasp(hand(name))
    assert found.solved
    assert found.certificate.passed
    assert found.certificate.stable


@pytest.mark.deep
def test_round_fingers_that_turn_the_can_away_are_no_grasp():
    """Tips that press with N at a radius r turn the object where their stiffness to the side k is below N / r."""
    found = optimize_grasp(hand("can", {"hand.finger.section": {"shape": "round"}}), raise_on_failure=False)
    assert found.status is not GraspStatus.FEASIBLE
    ignored = hand("can", {"hand.finger.section": {"shape": "round"}, "stability": "ignore"})
    found = optimize_grasp(ignored, raise_on_failure=False)
    if found.solved:
        assert not found.certificate.stable


def test_names_and_order_of_fingers_do_not_matter():
    scene = hand("pinch")
    tension = optimize_grasp(scene).tension
    bases = list(scene.hand.ring.bases)
    # Numbers of the problem are called grip, weight, tolerance and stability level.
    for names, order in ((("grip", "gripper_2"), bases), (("weight", "stability"), bases[::-1])):
        named = scene.replaced(hand=scene.hand.replaced(ring=None, bases=dict(zip(names, order, strict=True))))
        assert optimize_grasp(named).tension == pytest.approx(tension, rel=1e-6)


def test_little_torsional_friction_promises_no_less_than_none(ball):
    """In MuJoCo the ball withstands 80 % of what points promise with 0.1 and with 3 mm too."""
    soft = optimize_grasp(hand("ball", {"contacts.torsional_friction": 1e-6}))
    for name, promised in ball.certificate.promise.items():
        assert soft.certificate.promise[name] >= 0.999 * promised


@pytest.mark.deep
def test_too_little_friction_is_named_where_contacts_bear_moments_too():
    """With relaxed friction no more of a moment is borne, as in the scene with that friction."""
    slippery = hand("pinch", {"contacts.friction": 0.3, "contacts.torsional_friction": 1.5e-3})
    found = optimize_grasp(slippery, raise_on_failure=False)
    assert [reason.key for reason in found.reasons] == ["contacts.friction"]
    assert "about the line through them" not in found.advice


@pytest.mark.deep
def test_two_fingers_that_touch_once_each_get_advice():
    """Nothing holds the object against turns about the line through two points."""
    pair = hand("ball", {"hand.ring.count": 2, "contacts.middle": "off"})
    found = optimize_grasp(pair, raise_on_failure=False)
    assert not found.solved
    assert "free to turn about the line through them" in found.advice


@pytest.mark.deep
def test_pads_with_torsional_friction_pinch_what_points_do_not():
    """The same two fingers, without that friction, hold nothing stably; with it a larger part of the cone is used."""
    pinched = optimize_grasp(hand("pinch"), raise_on_failure=False)
    assert pinched.status is GraspStatus.FEASIBLE
    moments = [abs(contact.moment) for contact in pinched.contacts]
    assert 1e-4 < max(moments) <= 2.5e-3 * max(contact.normal_force for contact in pinched.contacts)
    assert not optimize_grasp(hand("pinch", {"contacts.torsional_friction": 0.0}), raise_on_failure=False).solved


@pytest.mark.deep
def test_kinds_of_contacts_may_differ_between_fingers():
    """A box off the axis of three fingers, which neither three middle contacts nor three tips hold."""
    box = {"shape": "box", "extents": [0.0667, 0.0806, 0.0806], "edge_radius": 5e-3, "mass": 0.207}
    box["position"] = [2.1e-3, -3.7e-3, -0.0718]
    ring = {"hand.ring.radius": 0.0543, "hand.ring.tilt": 0.0375, "hand.finger.section.width": 6e-3}
    found = optimize_grasp(hand("ball", {"object": box, **ring}), raise_on_failure=False)
    assert found.solved
    kinds = {name.partition(".")[2] for name in found.contact_names}
    assert kinds == {"middle", "tip"}
    for kind in kinds:
        other = {"contacts.middle": "off", "contacts.tip": "off", f"contacts.{kind}": "on"}
        assert not optimize_grasp(hand("ball", {"object": box, **ring, **other}), raise_on_failure=False).solved


@pytest.mark.deep
def test_every_reason_repairs():
    heavy = hand("ball", {"object.mass": 2.0})
    found = optimize_grasp(heavy, raise_on_failure=False)
    assert found.status is GraspStatus.INFEASIBLE
    assert found.reasons
    for reason in found.reasons:
        repaired = optimize_grasp(heavy.changed({reason.key: reason.needed}), raise_on_failure=False)
        assert repaired.solved or (not reason.stable and repaired.status is GraspStatus.UNSTABLE), reason.text
    with pytest.raises(SolverError, match=r"needed|can be held"):
        optimize_grasp(heavy)


def test_what_is_no_grasp_is_read_back_as_such(ball, tmp_path):
    """Its numbers are those of a repair: they are named so, nothing certifies them, and there is nothing to export."""
    why = "the object is too heavy: 3 kg, 0.243 kg can be held"
    reason = Reason("mass", "object.mass", "kg", 3.0, 0.243, why, "object.mass = 0.243 kg")
    heavy = ball.scene.changed({"object.mass": 3.0})
    failed = HandResult(heavy, GraspStatus.INFEASIBLE, why, ball.arrays, None, (reason,), trial={"words": "lost"})
    again = HandResult.of_run(failed.save(tmp_path / "run"))
    assert again.reasons == failed.reasons
    assert again.certificate is None
    assert again.table() == failed.table()
    assert "With the first repair:" in again.table()
    with pytest.raises(InputError, match="there is no grasp to export: the object is too heavy"):
        cg.export_mjcf(again)


def test_a_grasp_is_read_back_with_its_trial(ball, tmp_path):
    tried = replace(ball, trial={"holds": True, "words": "held in MuJoCo"})
    again = HandResult.of_run(tried.save(tmp_path / "run"))
    assert again.trial == tried.trial
    assert again.table() == tried.table()


def test_a_section_shows_the_hole_of_a_ring(ball, tmp_path):
    """In the plane of a finger: within the hole the picture is white."""
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.torus(24.0, 6.0).export(tmp_path / "ring.stl")
    center = np.array(ball.scene.object.position)
    base = ball.scene.hand.named_bases["finger_1"]
    normal = np.cross(base.direction, base.bends_toward)
    turned = Rotation.align_vectors([normal], [[0.0, 0.0, 1.0]])[0].as_rotvec().tolist()
    body = f"shape: mesh, file: {tmp_path / 'ring.stl'}, scale: 1 mm, mass: 80 g, position: {center.tolist()}"
    drawn = replace(ball, scene=cg.load(CONFIGS / "ball.yaml", [f"object={{{body}, rotation: {turned}}}"])).plot()
    ax = next(ax for ax in drawn.axes if ax.get_title(loc="left").startswith("finger_1"))
    canvas = ax.figure.canvas
    canvas.draw()
    shown = np.asarray(canvas.buffer_rgba())
    along = np.array(base.direction)

    def white(radius):
        at = center - base.position + 1e-3 * radius * along
        across = np.cross(normal, along)
        column, row = ax.transData.transform(1e3 * np.array([-at @ across, at @ along])).round().astype(int)
        return shown[shown.shape[0] - row, column, :3].min() > 250

    assert [white(radius) for radius in (-25.0, 0.0, 15.0, 24.0)] == [False, True, True, False]


MOTOR = {"kind": "motor", "winch_radius": 8e-3, "inertia": 2e-6, "coulomb_friction": 2e-3, "torque_max": 0.5}
SERVO = {**MOTOR, "position_gain": 2.0, "rate_gain": 4e-3}
WINCH = {"kind": "length", "time_constant": 0.03}


def driven(drive, **more):
    tendons = {"offset": OFFSET, "max_tension": 60.0, "axial_stiffness": 1e4, "series_stiffness": 3e4, "drive": drive}
    return hand("ball", {"hand.finger.tendons": tendons, **more})


OFFSET = 6e-3


@pytest.mark.parametrize(
    "drive",
    [
        MOTOR,
        SERVO,
        WINCH,
        pytest.param({**WINCH, "arrangement": "one_pulley", "pretension": 5.0}, marks=pytest.mark.deep),
        pytest.param({**MOTOR, "arrangement": "one_pulley", "pretension": 5.0}, marks=pytest.mark.deep),
    ],
    ids=["motors", "servos", "winches", "winches on one pulley", "motors on one pulley"],
)
def test_drives_wind_up_what_the_bend_draws_in_and_tendons_yield(drive, ball):
    """Of tendons beside the line at constant distance the path is the distance times the turn of the tip."""
    found = optimize_grasp(driven(drive))
    compliance = 1.0 / 3e4 + 0.12 / 1e4
    for name, (left, right) in found.tensions.items():
        turn = found.arrays[f"{name}.backbone"][-1, 3]
        wound = OFFSET * turn + left * compliance
        state = found.drives[name][0]
        if "pretension" in drive:
            assert left + right == pytest.approx(2.0 * 5.0, rel=1e-3)
            wound -= 5.0 * compliance
        assert state.position * (8e-3 if "winch_radius" in drive else 1.0) == pytest.approx(wound, rel=1e-6)
        if "winch_radius" in drive:
            pull = left - right if "pretension" in drive else left
            assert state.torque == pytest.approx(8e-3 * pull, rel=1e-5)
    locks = drive["kind"] == "length" or "position_gain" in drive
    assert ("locked drives" in found.table()) is locks
    if "pretension" not in drive:
        assert found.tension == pytest.approx(ball.tension, rel=1e-6)
        # Springs of the tendons stiffen fingers in their planes alone.
        stability = found.certificate.stability.eigenvalue, ball.certificate.stability.eigenvalue
        assert stability[0] > 1.1 * stability[1] if locks else stability[0] == pytest.approx(stability[1], rel=1e-5)


def test_tendon_friction_takes_no_more_than_a_capstan_does(ball):
    """Tensions fall along the finger by exp(-friction * turn) at most, and less where it has turned less."""
    friction = 0.1
    tendons = {"hand.finger.tendons.friction": friction, "friction_states": "pulled"}
    found = optimize_grasp(hand("ball", tendons))
    for name, (left, _) in found.tensions.items():
        turn = abs(found.arrays[f"{name}.backbone"][-1, 3])
        assert 1.0 < left / ball.tensions[name][0] < math.exp(friction * turn)
    assert found.certificate.passed
    assert "other friction states are not tested" in found.table()
    with pytest.raises(InputError, match="state friction_states: pulled"):
        hand("ball", {"hand.finger.tendons.friction": friction})


@pytest.mark.deep
def test_the_torque_that_a_motor_lacks_is_named():
    weak = driven({**SERVO, "torque_max": 0.03})
    found = optimize_grasp(weak, raise_on_failure=False)
    assert found.status is GraspStatus.INFEASIBLE
    reason = next(reason for reason in found.reasons if reason.name == "tension")
    assert (reason.key, reason.unit, reason.limit) == ("hand.finger.tendons.drive.torque_max", "N m", 0.03)
    assert optimize_grasp(weak.changed({reason.key: reason.needed})).solved
    assert not optimize_grasp(weak.changed({reason.key: 0.98 * reason.needed}), raise_on_failure=False).solved


OWN = {
    "position": [0.045, 0.0, 0.0],
    "direction": [0.0, 0.0, -1.0],
    "bends_toward": [-1.0, 0.0, 0.0],
    "finger": {
        "rod": {"length": 0.12, "diameter": 0.012, "youngs_modulus": 10e6, "density": 1150.0},
        "tendons": {"offset": 6e-3, "max_tension": 60.0},
        "masses": [{"at": 0.06, "mass": 0.01}],
    },
}


@pytest.mark.deep
def test_a_finger_that_alone_is_too_weak_is_named(ball):
    """The others bear ten times as much, and stay."""
    scene = ball.scene
    weak = scene.hand.finger.replaced(tendons=scene.hand.finger.tendons.replaced(max_tension=3.0))
    one, two, three = scene.hand.ring.bases
    bases = {"one": one, "two": two, "three": three.replaced(finger=weak)}
    mixed = scene.replaced(hand=scene.hand.replaced(ring=None, bases=bases))
    found = optimize_grasp(mixed, raise_on_failure=False)
    reason = next(reason for reason in found.reasons if reason.name == "tension")
    assert (reason.key, reason.limit) == ("hand.bases.three.finger.tendons.max_tension", 3.0)
    assert reason.needed < ball.tensions["finger_3"][0]
    assert reason.repair == f"{reason.key} = {reason.needed:.3g} N"
    assert optimize_grasp(mixed.changed({reason.key: reason.needed})).solved


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"object.position": [2.0, 3.0, -90.0]}, "cannot reach the object: .* in meters"),
        ({"hand.ring.radius": 0.005}, "bases of finger_1 and finger_2 overlap"),
        ({"hand.finger.section": None}, "section is needed"),
        ({"hand.finger.base": {"position": [0.1, 0.0]}}, "base: the hand has the bases"),
        ({"hand.ring": None}, "exactly one of ring and bases"),
        ({"object": {"shape": "sphere", "diameter": 0.06, "position": [0.0, 0.0, -0.09]}}, "give mass, or density"),
        (
            {
                "object": {
                    "shape": "box",
                    "extents": [0.06] * 3,
                    "edge_radius": 0.04,
                    "mass": 0.1,
                    "position": [0, 0, 0],
                }
            },
            "edge_radius = 0.04 m: expected",
        ),
        ({"contacts.middle": "off", "contacts.tip": "off"}, "at least one of middle and tip"),
        ({"contacts.friction": 0.0}, "contacts.friction: 0 for finger_1: expected at least 0.001"),
        ({"hand.finger.contacts": {"friction": 0.0}}, "contacts.friction: 0 for finger_1"),
        ({"hand.finger.masses": [{"at": 0.06, "mass": 0.01}]}, "masses at their tips"),
        ({"hand.finger.contacts": {"stations": 3}}, "hand.finger.contacts.stations: hands touch with middle and tip"),
        ({"hand.finger.contacts": {"middle": ["on", "on"]}}, "hand.finger.contacts.middle: .* has one middle contact"),
        ({"hand.finger.contacts": {"middle_range": [0.05, 0.13]}}, "hand.finger.contacts.middle_range ends at 0.13 m"),
        ({"hand.finger.fidelity": {"tolerance": 0.01}}, "hand.finger.fidelity.tolerance: hands have a number"),
        ({"hand.finger.fidelity": {"elements": 1}}, "hand.finger.fidelity.elements: 1 leave no element"),
        (
            {"hand.finger.fidelity": {"family": "matched_clothoid"}, "hand.finger.tendons.friction": 0.1},
            "hand.finger.fidelity.family: matched_clothoid cannot carry tendon friction",
        ),
        ({"hand.ring": None, "hand.bases": {"one": OWN}}, "hand.bases.one.finger.masses: a hand takes only"),
        # Descriptions end with a clause, not with a line.
        (
            {"hand.ring": None, "hand.bases": {"one": {"position": [0.045, 0.0, 0.0], "direction": [0.0, 0.0, -1.0]}}},
            "bends_toward: missing; expected direction of the bend when the left tendon pulls, of any length$",
        ),
        ({"gravity": {"all": 9.81}}, r"gravity: expected \[x, y, z\] as the hand sees it, .* or any: 9.81"),
        ({"contacts.torsional_friction": 3.0}, "torsional_friction: 3 m is more than .* 0.018 m: is it in meters"),
    ],
)
def test_what_is_no_hand_is_named(changes, said):
    with pytest.raises(InputError, match=said):
        hand("ball", changes)


@pytest.mark.parametrize(
    ("solid", "volume"),
    [
        ({"shape": "sphere", "diameter": 0.06}, 4.0 / 3.0 * math.pi * 0.03**3),
        ({"shape": "ellipsoid", "extents": [0.04, 0.06, 0.1]}, 4.0 / 3.0 * math.pi * 0.02 * 0.03 * 0.05),
        ({"shape": "cylinder", "diameter": 0.06, "height": 0.1, "edge_radius": 0.01}, None),
        ({"shape": "box", "extents": [0.06, 0.08, 0.1], "edge_radius": 0.01}, None),
    ],
)
def test_mass_follows_from_density(solid, volume):
    """Of shapes with rounded edges, by points drawn at random in the box about them: 1 % at three deviations."""
    body = hand("ball", {"object": {**solid, "density": 1000.0, "position": [0.0, 0.0, -0.08]}}).object
    if volume is None:
        half = 0.5 * np.array(solid.get("extents", [0.06, 0.06, 0.1]))
        points = np.abs(np.random.default_rng(0).uniform(-half, half, (400_000, 3)))
        core = half - 0.01
        if body.shape == "cylinder":
            beyond = np.stack([np.hypot(points[:, 0], points[:, 1]) - core[0], points[:, 2] - core[2]])
        else:
            beyond = (points - core).T
        inside = np.linalg.norm(np.maximum(beyond, 0.0), axis=0) <= 0.01
        volume = inside.mean() * float(np.prod(2.0 * half))
    assert body.weighed == pytest.approx(1000.0 * volume, rel=2e-3)


def test_sections_are_as_stiff_as_their_shape():
    """A square bar: 0.1406 a^4 and a^4 / 12 (S. Timoshenko); round ones J = 2 I; a thin strip w t^3 / 3 = 4 I."""
    square = hand("ball", {"hand.finger.section": {"shape": "rectangle", "thickness": 0.002, "width": 0.002}})
    section = square.setups[0].finger.cross_section
    assert (section.lateral, section.torsion) == (1.0, pytest.approx(12 * 0.140577 / 2.7, rel=1e-4))
    round_one = hand("ball", {"hand.finger.section": {"shape": "round"}}).setups[0].finger.cross_section
    assert (round_one.lateral, round_one.torsion) == (1.0, pytest.approx(2.0 / 2.7))
    strip = {"shape": "rectangle", "thickness": 0.001, "width": 0.1}
    thin = hand("ball", {"hand.finger.section": strip}).setups[0].finger.cross_section
    assert (thin.lateral, thin.torsion) == (pytest.approx(1e4), pytest.approx(4.0 * (1 - 0.63 / 100) / 2.7, rel=1e-4))


@pytest.mark.deep
def test_a_ball_of_triangles_and_a_turned_circle_are_held_as_the_ball_is(ball, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.icosphere(3, radius=30.0).export(tmp_path / "ball.stl")
    place = f"mass: 80 g, position: {[float(v) for v in ball.scene.object.position]}"
    total = sum(float(pair.sum()) for pair in ball.tensions.values())
    for shape, share in (
        (f"shape: mesh, file: {tmp_path / 'ball.stl'}, scale: 1 mm", 0.01),
        ("shape: revolve, profile: {shape: circle, diameter: 60 mm}", 1e-5),
        ("shape: superquadric, extents: [60 mm, 60 mm, 60 mm], exponents: [2, 2]", 1e-5),
    ):
        other = optimize_grasp(cg.load(CONFIGS / "ball.yaml", [f"object={{{shape}, {place}}}"]))
        assert other.certificate.passed
        assert sum(float(pair.sum()) for pair in other.tensions.values()) == pytest.approx(total, rel=share)


@pytest.mark.deep
@pytest.mark.parametrize("name", ["bottle", "knob"])
def test_hollow_and_drawn_objects_are_held_stable_and_certified(name):
    assert optimize_grasp(hand(name)).certificate.passed


def test_a_hand_without_reserve_says_that_a_slight_push_may_make_it_slip():
    at_the_edge, with_reserve = (optimize_grasp(hand("ball", {"contacts.reserve": reserve})) for reserve in (0.0, 0.2))
    assert "give contacts.reserve" in at_the_edge.message
    assert at_the_edge.certificate.promised((1.0, 0.0, 0.0, 0.0, 0.0, 0.0)) < 1e-3 * at_the_edge.scene.weight
    assert "reserve" not in with_reserve.message


def test_arcs_cannot_follow_a_finger_that_tapers():
    with pytest.raises(cg.InputError, match=r"fidelity\.family: elements of family arc cannot follow"):
        hand("cones", {"fidelity.family": "arc"})
