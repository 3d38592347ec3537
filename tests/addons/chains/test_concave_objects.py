"""from inside: results are made from arrays; objects of hands as MuJoCo collides them, against exact distances."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

import continuum_grasp as cg
from continuum_grasp.addons.chains.convex_pieces import convex_pieces
from continuum_grasp.grasp import GraspStatus, HandResult
from tests import hand_cases as cases
from tests.marks import few, optional

mujoco = optional("mujoco")
trimesh = optional("trimesh")
RADIUS = 0.006
"""Of a probe, as a finger's."""
PLACE = {"position": (0.01, -0.02, 0.03), "rotation": (0.4, -0.3, 0.8), "mass": 0.05}


@pytest.fixture
def cutter():
    """The library that cuts concave solids, an extra."""
    return pytest.importorskip("manifold3d")


class Probed:
    """The object of an exported hand in MuJoCo, and a ball that can be anywhere."""

    def __init__(self, body):
        scene, arrays = cases.one_finger((0.0, 0.0, 0.0), (0.0, -1.0, 0.0))
        result = HandResult(scene.changed({"object": {**PLACE, **body}}), GraspStatus.FEASIBLE, "", arrays)
        self.solid = result.scene.object
        self.chain = cg.export_mjcf(result, hinges=1)
        ball = f'<body name="probe" mocap="true"><geom type="sphere" size="{RADIUS}" contype="1" conaffinity="0"'
        text = self.chain.text.replace("</worldbody>", f'{ball} margin="0.02" condim="1"/></body></worldbody>')
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_resetDataKeyframe(self.model, self.data, 0)
        self.probe = self.model.body("probe").id

    def touch(self, point):
        """Least distance from the ball at a point of the object's frame, and the outward normal there."""
        self.data.mocap_pos[0] = np.array(self.solid.position) + self.solid.axes @ point
        mujoco.mj_forward(self.model, self.data)
        touching = [c for c in self.data.contact if self.probe in self.model.geom_bodyid[c.geom]]
        contact = min(touching, key=lambda c: c.dist)
        toward = contact.frame[:3] if self.model.geom_bodyid[contact.geom[1]] == self.probe else -contact.frame[:3]
        return contact.dist + RADIUS, self.solid.axes.T @ toward


def prism(points, height):
    """Mesh [mm] over the corners of a polygon."""
    ring = [(x, y) for x, y in points]
    pieces = shapely.constrained_delaunay_triangles(shapely.Polygon(ring)).geoms
    faces = [[ring.index(corner) for corner in piece.exterior.coords[:-1]] for piece in pieces]
    faces = [f if shapely.LinearRing([ring[k] for k in f]).is_ccw else f[::-1] for f in faces]
    count = len(ring)
    corners = [(x, y, z) for z in (0.0, height) for x, y in ring]
    sides = [(k, (k + 1) % count) for k in range(count)]
    if not shapely.LinearRing(ring).is_ccw:
        sides = [(b, a) for a, b in sides]
    walls = [t for a, b in sides for t in ((a, b, b + count), (a, b + count, a + count))]
    caps = [*(f[::-1] for f in faces), *([k + count for k in f] for f in faces)]
    return trimesh.Trimesh(corners, [*caps, *walls], process=False)


def star(rng):
    turns = np.arange(10) * math.pi / 5.0
    sizes = np.where(np.arange(10) % 2, rng.uniform(12.0, 20.0), rng.uniform(24.0, 34.0))
    return prism(list(zip(sizes * np.cos(turns), sizes * np.sin(turns), strict=True)), rng.uniform(30.0, 60.0))


def angle(rng):
    a, b = rng.uniform(12.0, 20.0, 2)
    return prism([(0, 0), (50, 0), (50, a), (b, a), (b, 40), (0, 40)], rng.uniform(20.0, 50.0))


def channel(rng):
    a, b, c = rng.uniform(8.0, 12.0, 3)
    return prism([(0, 0), (50, 0), (50, 45), (50 - a, 45), (50 - a, b), (c, b), (c, 45), (0, 45)], 40.0)


def ring(rng):
    return trimesh.creation.torus(rng.uniform(18.0, 24.0), rng.uniform(6.0, 9.0), major_sections=32, minor_sections=16)


