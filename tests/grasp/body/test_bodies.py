"""Distances, normals and curvatures of bodies; from inside: no door of grasps tells them.

Truths are shapely in the plane and in half planes of solids of revolution, support functions of convex bodies, closed
forms of curvatures, trimesh for triangles, and finite differences.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
import trimesh
from pydantic import TypeAdapter

from continuum_grasp.grasp.body.bodies import body_of
from continuum_grasp.grasp.body.mesh_surface import MeshSurface
from continuum_grasp.scene import GraspObject, HandScene

AT = {"mass": 0.1, "position": (0.02, -0.01), "angle": 0.3}
HOOK = ((0.0, 0.0), (0.06, 0.01), (0.02, 0.02), (0.05, 0.06), (0.01, 0.04))
EGG = [(0.03 * math.cos(t) + 0.004 * math.cos(2 * t), 0.02 * math.sin(t)) for t in np.linspace(0, 6.2, 60)]
PLANE = {
    "circle": {"shape": "circle", "diameter": 0.06},
    "box": {"shape": "box", "width": 0.07, "height": 0.04},
    "rounded box": {"shape": "box", "width": 0.07, "height": 0.04, "corner_radius": 0.008},
    "hook": {"shape": "polygon", "vertices": HOOK},
    "arcs": {"shape": "polygon", "vertices": EGG},
    "stadium": {"shape": "stadium", "length": 0.05, "radius": 0.015},
    "ellipse": {"shape": "ellipse", "width": 0.08, "height": 0.03},
    "superellipse": {"shape": "superellipse", "width": 0.05, "height": 0.08, "exponent": 4.0},
    "mug": {
        "shape": "union",
        "center_of_mass": (0.0, 0.0),
        "members": (
            {"shape": "circle", "diameter": 0.05},
            {"shape": "box", "width": 0.03, "height": 0.01, "position": (0.035, 0.0), "angle": 0.2},
        ),
    },
}
CORNERED = ("box", "hook", "mug")
SOLIDS = {
    "ball": {"shape": "sphere", "diameter": 0.06},
    "can": {"shape": "cylinder", "diameter": 0.06, "height": 0.09, "edge_radius": 0.005},
    "capsule": {"shape": "cylinder", "diameter": 0.06, "height": 0.09, "edge_radius": 0.03},
    "box": {"shape": "box", "extents": (0.05, 0.06, 0.08), "edge_radius": 0.004},
    "egg": {"shape": "ellipsoid", "extents": (0.03, 0.06, 0.1)},
    "pillow": {"shape": "superquadric", "extents": (0.05, 0.06, 0.03), "exponents": (4.0, 3.0)},
    "cone": {"shape": "cone", "diameter_below": 0.07, "diameter_above": 0.03, "height": 0.08, "edge_radius": 0.004},
    "ring": {"shape": "revolve", "profile": {"shape": "circle", "diameter": 0.02, "position": (0.03, 0.0)}},
    "angle": {
        "shape": "extrude",
        "outline": {"shape": "polygon", "vertices": HOOK},
        "height": 0.06,
        "edge_radius": 0.002,
    },
}


def planar(name, **changed):
    return TypeAdapter(GraspObject).validate_python(PLANE[name] | AT | changed)


def solid(described):
    where = {"mass": 0.1, "position": (0.0, 0.0, 0.1), "rotation": (0.1, 0.2, 0.3)}
    return TypeAdapter(HandScene.model_fields["object"].annotation).validate_python(described | where)


def bodies():
    return [
        *(pytest.param(body_of(planar(name)), id=name) for name in PLANE),
        *(pytest.param(body_of(solid(described)), id=name) for name, described in SOLIDS.items()),
    ]


def around(body, count=300, least=-math.inf, seed=0):
    """Points around a body, no deeper in it than some distance."""
    low, high = body.box
    points = np.random.default_rng(seed).uniform(low - 0.02, high + 0.02, (6 * count, body.dimensions))
    return points[body.distance(points) > least][:count]


def by_shapely(shape, points):
    """Signed distances of points from a polygon of shapely."""
    places = shapely.points(points)
    return np.where(shapely.contains(shape, places), -1.0, 1.0) * shapely.distance(shape.exterior, places)


def grown(part):
    """A part with an offset as a polygon of shapely: its core, and the radius."""
    core = part.vertices
    kind = shapely.Point if len(core) == 1 else shapely.LineString if len(core) == 2 else shapely.Polygon
    return kind(core[0]) if len(core) == 1 else kind(core), part.radius


# -- in the plane -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["circle", "box", "rounded box", "hook", "stadium"])
def test_distances_of_offset_polygons_are_those_of_shapely(name):
    described = planar(name)
    body = body_of(described)
    core, radius = grown(described.parts[0])
    points = around(body, 600)
    places = shapely.points(points)
    depth = shapely.distance(core.boundary, places) if core.geom_type == "Polygon" else 0.0
    expected = np.where(shapely.contains(core, places), -depth, shapely.distance(core, places)) - radius
    assert body.distance(points) == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(("name", "count"), [("ellipse", 40_000), ("superellipse", 40_000), ("arcs", 0)])
def test_distances_of_curves_are_those_of_fine_polygons(name, count):
    described = planar(name)
    part = described.parts[0]
    if count:
        line = part.outline(count)
    else:
        assert any(face.turn for face in part.faces)
        line = [
            (face.center[0] + face.radius * math.cos(t), face.center[1] + face.radius * math.sin(t))
            if face.turn
            else face.start
            for face in part.faces
            for t in np.linspace(face.normal, face.normal + face.turn, 200)
        ]
    points = around(body_of(described))
    expected = by_shapely(shapely.Polygon(line), points)
    assert body_of(described).distance(points) == pytest.approx(expected, abs=2e-9)


def test_the_distance_from_a_union_is_the_least_and_exact_outside():
    described = planar("mug")
    body = body_of(described)
    handle = described.parts[1]
    whole = shapely.union(shapely.Point(0, 0).buffer(0.025, 2000), shapely.Polygon(handle.vertices))
    points = around(body, 600)
    expected = by_shapely(whole, points)
    outside = expected > 0.0
    assert outside.sum() > 200
    assert body.distance(points)[outside] == pytest.approx(expected[outside], abs=1e-8)
    # Inside, where parts overlap, the surface is no nearer.
    assert (body.distance(points) >= expected - 1e-8).all()


@pytest.mark.parametrize(("mirror", "turn"), [(True, 0.0), (False, 0.5 * math.pi), (True, 2.1)])
def test_images_of_an_outline_have_images_of_its_distances(mirror, turn):
    image = np.array([[-1.0 if mirror else 1.0, 0.0], [0.0, 1.0]])
    image = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]]) @ image
    body = body_of(planar("hook", corner_radius=0.001))
    other = body_of(planar("hook", vertices=(np.array(HOOK) @ image.T).tolist(), corner_radius=0.001))
    points = around(body)
    one, two = body.near(points), other.near(points @ image.T)
    assert two.distance == pytest.approx(one.distance, abs=1e-16)
    assert two.normal == pytest.approx(one.normal @ image.T, abs=1e-9)


def test_corners_are_sharp_and_faces_flat():
    body = body_of(planar("box"))
    found = body.near(np.array([[0.035 + 0.003, 0.02 + 0.004], [0.05, 0.0], [0.0, 0.02]]))
    assert found.distance == pytest.approx([0.005, 0.015, 0.0], abs=1e-16)
    assert found.normal == pytest.approx(np.array([[0.6, 0.8], [1.0, 0.0], [0.0, 1.0]]), abs=1e-9)
    assert found.curvature == pytest.approx([1e9 / body.size, 0.0, 0.0])
    rounded = body_of(planar("rounded box")).near(np.array([[0.04, 0.03]]))
    assert rounded.curvature == pytest.approx([1.0 / 0.008])


# -- in space -----------------------------------------------------------------------------------------------------


def test_the_distances_of_a_box_a_can_and_a_ball_are_their_formulas():
    points = np.random.default_rng(1).uniform(-0.07, 0.07, (500, 3))
    radial = np.hypot(points[:, 0], points[:, 1])
    flat = np.abs(np.column_stack([radial, points[:, 2]]))
    for name, away in (
        ("ball", np.linalg.norm(points, axis=1)[:, None] - 0.03),
        ("can", flat - [0.025, 0.04]),
        ("capsule", flat - [0.0, 0.015]),
        ("box", np.abs(points) - [0.021, 0.026, 0.036]),
    ):
        radius = {"ball": 0.0, "can": 0.005, "capsule": 0.03, "box": 0.004}[name]
        outside = np.linalg.norm(np.maximum(away, 0.0), axis=1)
        expected = outside + np.minimum(away.max(axis=1), 0.0) - radius
        assert body_of(solid(SOLIDS[name])).distance(points) == pytest.approx(expected, abs=1e-16)


def test_the_distance_of_a_cone_is_that_of_its_section():
    """A trapezoid whose corners are rounded: of shapely, eroded and grown."""
    section = shapely.Polygon([(-0.035, -0.04), (0.035, -0.04), (0.015, 0.04), (-0.015, 0.04)])
    core = section.buffer(-0.004, join_style="mitre")
    body = body_of(solid(SOLIDS["cone"]))
    points = around(body)
    places = np.column_stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]])
    assert body.distance(points) == pytest.approx(by_shapely(core, places) - 0.004, abs=1e-12)


def test_the_distance_of_an_extruded_outline_is_that_of_a_core():
    body = body_of(solid(SOLIDS["angle"]))
    core = shapely.Polygon(HOOK).buffer(-0.002, join_style="mitre", mitre_limit=100.0)
    points = around(body)
    away = np.column_stack([by_shapely(core, points[:, :2]), np.abs(points[:, 2]) - 0.028])
    expected = np.linalg.norm(np.maximum(away, 0.0), axis=1) + np.minimum(away.max(axis=1), 0.0) - 0.002
    # The mitre of the sharpest corner is cut in the scene: there both cores differ.
    assert np.sort(np.abs(body.distance(points) - expected))[:-6] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("name", ["egg", "pillow"])
def test_convex_solids_are_as_far_as_their_farthest_supporting_planes(name):
    """The distance is the greatest of n . p - h(n) over unit vectors n, with the support function h of dual norms."""
    p, q = SOLIDS[name].get("exponents", (2.0, 2.0))
    half = 0.5 * np.array(SOLIDS[name]["extents"])

    def support(n):
        w = np.abs(half * n)
        across = (w[..., :2] ** (p / (p - 1))).sum(axis=-1) ** ((p - 1) / p)
        return (across ** (q / (q - 1)) + w[..., 2] ** (q / (q - 1))) ** ((q - 1) / q)

    body = body_of(solid(SOLIDS[name]))
    points = around(body, 40, least=-0.004)
    found = body.near(points)
    tried = np.random.default_rng(2).normal(size=(20_000, 3))
    tried /= np.linalg.norm(tried, axis=1)[:, None]
    heights = points @ tried.T - support(tried)
    assert (found.distance[:, None] >= heights - 1e-15).all()
    own = (points * found.normal).sum(axis=1) - support(found.normal)
    assert found.distance == pytest.approx(own, abs=1e-14)
    assert body.distance(points) == pytest.approx(found.distance, abs=1e-15)


def principal(curvature):
    """Two principal curvatures (n, 2) of shape operators, the least first."""
    bends = np.linalg.eigvalsh(curvature)
    return np.sort(np.take_along_axis(bends, np.abs(bends).argsort(axis=1)[:, 1:], axis=1), axis=1)


def test_shape_operators_are_closed_forms():
    away = 0.01
    ball = body_of(solid(SOLIDS["ball"])).near([[0.0, 0.024, 0.032]])
    assert principal(ball.curvature) == pytest.approx(np.full((1, 2), 1.0 / 0.03))
    can = body_of(solid(SOLIDS["can"])).near([[0.03 + away, 0.0, 0.01], [0.0, 0.025, 0.05]])
    assert can.curvature[0] == pytest.approx(np.diag([0.0, 1.0 / 0.03, 0.0]), abs=1e-6)
    egg = body_of(solid(SOLIDS["egg"])).near([[0.0, 0.0, 0.05 + away], [0.015 + away, 0.0, 0.0]])
    assert egg.curvature[0] == pytest.approx(np.diag([0.05 / 0.015**2, 0.05 / 0.03**2, 0.0]), abs=1e-6)
    assert egg.curvature[1] == pytest.approx(np.diag([0.0, 0.015 / 0.03**2, 0.015 / 0.05**2]), abs=1e-6)
    # A torus: outside convex, in its hole a saddle.
    torus = body_of(solid(SOLIDS["ring"])).near([[0.045, 0.0, 0.0], [0.015, 0.0, 0.0]])
    assert torus.curvature[0] == pytest.approx(np.diag([0.0, 1.0 / 0.04, 100.0]), abs=1e-6)
    assert torus.curvature[1] == pytest.approx(np.diag([0.0, -1.0 / 0.02, 100.0]), abs=1e-6)


def facets(tmp_path, subdivisions=2):
    trimesh.creation.icosphere(subdivisions=subdivisions, radius=30.0).export(tmp_path / "ball.stl")
    return body_of(solid({"shape": "mesh", "file": str(tmp_path / "ball.stl"), "scale": 1e-3}))


def test_distances_of_meshes_are_those_of_trimesh_and_near_the_true_surface(tmp_path):
    body = facets(tmp_path)
    assert isinstance(body, MeshSurface)
    points = around(body, 200)
    # Some close to the surface, on both sides.
    near = points[:60] / np.linalg.norm(points[:60], axis=1)[:, None]
    points = np.concatenate([points, 0.0301 * near[:30], 0.0285 * near[30:]])
    # 1000: trimesh takes places whose squared distances differ by 1e-8 for one
    mesh = trimesh.Trimesh(1000.0 * body.corners, body.triangles_, process=False)
    assert body.distance(points) == pytest.approx(-trimesh.proximity.signed_distance(mesh, 1000.0 * points) / 1000.0)
    found = body.near(points[np.linalg.norm(points, axis=1) > 0.02])
    points = points[np.linalg.norm(points, axis=1) > 0.02]
    size = np.linalg.norm(points, axis=1)
    assert np.abs(found.distance - (size - 0.03)).max() < 1.5 * body.deviation
    assert np.linalg.norm(found.normal - points / size[:, None], axis=1).max() < 0.03


# -- all ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("body", bodies())
def test_normals_are_slopes_and_curvatures_slopes_of_normals(body):
    """Of the surface, from those of the parallel surface through a point: k / (1 + d k)."""
    points = around(body, 150, least=1e-4)
    found = body.near(points)
    step = 1e-6 * np.eye(body.dimensions)
    assert np.linalg.norm(found.normal, axis=1) == pytest.approx(1.0)
    assert body.distance(points) == pytest.approx(found.distance, abs=1e-15)
    slope = np.stack([(body.distance(points + h) - body.distance(points - h)) / 2e-6 for h in step], axis=1)
    turning = np.stack([(body.near(points + h).normal - body.near(points - h).normal) / 2e-6 for h in step], axis=1)
    if body.dimensions == 2:
        across = np.column_stack([-found.normal[:, 1], found.normal[:, 0]])
        turning = np.einsum("ni,nij,nj->n", across, turning, across)
        level = found.curvature / (1.0 + found.distance * found.curvature)
    else:
        level = np.linalg.solve(np.eye(3) + found.distance[:, None, None] * found.curvature, found.curvature)
        turning = turning.reshape(len(points), 9)
        level = level.reshape(len(points), 9)
    # Where curvatures jump, as they do along a line, a difference is none: 5 of 100 places.
    worst = np.sort(np.abs(slope - found.normal).max(axis=1))
    assert worst[: -len(worst) // 20].max() < 1e-7
    off = np.abs(turning - level).reshape(len(points), -1).max(axis=1) * body.size
    assert np.sort(off)[: -len(off) // 20].max() < 1e-4


@pytest.mark.parametrize("body", bodies())
def test_nearest_places_are_on_the_surface_and_in_the_box(body):
    points = around(body, 200, least=0.0)
    found = body.near(points)
    places = points - found.distance[:, None] * found.normal
    assert np.abs(body.distance(places)).max() < 1e-12
    low, high = body.box
    near = 2e-3 * body.size
    assert (places >= low - near).all()
    assert (places <= high + near).all()
    reach = np.concatenate([np.abs(low), np.abs(high)])
    assert reach.max() <= math.sqrt(body.dimensions) * 2.0 * body.size
