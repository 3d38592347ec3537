"""Palm and table of a hand: where objects lie on them, what they carry, and what is said where they do not fit."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import continuum_grasp as cg
from continuum_grasp.base import InputError
from continuum_grasp.grasp import GraspStatus, optimize_grasp

CONFIGS = Path(cg.__file__).parents[1] / "configs/hand"
WEIGHT = 0.08 * 9.81
"""Of the ball [N]."""
BIG = {"object.diameter": 0.09, "object.against": "palm", "hand.ring.radius": 0.06, "hand.palm": {"radius": 0.04}}
BIG |= {"contacts.tip": "off"}
TIPS = {"contacts.middle": "off"}


def hand(name, changes=None):
    return cg.load(CONFIGS / f"{name}.yaml").changed(changes or {})


def carried(grasp, support):
    """Force of palm or table on the object."""
    return -sum((c.force for c in grasp.contacts if c.name.startswith(f"{support}_")), np.zeros(3))


def by_fingers(grasp):
    """Force of the fingers on the object."""
    return -sum(c.force for c in grasp.contacts if c.name.startswith("finger"))


# -- where objects lie ------------------------------------------------------------------------------------------------

POINT = np.array([0.0, 0.0, -0.13])
SOLIDS = [
    {"shape": "sphere", "diameter": 0.06},
    {"shape": "ellipsoid", "extents": [0.04, 0.06, 0.05]},
    {"shape": "cylinder", "diameter": 0.05, "height": 0.06, "edge_radius": 0.004},
    {"shape": "box", "extents": [0.05, 0.06, 0.04], "edge_radius": 0.004},
]


def lying(solid, normal=(0.0, 0.0, 1.0), rotation=(0.0, 0.0, 0.0), position=(0.0, 0.0, -0.08)):
    body = {**solid, "mass": 0.1, "position": list(position), "rotation": list(rotation), "against": "table"}
    return hand("ball", {"object": body, "table": {"point": POINT.tolist(), "normal": list(normal)}})


@pytest.mark.parametrize("solid", SOLIDS)
@pytest.mark.parametrize(("normal", "rotation"), [((0, 0, 1), (0.3, -0.5, 0.9)), ((0.2, -0.3, 1.0), (1.0, 0.2, 0.0))])
def test_an_object_against_a_table_touches_it_with_its_lowest_point(solid, normal, rotation):
    """The lowest one of many random points of the surface, which are above the table by the sine of their spacing."""
    scene = lying(solid, normal, rotation)
    body, up = scene.object, np.array(normal) / np.linalg.norm(normal)
    (contact,) = scene.support_contacts
    rays = np.random.default_rng(0).normal(size=(200_000, 3))
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    if body.shape in ("sphere", "ellipsoid"):
        half = 0.5 * np.array(getattr(body, "extents", [0.06] * 3))
        local = half * rays
    else:  # everything within the radius of the core
        half = 0.5 * np.array(getattr(body, "extents", [0.05, 0.05, 0.06])) - 0.004
        core = np.random.default_rng(1).uniform(-1.0, 1.0, rays.shape)
        if body.shape == "cylinder":
            turn, share = math.pi * core[:, 0], np.where(core[:, 1] > -0.5, 1.0, np.abs(core[:, 1]))
            core = np.stack([share * np.cos(turn), share * np.sin(turn), np.sign(core[:, 2])], axis=1)
        else:
            core = np.sign(core)
        local = half * core + 0.004 * rays
    heights = (np.array(body.position) + local @ body.axes.T - POINT) @ up
    assert -1e-12 < heights.min() < 2e-4 * body.size + 1e-5
    assert (np.array(contact.position) - POINT) @ up == pytest.approx(0.0, abs=1e-12)
    lowest = np.array(body.position) + local[heights.argmin()] @ body.axes.T
    assert np.linalg.norm(lowest - contact.position) < 0.1 * body.size
    # It has moved along the normal alone.
    np.testing.assert_allclose(np.cross(np.array(body.position) - [0, 0, -0.08], up), 0.0, atol=1e-15)


@pytest.mark.parametrize(
    ("solid", "rotation", "points"),
    [
        (SOLIDS[2], (0, 0, 0), [(0.021, 0), (0, 0.021), (-0.021, 0), (0, -0.021)]),
        (SOLIDS[2], (0.5 * math.pi, 0, 0), [(0, 0.026), (0, -0.026)]),
        (SOLIDS[3], (0, 0, 0), [(x, y) for x in (-0.021, 0.021) for y in (-0.026, 0.026)]),
        (SOLIDS[3], (0.4, 0, 0), [(-0.021, None), (0.021, None)]),
        ({**SOLIDS[3], "edge_radius": 0.02}, (0, 0, 0), [(x, y) for x in (-0.005, 0.005) for y in (-0.01, 0.01)]),
        ({**SOLIDS[3], "edge_radius": 0.02}, (0, 0.4, 0), [(None, -0.01), (None, 0.01)]),
    ],
)
def test_faces_and_edges_lie_with_their_corners(solid, rotation, points):
    found = [contact.position for contact in lying(solid, rotation=rotation).support_contacts]
    assert len(found) == len(points)
    for point in points:
        off = [max(abs(a - b) for a, b in zip(point, one, strict=False) if a is not None) for one in found]
        assert min(off) < 1e-12


def test_a_face_reaches_no_further_than_the_disc():
    """A lid of 42 mm on a disc: of 60 mm it is the lid's rim, of 20 mm the disc's; a corner beside it is cut off."""
    can = {**SOLIDS[2], "mass": 0.1, "position": [0.0, 0.0, -0.05], "against": "palm"}
    for radius, expected in ((0.03, 0.021), (0.01, 0.01)):
        scene = hand("ball", {"object": can, "hand.palm": {"radius": radius, "height": -0.02}})
        places = np.array([contact.position for contact in scene.support_contacts])
        assert np.linalg.norm(places[:, :2], axis=1).max() == pytest.approx(expected, rel=1e-12)
        assert len(places) == 4
    box = {**SOLIDS[3], "mass": 0.1, "position": [0.02, 0.01, -0.05], "against": "palm"}
    scene = hand("ball", {"object": box, "hand.palm": {"radius": 0.025, "height": -0.02}})
    places = np.array([contact.position for contact in scene.support_contacts])
    across = np.linalg.norm(places[:, :2], axis=1)
    assert across.max() == pytest.approx(0.025, rel=1e-9)
    corner = np.array([0.02 - 0.021, 0.01 - 0.026])
    assert np.linalg.norm(places[:, :2] - corner, axis=1).min() < 1e-12


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"hand.palm": {"height": -0.063}}, r"hand.palm: the object is 3 mm inside it: .* \[0, 0, -3\] mm"),
        ({"hand.palm": {"height": -0.05, "touch": "on"}}, r"should touch it and is 10 mm away: .* \[0, 0, 10\] mm"),
        ({"hand.palm": {"height": -0.05999}}, "0.01 mm away, too near .* object.against: palm"),
        ({"table": {"point": [0, 0, -0.118], "normal": [0, 0, 2]}}, r"table: the object is 2 mm inside"),
        ({"table": {"point": [0, 0, -0.13], "normal": [0, 0, 0]}}, "normal must not be zero"),
        ({"object.against": "table"}, "object.against: there is no table"),
        ({"hand.palm": {"height": -0.06, "radius": 0.001, "touch": "on"}}, "lies beside the disc"),
        ({"table": {"point": [0, 0, 0.2], "normal": [0, 0, -1], "touch": "on"}}, "table: the object should touch it"),
        ({"hand.palm": {"height": -0.2}, "object.position": [0, 0, -0.25]}, "hand.palm: finger_1 runs into it"),
    ],
)
def test_what_does_not_lie_as_it_should_is_named(changes, said):
    with pytest.raises(InputError, match=said):
        hand("ball", changes)


# -- what they carry --------------------------------------------------------------------------------------------------


def test_a_table_carries_a_box_that_the_fingers_hardly_touch():
    """Fingers press with a hundredth of the weight, from all sides."""
    grasp = optimize_grasp(hand("table", {"gravity": [0, 0, -9.81], "object.rotation": [0, 0, 0], **TIPS}))
    weight = 9.81 * grasp.scene.object.mass
    pressing = [c.normal_force for c in grasp.contacts if c.name.startswith("finger")]
    assert pressing == pytest.approx([0.01 * weight] * 4, rel=1e-4)
    assert carried(grasp, "table")[2] == pytest.approx(weight, rel=4 * 0.01 * 0.6)
    assert carried(grasp, "table") + by_fingers(grasp) == pytest.approx([0, 0, weight], abs=1e-7)
    assert grasp.certificate.passed
    assert grasp.certificate.stable


def test_a_palm_below_carries_the_ball():
    below = optimize_grasp(hand("ball", {**BIG, "gravity": [0, 0, 9.81]}))
    assert carried(below, "palm")[2] == pytest.approx(-WEIGHT, rel=3 * 0.01)
    assert below.certificate.passed
    assert below.certificate.stable


@pytest.mark.deep
def test_a_palm_above_carries_nothing():
    above = optimize_grasp(hand("ball", BIG))
    assert not [name for name in above.contact_names if name.startswith("palm")]
    without = optimize_grasp(hand("ball", {**BIG, "hand.palm.touch": "off"}))
    assert above.tension == pytest.approx(without.tension, rel=5e-3)  # two local optima are 0.2 % apart
    for grasp in (above, without):
        assert grasp.certificate.passed
        assert grasp.certificate.stable


def test_a_table_carries_what_its_friction_and_the_fingers_leave():
    grasp = optimize_grasp(hand("table", TIPS))
    scene = grasp.scene
    x, y, z = carried(grasp, "table")
    assert math.hypot(x, y) <= 0.8 * 0.1 * z + 1e-9
    assert carried(grasp, "table") + by_fingers(grasp) == pytest.approx(
        -np.array(scene.gravity) * scene.object.mass, abs=1e-7
    )
    # Without the fingers it slides: 3 / 9.34 is more than 0.1.
    assert by_fingers(grasp)[0] < -0.1 * scene.object.mass * 9.81
    moment = sum(np.cross(c.position - scene.object.com, -c.force) for c in grasp.contacts)
    assert moment == pytest.approx(np.zeros(3), abs=1e-8)


@pytest.mark.deep
@pytest.mark.parametrize("turn", [(0.4, -0.3, 0.5), (2.0, 1.0, 0.0)])
def test_hand_and_table_that_are_turned_together_need_the_same_tensions(turn):
    straight, rotation = hand("table"), Rotation.from_rotvec(turn)
    bases = {
        name: {key: rotation.apply(getattr(base, key)).tolist() for key in ("position", "direction", "bends_toward")}
        for name, base in straight.hand.named_bases.items()
    }
    body = straight.object
    turned = straight.changed(
        {
            "hand.ring": None,
            "hand.bases": bases,
            "table.point": rotation.apply(straight.table.point).tolist(),
            "table.normal": rotation.apply(straight.table.normal).tolist(),
            "object.position": rotation.apply(body.position).tolist(),
            "object.rotation": (rotation * Rotation.from_rotvec(body.rotation)).as_rotvec().tolist(),
            "gravity": rotation.apply(straight.gravity).tolist(),
        }
    )
    found = optimize_grasp(turned)
    assert len(found.contacts) == len(turned.support_contacts) + 4
    assert found.tension == pytest.approx(optimize_grasp(straight).tension, rel=1e-5)


@pytest.mark.deep
def test_a_mirrored_hand_with_a_palm_needs_the_same_tensions():
    one = optimize_grasp(hand("palm"))
    x, y, z = one.scene.object.position
    other = optimize_grasp(hand("palm", {"object.position": [x, -y, z]}))
    assert other.tension == pytest.approx(one.tension, rel=1e-6)
    assert carried(other, "palm") * [1, -1, 1] == pytest.approx(carried(one, "palm"), abs=1e-6)


@pytest.mark.deep
@pytest.mark.parametrize("name", ["palm", "table"])
def test_shipped_hands_with_supports_hold_and_are_stable(name):
    found = optimize_grasp(hand(name))
    assert found.solved
    assert found.certificate.passed
    assert found.certificate.stable


@pytest.mark.deep
@pytest.mark.parametrize(("name", "tension"), [("palm", 9.0), ("table", 2.5)])
def test_every_reason_with_a_support_repairs(name, tension):
    scene = hand(name, {"hand.finger.tendons.max_tension": tension})
    found = optimize_grasp(scene, raise_on_failure=False)
    assert found.status is GraspStatus.INFEASIBLE, found.message
    assert {reason.key for reason in found.reasons} >= {"hand.finger.tendons.max_tension", "object.mass"}
    for reason in found.reasons:
        repaired = optimize_grasp(scene.changed({reason.key: reason.needed}), raise_on_failure=False)
        assert repaired.solved or (not reason.stable and repaired.status is GraspStatus.UNSTABLE), reason.text
