"""Certificates of hands: each check holds at 0.999 of its limit and fails at 1.001; from inside: surfaces of bodies."""

from __future__ import annotations

import math

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.grasp import certify
from continuum_grasp.grasp.hand.body import BodySurface
from continuum_grasp.grasp.hand.surfaces import PlacedSolid
from tests import hand_cases as cases
from tests.hand_cases import EXTENTS, HALF, LENGTH, OFFSET, STIFFNESS

Z = np.array([0.0, 0.0, 1.0])
PRESS, MASS = 2.0, 0.05
EXACT, FOLLOWED, CROSSING = 1e-6, 1e-5, 1e-4
"""Limits of what is stated, of what follows from shapes, and of fingers in each other [1]."""
SIZE = float(np.linalg.norm(0.5 * EXTENTS - 0.004)) + 0.004
BALL = {"shape": "sphere", "diameter": 0.05, "position": (0.0, 0.0, 0.1)}


def pressed(press=PRESS, **more):
    """Two straight fingers press a box without weight along their axes."""
    return cases.squeezed_box(press, 0.0, **more)


def test_a_grasp_in_closed_form_passes():
    certificate = certify(*pressed())
    assert certificate.passed, certificate.worst
    assert certificate.friction_margins == pytest.approx({"left.tip": 1.0, "right.tip": 1.0})
    assert str(len(certificate.checks)) in certificate.headline()


def test_a_beam_of_first_order_is_no_rod():
    """Ends of rods come nearer to their bases as they sag by 1.5 mm."""
    assert "contact gap, left.tip" in {check.name for check in certify(*cases.squeezed_box(PRESS, 0.3)).failed}


def test_torsional_friction_bears_moments_about_normals_within_the_cone():
    """The cone is |friction|^2 + (moment mu / gamma)^2 <= (mu N)^2 with gamma the torsional friction."""
    arm, mass = 1e-3 / 0.5, 1e-4
    scene, arrays = cases.twisted_box(mass=mass)
    certificate = certify(scene, arrays)
    assert certificate.passed, certificate.worst
    force, moment = 0.5 * 9.81 * mass, 0.5 * 1e-3 * 9.81 * mass
    margin = 1.0 - math.hypot(force, moment / arm) / (0.5 * PRESS)
    assert certificate.friction_margins == pytest.approx(dict.fromkeys(("left.tip", "right.tip"), margin), abs=1e-6)
    for missing in (np.zeros(2), arrays["contact_moments"] * [1, -1]):
        failed = {check.name for check in certify(scene, arrays | {"contact_moments": missing}).failed}
        assert "object moment balance" in failed
    without = {name: value for name, value in arrays.items() if name != "contact_moments"}
    assert [check.name for check in certify(scene, without).failed] == ["missing or misshapen arrays"]


# -- limits ------------------------------------------------------------------------------------------------------------


def add(name, index, amount, case=pressed):
    def build(part):
        scene, arrays = case()
        arrays[name][index] += part * amount
        return scene, arrays

    return build


def both(check, name, index, amount, case=pressed):
    return [(check, add(name, index, sign * amount, case)) for sign in (1.0, -1.0)]


def contacts(**changes):
    return lambda part: pressed(**{key: value(part) for key, value in changes.items()})


def sunk(part):
    """A straight finger beside a box, with no contact."""
    base = (HALF - part * FOLLOWED * LENGTH, -0.06, 0.0)
    box = {"shape": "box", "extents": (0.02, 0.02, 0.02), "edge_radius": 0.001, "mass": 0.0, "position": (-0.01, 0, 0)}
    scene = cases.make_scene({"finger": (base, (0, 1, 0), (-1, 0, 0))}, box, {"tip": "auto"})
    return scene, cases.stored(scene, [])


def two(second, direction):
    """Two straight fingers that touch nothing else."""
    bases = {"a": ((0, 0, 0), (0, 1, 0), (-1, 0, 0))}

    def build(part):
        bases["b"] = (np.array(second) - part * CROSSING * LENGTH * Z, direction, (0, 0, 1))
        scene = cases.make_scene(bases, {**cases.AWAY, "position": (-0.05, 0.05, -0.05)}, {"tip": "auto"})
        return scene, cases.stored(scene, [])

    return build


def on_table(name="forces", amount=(0.0, 0.0, 0.0), sunk=0.0, **more):
    """A ball on a table; an array of its contact off by a part of an amount, or the table by a height."""

    def build(part):
        scene, arrays = cases.resting(BALL, [(0.0, 0.0, 0.0)], MASS, **more)
        arrays[f"contact_{name}"][0] += part * np.array(amount)
        table = scene.table.replaced(point=(0.0, 0.0, part * sunk))
        return scene.model_copy(update={"table": table}), arrays  # not checked anew

    return build