def mug(rng):
    wall, floor = rng.uniform(2.0, 4.0, 2)
    section = [(0, 0), (30, 0), (30, 60), (30 - wall, 60), (30 - wall, floor), (0, floor)]
    return trimesh.creation.revolve(np.array(section, dtype=float), sections=40)


MESHES = {shape.__name__: shape for shape in (star, angle, channel, ring, mug)}


def exact(mesh, points):
    """Distances of points from a mesh, which are outside, and directions from its nearest places."""
    place, apart, _ = trimesh.proximity.closest_point(mesh, points)
    return apart, (points - place) / apart[:, None]


@pytest.mark.parametrize("mirrored", few([False, True], 1))
@pytest.mark.parametrize("name", MESHES)
@pytest.mark.usefixtures("cutter")
def test_a_mesh_collides_as_what_it_is(name, mirrored, tmp_path):
    """Balls that touch random places of it without another place in their way."""
    rng = np.random.default_rng(sorted(MESHES).index(name))
    mesh = MESHES[name](rng)
    assert mesh.is_watertight
    if mirrored:
        mesh.apply_transform(np.diag([-1.0, 1.0, 1.0, 1.0]))
    mesh.fix_normals()
    mesh.export(tmp_path / "part.ply")
    probed = Probed({"shape": "mesh", "file": str(tmp_path / "part.ply"), "scale": 1e-3})
    surface = trimesh.Trimesh(probed.solid.surface.corners, probed.solid.surface.triangles, process=False)
    places, faces = trimesh.sample.sample_surface(surface, 80, seed=1)
    points = np.asarray(places + RADIUS * surface.face_normals[faces])
    distances, normals = exact(surface, points)
    free = distances > RADIUS - 1e-9
    assert free.sum() > 30
    found = [probed.touch(point) for point in points[free]]
    # What is stated holds: 0.5 % of the size, and 0.2 mm.
    off = np.abs([distance for distance, _ in found] - distances[free])
    assert off.max() < min(5e-3 * probed.solid.size, 2e-4)
    turns = np.degrees(np.arccos(np.clip([n @ m for (_, n), m in zip(found, normals[free], strict=True)], -1.0, 1.0)))
    assert np.quantile(turns, 0.9) < (0.1 if name in ("star", "angle", "channel") else 4.0)


@pytest.mark.usefixtures("cutter")
def test_the_star_that_collided_as_its_hull_is_exact():
    """Right: faces of a star lie up to 11 mm inside its convex hull."""
    mesh = star(np.random.default_rng(0))
    pieces = convex_pieces(np.array(mesh.vertices), np.array(mesh.faces), 0.04)
    assert sum(trimesh.convex.convex_hull(piece).volume for piece in pieces) == pytest.approx(mesh.volume, rel=1e-9)
    assert len(pieces) < 8
    assert mesh.convex_hull.volume > 1.2 * mesh.volume


def test_without_the_extra_a_concave_mesh_names_it_and_a_convex_one_needs_none(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "manifold3d", None)
    channel(np.random.default_rng(0)).export(tmp_path / "part.ply")
    with pytest.raises(cg.InputError, match=r"object: it is not convex.*pip install 'continuum-grasp\[mujoco\]'"):
        Probed({"shape": "mesh", "file": str(tmp_path / "part.ply"), "scale": 1e-3})
    trimesh.creation.icosphere(2, radius=25.0).export(tmp_path / "ball.ply")
    probed = Probed({"shape": "mesh", "file": str(tmp_path / "ball.ply"), "scale": 1e-3})
    assert not probed.chain.object_difference
    assert probed.touch([0.0, 0.0, 0.04])[0] == pytest.approx(0.015, abs=1e-6)


@pytest.mark.usefixtures("cutter")
def test_thin_walls_are_no_hollow_to_be_filled():
    """Edges of a hollow between walls of 0.02 mm are nearly on the convex hull."""
    mesh = prism([(0, 0), (40, 0), (40, 30), (39.98, 30), (39.98, 0.02), (0.02, 0.02), (0.02, 30), (0, 30)], 20.0)
    pieces = convex_pieces(np.array(mesh.vertices), np.array(mesh.faces), 0.04)
    assert sum(trimesh.convex.convex_hull(piece).volume for piece in pieces) < 2.0 * mesh.volume