def over_rim(part):
    """A cylinder lies against a palm by its upper end; one stored place is beside the disc."""
    tube = {"shape": "cylinder", "diameter": 0.05, "height": 0.08, "edge_radius": 0.003, "position": (0.0, 0.0, -0.1)}
    body = {**tube, "mass": 0.0, "against": "palm"}
    bases = {"finger": ((0.1, 0, 0), (0, 0, -1), (-1, 0, 0))}
    scene = cases.make_scene(bases, body, {"tip": "auto"}, palm={"radius": 0.01})
    at = (0.01 + part * 2.0 * EXACT * scene.object.size, 0.0, 0.0)
    return scene, cases.stored(scene, [("palm_1", at, (0, 0, 1), (0, 0, 0), 0.0, 0.0)])


def over_table(part):
    """A straight finger that comes down to the table with its tip."""
    drop, base = 0.02, np.array([0.1, -0.06, HALF + 0.02 - part * FOLLOWED * LENGTH])
    along = (0, math.sqrt(1.0 - (drop / LENGTH) ** 2), -drop / LENGTH)
    return cases.resting(BALL, [(0.0, 0.0, 0.0)], MASS, base=(base, along, (1, 0, 0)))


WEIGHT = 9.81 * MASS
FULL = math.hypot(PRESS, 0.5 * PRESS)
LIMITS = [
    # Forces along the axis of a finger do not bend it.
    *both("object force balance", "contact_forces", (0, 0), EXACT * PRESS),
    *(("normal force, left.tip", contacts(normal_force_max=lambda part: PRESS - part * EXACT * PRESS)),),
    *(row for k in range(3) for row in
      both("stored numbers, right.tip", "contact_positions", (1, k), EXACT * SIZE)),
    *(row for k in range(3) for row in both("stored numbers, right.tip", "contact_normals", (1, k), EXACT)),
    *both("stored numbers, left.tip", "contact_deflections", 0, EXACT * SIZE),
    *(row for k, unit in ((0, LENGTH), (1, LENGTH), (2, LENGTH), (3, 1.0)) for row in
      both("stored numbers, left", "left.backbone", (30, k), EXACT * unit)),
    ("tendon tension, left", lambda part: add("left.tensions", 0, 60.0 + part * 60.0 * EXACT)(1.0)),
    *(("contact gap, left.tip", lambda part, sign=sign: pressed(body={
        "extents": tuple(EXTENTS + sign * part * 2.0 * FOLLOWED * LENGTH * np.eye(3)[0])})) for sign in (1, -1)),
    ("normal force, table_1",
     on_table(amount=(0.0, 0.0, -WEIGHT * EXACT), contacts={"normal_force_max": WEIGHT})),
    *(("stored numbers, table_1", on_table(key, amount)) for key, amount in
      (("normals", (0, EXACT, 0)), ("deflections", 0.025 * EXACT))),
    ("contact gap, table_1", on_table("positions", (0, 0, 2.0 * EXACT * 0.025))),
    ("contact gap, table_1", on_table(sunk=-2.0 * EXACT * 0.025)),
    ("penetration of the object into a support, table", on_table(sunk=2.0 * EXACT * 0.025)),
    ("contact gap, palm_1", over_rim),
    ("penetration into a support, finger, table", over_table),
    ("penetration into the object, finger", sunk),
    ("overlap of fingers, a, b", two((0, 0.05, 2 * HALF), (0, 1, 0))),
    ("overlap of fingers, a, b", two((-0.05, 0.0601, 2 * HALF), (1, 0, 0))),
    ("overlap of fingers, a, b", two((0, LENGTH, 2 * HALF), (0, 1, 0))),
]  # fmt: skip


@pytest.mark.parametrize(("check", "case"), LIMITS)
def test_a_check_holds_up_to_its_limit_and_no_further(check, case):
    for part, passes in ((0.999, True), (1.001, False)):
        assert certify(*case(part))[check].passed is passes, part


@pytest.mark.parametrize(("touch", "names"), [("off", ["table_1"]), ("on", ["table_1", "table_1"])])
def test_contacts_with_supports_are_those_of_the_scene(touch, names):
    scene, arrays = cases.resting(
        BALL, [(0.0, 0.0, 0.0)] * len(names), MASS, table={"point": (0, 0, 0), "touch": touch}
    )
    arrays["contact_names"] = np.array(names, dtype=str)
    assert not certify(scene, arrays)["contacts match the scene"].passed


def test_a_finger_that_passes_through_itself_is_seen():
    """A tendon bends a finger to a circle."""
    for turn, passes in ((3.0, True), (7.5, False)):
        scene, arrays = cases.one_finger((0, 0, 0), Z)
        arrays["finger.tensions"][0] = turn * STIFFNESS / LENGTH / OFFSET
        assert certify(scene, arrays)["passes through itself, finger"].passed is passes


@pytest.mark.parametrize("names", [["left.tip"], ["left.tip", "left.tip"], ["left.tip", "right.middle"]])
def test_contacts_that_the_scene_does_not_have_are_seen(names):
    scene, arrays = pressed()
    arrays = {key: value[: len(names)] if key.startswith("contact_") else value for key, value in arrays.items()}
    failed = {check.name for check in certify(scene, {**arrays, "contact_names": np.array(names)}).failed}
    assert "contacts match the scene" in failed


# -- surfaces ---------------------------------------------------------------------------------------------------------

TURNED = {"position": (0.01, -0.02, 0.03), "rotation": (0.3, -0.5, 0.9), "mass": 0.1}
BOX = {"shape": "box", "extents": (0.04, 0.05, 0.06), "edge_radius": 0.004}
TUBE = {"shape": "cylinder", "diameter": 0.05, "height": 0.08, "edge_radius": 0.003}
EGG = {"shape": "ellipsoid", "extents": (0.04, 0.06, 0.1)}


def unit(*vector):
    return np.array(vector) / np.linalg.norm(vector)


def egg(direction):
    """Point of an ellipsoid and its normal, by the parameter of its sphere."""
    half = np.array([0.02, 0.03, 0.05])
    return half * direction, unit(*(direction / half))


PLACES = [
    ({"shape": "sphere", "diameter": 0.06}, 0.03 * unit(1, 2, -3), unit(1, 2, -3)),
    *((EGG, *egg(unit(*v))) for v in ((1, 2, -3), (0, 0, 1), (1, 0, 0), (-1, 1, 0.01), (0, -1e-9, 1))),
    (BOX, np.array([0.02, 0.01, -0.02]), np.array([1.0, 0, 0])),
    (BOX, np.array([-0.01, 0.02, -0.03]), np.array([0, 0, -1.0])),
    (BOX, np.array([0.016, -0.021, 0.01]) + 0.004 * unit(1, -2, 0), unit(1, -2, 0)),
    (BOX, np.array([0.016, -0.021, 0.026]) + 0.004 * unit(1, -2, 3), unit(1, -2, 3)),
    (TUBE, np.array([*(0.025 * unit(-3, 4)), 0.02]), unit(-3, 4, 0)),
    (TUBE, np.array([0.01, 0.005, -0.04]), np.array([0, 0, -1.0])),
    (TUBE, np.array([0.022 * 0.6, 0.022 * 0.8, 0.037]) + 0.003 * unit(0.6, 0.8, 2), unit(0.6, 0.8, 2)),
]


@pytest.mark.parametrize(("shape", "place", "normal"), PLACES)
def test_points_off_a_surface_find_the_place_they_left(shape, place, normal):
    scene = cases.make_scene({"finger": ((0, 0, 0.1), (0, 0, -1), (1, 0, 0))}, {**shape, **TURNED})
    body, surface = scene.object, PlacedSolid(scene)
    position = np.array(TURNED["position"])
    for away in (0.05, 1e-4, 0.0, -1e-3):
        near = surface.nearest(position + body.axes @ (place + away * normal))
        assert near.distance == pytest.approx([away], abs=1e-15 + 1e-12 * abs(away))
        np.testing.assert_allclose(near.point[0], position + body.axes @ place, atol=1e-12)
        np.testing.assert_allclose(near.normal[0], body.axes @ normal, atol=1e-9)


@pytest.mark.parametrize("normal", [(0, 0, 1), (1, -2, 0.5)])
@pytest.mark.parametrize("solid", [BALL, BOX, TUBE, EGG])
def test_the_height_over_a_plane_is_that_of_the_support_function(solid, normal):
    normal = np.array(normal) / np.linalg.norm(normal)
    scene = cases.make_scene({"finger": ((0, 0, 0.1), (0, 0, -1), (1, 0, 0))}, {**solid, **TURNED})
    body, local = scene.object, normal @ scene.object.axes
    across = math.hypot(local[0], local[1])
    reach = {
        "sphere": lambda: 0.025,
        "box": lambda: np.abs(local) @ (0.5 * np.array(body.extents) - 0.004) + 0.004,
        "cylinder": lambda: 0.022 * across + 0.037 * abs(local[2]) + 0.003,
        "ellipsoid": lambda: float(np.linalg.norm(0.5 * np.array(body.extents) * local)),
    }[body.shape]()
    point = np.array([0.1, 0.2, -0.1])
    expected = normal @ (np.array(body.position) - point) - reach
    assert PlacedSolid(scene).height(point, normal) == pytest.approx(expected, abs=1e-9)