# -- shapes with formulas ----------------------------------------------------------------------------------------------


@pytest.mark.deep
@pytest.mark.usefixtures("cutter")
def test_a_turned_ring_collides_as_a_torus():
    """Closed form: hypot(hypot(x, y) - R, z) - r."""
    profile = {"shape": "circle", "diameter": 0.016, "position": (0.022, 0.0)}
    probed = Probed({"shape": "revolve", "profile": profile})
    for point in np.random.default_rng(3).uniform(-0.04, 0.04, (40, 3)):
        radial = math.hypot(point[0], point[1])
        distance = math.hypot(radial - 0.022, point[2]) - 0.008
        if distance < 1e-3 or distance > 0.02 or abs(radial) < 8e-3:
            continue
        normal = np.array([*(point[:2] / radial * (radial - 0.022)), point[2]])
        found, toward = probed.touch(point)
        assert found == pytest.approx(distance, abs=1e-4)
        assert toward @ normal / np.linalg.norm(normal) > math.cos(math.radians(5.0))
    assert "within 0.0" in probed.chain.object_difference


OUTLINES = {
    "L": [(0.0, 0.0), (0.05, 0.0), (0.05, 0.018), (0.016, 0.018), (0.016, 0.04), (0.0, 0.04)],
    "box": [(0.0, 0.0), (0.05, 0.0), (0.05, 0.04), (0.0, 0.04)],
}


@pytest.mark.parametrize("name", OUTLINES)
def test_an_extruded_outline_collides_with_its_round_edges(name):
    """Shapely's distances from the outline less the radius of its edges, at half the height; no extra is needed."""
    edge = 0.004
    outline = {"shape": "polygon", "vertices": OUTLINES[name]}
    probed = Probed({"shape": "extrude", "outline": outline, "height": 0.05, "edge_radius": edge})
    core = shapely.Polygon(OUTLINES[name]).buffer(-edge, join_style="mitre")
    rng = np.random.default_rng(4)
    checked = 0
    for x, y in rng.uniform(-0.02, 0.07, (60, 2)):
        distance = core.distance(shapely.Point(x, y)) - edge
        if not 1e-3 < distance < 0.02:
            continue
        assert probed.touch(np.array([x, y, 0.0]))[0] == pytest.approx(distance, abs=1e-4)
        checked += 1
    assert checked > 15


# -- hollow bodies -----------------------------------------------------------------------------------------------------


def test_a_hollow_body_weighs_its_walls_and_is_touched_outside(tmp_path):
    outer, inner = np.array([40.0, 30.0, 20.0]), np.array([20.0, 10.0, 8.0])
    hole = trimesh.creation.box(inner)
    hole.apply_translation([5.0, -4.0, 3.0])
    trimesh.util.concatenate([trimesh.creation.box(outer), hole]).export(tmp_path / "part.ply")
    body = {"shape": "mesh", "file": str(tmp_path / "part.ply"), "scale": 1e-3, "mass": None, "density": 2000.0}
    probed = Probed(body)
    whole, void = outer.prod(), inner.prod()
    center = -void / (whole - void) * np.array([5.0, -4.0, 3.0])
    inertia = np.zeros((3, 3))
    for mass, extents, place in ((whole, outer, np.zeros(3)), (-void, inner, np.array([5.0, -4.0, 3.0]))):
        away = place - center
        own = np.diag((extents**2).sum() - extents**2) / 12.0
        inertia += mass * (own + away @ away * np.eye(3) - np.outer(away, away))
    item = probed.model.body("object")
    assert item.mass[0] == pytest.approx(2000.0 * 1e-9 * (whole - void), rel=1e-6)
    turn = Rotation.from_quat(np.roll(item.iquat, -1)).as_matrix()
    assert turn @ np.diag(item.inertia) @ turn.T == pytest.approx(2000.0 * 1e-15 * inertia, rel=1e-5, abs=1e-12)
    assert probed.touch(np.array([1e-3 * (20.0 - center[0]) + 0.01, 0.0, 0.0]))[0] == pytest.approx(0.01, abs=1e-6)
    # In the middle of the cavity, the nearest way out is through the wall.
    assert probed.touch(1e-3 * (np.array([5.0, -4.0, 3.0]) - center))[0] == pytest.approx(-0.007, abs=1e-5)