# -- shapes without closed forms ---------------------------------------------------------------------------------------

STAR = [[-0.03, -0.03], [0.03, -0.03], [0.03, 0.03], [0.0, 0.0], [-0.03, 0.03]]
SWEPT = {
    "cone": {"shape": "cone", "diameter_below": 0.06, "diameter_above": 0.02, "height": 0.05, "edge_radius": 0.002},
    "ring": {"shape": "revolve", "profile": {"shape": "circle", "diameter": 0.02, "position": (0.03, 0.0)}},
    "waist": {},
    "notch": {
        "shape": "extrude",
        "outline": {"shape": "polygon", "vertices": STAR},
        "height": 0.05,
        "edge_radius": 0.003,
    },
    "flattened": {"shape": "superquadric", "extents": (0.05, 0.06, 0.07), "exponents": (3.0, 8.0)},
    "boxy": {"shape": "superquadric", "extents": (0.05, 0.06, 0.07), "exponents": (12.0, 12.0)},
    "knob": {"shape": "mesh", "file": "configs/hand/knob.stl", "scale": 1e-3},
}
"""Objects whose distances the search and the certificate compute by different programs."""


def swept(name):
    shape = SWEPT[name]
    if name == "waist":  # drawings become polygons with the file of a scene
        shape = {"shape": "revolve", "profile": cg.load("configs/hand/bottle.yaml").object.profile}
    return cases.make_scene({"finger": ((0, 0, 0.1), (0, 0, -1), (1, 0, 0))}, {**shape, **TURNED})


def around(scene, count=200):
    points = np.random.default_rng(1).normal(size=(count, 3))
    points *= (0.035 + 0.02 * np.linspace(0.0, 1.0, count) ** 2)[:, None] / np.linalg.norm(points, axis=1)[:, None]
    return np.array(scene.object.position) + points


@pytest.mark.parametrize("name", SWEPT)
def test_search_and_certificate_agree_on_distances_and_normals(name):
    scene = swept(name)
    points = around(scene, 80)
    mine, other = BodySurface(scene).near(points), PlacedSolid(scene).nearest(points)
    outside = mine.distance > 1e-3
    assert np.abs(mine.distance - other.distance)[outside].max() < 1e-12
    assert np.abs(mine.normal - other.normal)[outside].max() < 1e-7
    scanned, _ = BodySurface(scene).distance(points)
    reached = outside & (mine.distance < 0.01)  # farther away, scans of meshes take few samples
    assert np.abs(scanned - mine.distance)[reached].max() < 1e-4 * scene.object.size


@pytest.mark.parametrize("name", SWEPT)
def test_distances_are_those_from_points_of_the_surface(name):
    scene = swept(name)
    corners, triangles = BodySurface(scene).triangles()
    places = corners[triangles]
    # Six points on each triangle: of these, the nearest is half an edge away at most.
    shares = np.array([[i, j, 2 - i - j] for i in range(3) for j in range(3 - i)]) / 2.0
    cloud = np.einsum("sk,tkx->tsx", shares, places).reshape(-1, 3)
    points = around(scene, 15)
    brute = np.array([np.linalg.norm(cloud - point, axis=1).min() for point in points])
    found = BodySurface(scene).near(points).distance
    outside = found > 2e-3
    edge = np.linalg.norm(np.diff(places, axis=1), axis=2).max()
    assert (brute - found)[outside].min() > -1e-4
    assert (brute - found)[outside].max() < edge**2 / 4.0 / 2e-3


@pytest.mark.parametrize("name", SWEPT)
def test_derivatives_of_distances_are_differences(name):
    scene = swept(name)
    surface, points, step = BodySurface(scene), around(scene, 60), 1e-6
    near = surface.near(points)
    slope = np.stack([
        (surface.near(points + step * axis).distance - surface.near(points - step * axis).distance) / (2 * step)
        for axis in np.eye(3)
    ], axis=1)  # fmt: skip
    turning = np.stack([
        (surface.near(points + step * axis).normal - surface.near(points - step * axis).normal) / (2 * step)
        for axis in np.eye(3)
    ], axis=2)  # fmt: skip
    outside = near.distance > 2e-3
    gradient = near.normal if near.slope is None else near.slope
    assert np.median(np.abs(gradient - slope)[outside].max(axis=1)) < 1e-7
    off = np.abs(near.bending - turning)[outside].max(axis=(1, 2))
    # Of a mesh the derivative is made symmetric; at seams of lines and arcs curvatures jump.
    assert np.percentile(off, 80) < (1e-4 if near.slope is None else 1.0)
