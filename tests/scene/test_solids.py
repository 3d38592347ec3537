"""Solid objects of hands: volumes, centroids and edges of shapes, every error of a file of triangles, and cavities."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import continuum_grasp as cg

trimesh = pytest.importorskip("trimesh")
BALL = "configs/hand/ball.yaml"


def solid(text):
    return cg.load(BALL, [f"object={{{text}, density: 1000, position: [0, 0, -90 mm]}}"]).object


def test_a_cone_is_a_frustum_but_for_its_rims():
    cone = solid("shape: cone, diameter_below: 60 mm, diameter_above: 40 mm, height: 50 mm, edge_radius: 0.1 mm")
    a, b, h = 0.03, 0.02, 0.05
    assert cone.volume == pytest.approx(math.pi * h / 3.0 * (a * a + a * b + b * b), rel=1e-5)
    middle = h / 4.0 * (a * a + 2.0 * a * b + 3.0 * b * b) / (a * a + a * b + b * b) - 0.5 * h
    assert cone.centroid == pytest.approx((0.0, 0.0, middle), abs=1e-6)
    assert cone.weighed == 1000.0 * cone.volume


def test_a_cone_that_does_not_widen_is_a_cylinder_and_one_with_a_point_has_a_cap():
    sizes = "height: 50 mm, edge_radius: 4 mm"
    cone = solid(f"shape: cone, diameter_below: 60 mm, diameter_above: 60 mm, {sizes}")
    assert cone.volume == pytest.approx(solid(f"shape: cylinder, diameter: 60 mm, {sizes}").volume, rel=1e-12)
    pointed = solid(f"shape: cone, diameter_below: 60 mm, diameter_above: 0, {sizes}")
    # The cap is a ball that touches the side: its center is radius / sin(half the angle at the tip) below the tip.
    top = 0.025 - 0.004 / (0.03 / math.hypot(0.03, 0.05)) + 0.004
    assert max(z for _, z in (face.start for face in pointed.section)) < top
    assert max(face.center[1] + face.radius for face in pointed.section if face.turn) == pytest.approx(top, abs=1e-12)


def test_a_superquadric_of_exponents_two_is_an_ellipsoid():
    sizes = "extents: [50 mm, 60 mm, 70 mm]"
    square = solid(f"shape: superquadric, {sizes}, exponents: [2, 2]")
    round_ = solid(f"shape: ellipsoid, {sizes}")
    assert square.volume == pytest.approx(round_.volume, rel=1e-12)
    assert square.size == pytest.approx(round_.size, rel=1e-12)


@pytest.mark.parametrize("exponents", [(2.5, 2.0), (4.0, 4.0), (3.0, 8.0)])
def test_volume_and_size_of_a_superquadric_are_those_of_random_points(exponents):
    body = solid(f"shape: superquadric, extents: [50 mm, 60 mm, 70 mm], exponents: {list(exponents)}")
    half, (p, q) = 0.5 * np.array(body.extents), exponents
    u = np.random.default_rng(0).uniform(-1.0, 1.0, (400_000, 3))
    level = (np.abs(u[:, :2]) ** p).sum(axis=1) ** (q / p) + np.abs(u[:, 2]) ** q
    assert body.volume == pytest.approx(8.0 * half.prod() * np.mean(level < 1.0), rel=5e-3)
    surface = u * half / level[:, None] ** (1.0 / q)
    assert body.size == pytest.approx(np.linalg.norm(surface, axis=1).max(), rel=1e-3)


def test_a_turned_circle_is_a_ball_and_beside_the_axis_a_ring():
    ball = solid("shape: revolve, profile: {shape: circle, diameter: 60 mm}")
    assert ball.volume == pytest.approx(math.pi / 6.0 * 0.06**3, rel=1e-6)
    ring = solid("shape: revolve, profile: {shape: circle, diameter: 20 mm, position: [30 mm, 0]}")
    assert ring.volume == pytest.approx(2.0 * math.pi * 0.03 * math.pi * 0.01**2, rel=1e-9)


def test_half_of_a_section_is_as_good_as_the_whole():
    half = "[[0, 0], [30 mm, 0], [20 mm, 50 mm], [0, 50 mm]]"
    whole = "[[-30 mm, 0], [30 mm, 0], [20 mm, 50 mm], [-20 mm, 50 mm]]"
    first, second = (solid(f"shape: revolve, profile: {{shape: polygon, vertices: {v}}}") for v in (half, whole))
    assert first.volume == pytest.approx(math.pi * 0.05 / 3.0 * (9e-4 + 6e-4 + 4e-4), rel=1e-9)
    assert first.volume == pytest.approx(second.volume, rel=1e-12)
    with pytest.raises(cg.InputError, match="left and right of the axis x = 0 it differs"):
        solid("shape: revolve, profile: {shape: circle, diameter: 60 mm, position: [5 mm, 0]}")


def test_an_extruded_rectangle_is_a_rounded_box_and_a_circle_a_cylinder():
    box = solid("shape: extrude, outline: {shape: box, width: 50 mm, height: 60 mm}, height: 70 mm, edge_radius: 4 mm")
    other = solid("shape: box, extents: [50 mm, 60 mm, 70 mm], edge_radius: 4 mm")
    assert (box.volume, box.size) == pytest.approx((other.volume, other.size), rel=1e-12)
    disc = solid("shape: extrude, outline: {shape: circle, diameter: 60 mm}, height: 50 mm, edge_radius: 2 mm")
    can = solid("shape: cylinder, diameter: 60 mm, height: 50 mm, edge_radius: 2 mm")
    assert (disc.volume, disc.size) == pytest.approx((can.volume, can.size), rel=1e-12)
    with pytest.raises(cg.InputError, match=r"edge_radius = 0.03 m is too large"):
        solid("shape: extrude, outline: {shape: box, width: 50 mm, height: 60 mm}, height: 70 mm, edge_radius: 30 mm")


# -- files of triangles ------------------------------------------------------------------------------------------------


def sphere(subdivisions=3):
    return trimesh.creation.icosphere(subdivisions, radius=30.0)


def meshed(file, more="scale: 1 mm"):
    return solid(f"shape: mesh, file: {file}, {more}")


@pytest.mark.parametrize("form", ["stl", "obj", "ply"])
def test_volume_and_centroid_are_those_of_tetrahedra(form, tmp_path):
    mesh = sphere()
    mesh.apply_translation([100.0, 20.0, 5.0])
    mesh.export(tmp_path / f"part.{form}")
    body = meshed(tmp_path / f"part.{form}")
    corners = mesh.vertices[mesh.faces] - mesh.vertices.mean(axis=0)
    assert body.volume == pytest.approx(np.linalg.det(corners).sum() / 6.0 * 1e-9, rel=1e-6)
    assert np.linalg.norm(body.surface.corners, axis=1) == pytest.approx(0.03, rel=1e-5)


def test_a_3mf_states_its_unit(tmp_path):
    mesh = sphere()
    mesh.units = "mm"
    mesh.export(tmp_path / "part.3mf")
    assert meshed(tmp_path / "part.3mf", "mass: null").size == pytest.approx(0.03, rel=1e-5)
    with pytest.raises(cg.InputError, match="its unit is a millimeter; leave scale out"):
        meshed(tmp_path / "part.3mf", "scale: 1 m")


def test_normals_of_a_ball_are_smooth_and_those_of_a_box_are_not(tmp_path):
    sphere().export(tmp_path / "ball.stl")
    trimesh.creation.box([50.0, 60.0, 70.0]).export(tmp_path / "box.stl")
    ball, box = (meshed(tmp_path / f"{name}.stl").surface for name in ("ball", "box"))
    radial = ball.corners[ball.triangles]
    radial = radial / np.linalg.norm(radial, axis=2, keepdims=True)
    assert np.abs(ball.normals - radial).max() < 0.01
    assert np.abs(box.normals).max(axis=2) == pytest.approx(1.0, abs=1e-12)
    # An edge of length l of a ball of radius r is l^2 / 8 r from it.
    edge = np.linalg.norm(np.roll(ball.corners[ball.triangles], 1, axis=1) - ball.corners[ball.triangles], axis=2)
    assert ball.deviation == pytest.approx(edge.max() ** 2 / 8.0 / 0.03, rel=0.05)
    assert box.deviation == 0.0


def opened(mesh):
    mesh.update_faces(np.arange(len(mesh.faces)) > 4)


def inverted(mesh):
    mesh.invert()


def one_turned(mesh):
    mesh.faces = np.concatenate([mesh.faces[:1, ::-1], mesh.faces[1:]])


FLAWS = {
    "open": (opened, "scale: 1 mm", "object.file: .*part.stl is open: [0-9]+ edges have a triangle on one side only"),
    "inside-out": (inverted, "scale: 1 mm", "part.stl is inside-out: .* reverse all triangles"),
    "one triangle turned": (one_turned, "scale: 1 mm", "corners go round the other way"),
    "no scale": (None, "mass: null", "object: scale: missing; part.stl does not say how long a unit of it is"),
    "millimeters for meters": (None, "scale: 1 m", "object.scale: part.stl would be 60 m large; .* try scale: 1 mm"),
    "meters for millimeters": (None, "scale: 1 um", "object.scale: part.stl would be 6e-05 m large; .* try scale: 1 m"),
}


@pytest.mark.parametrize("flaw", FLAWS)
def test_errors_of_meshes_say_what_is_wrong_and_what_to_do(flaw, tmp_path):
    change, more, message = FLAWS[flaw]
    mesh = sphere()
    if change is not None:
        change(mesh)
    mesh.export(tmp_path / "part.stl")
    with pytest.raises(cg.InputError, match=message):
        meshed(tmp_path / "part.stl", more)


def test_several_bodies_are_refused_with_their_sizes(tmp_path):
    other = sphere()
    other.apply_translation([100.0, 0.0, 0.0])
    trimesh.util.concatenate([sphere(), other]).export(tmp_path / "part.stl")
    with pytest.raises(cg.InputError, match=r"has 2 bodies \(0.06 m, 0.06 m\); a hand holds one"):
        meshed(tmp_path / "part.stl")


@pytest.mark.parametrize(("name", "content", "message"), [
    ("part.stl", b"no triangles here", "object.file: .*part.stl"),
    ("part.ply", b"\x00\x01", "object.file: cannot be read: part.ply"),
    ("part.step", b"", "object.file: expected .stl, .obj, .ply, .3mf, got part.step"),
])  # fmt: skip
def test_what_is_no_mesh_is_refused(name, content, message, tmp_path):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(cg.InputError, match=message):
        meshed(tmp_path / name)
    with pytest.raises(cg.InputError, match=r"object.file: no such file of a mesh"):
        meshed(tmp_path / "missing.stl")


# -- sections of meshes as planar outlines -----------------------------------------------------------------------------


def cut(file, at):
    keys = f"shape: outline, file: {file}, scale: 1 mm, cut: {{{at}}}, mass: 0.3, position: [40 mm, 0]"
    return cg.load("configs/grasp/mug.yaml", [f"object={{{keys}}}"]).object


def test_a_section_of_a_ball_is_a_circle_and_its_plane_has_axes_of_the_file(tmp_path):
    sphere(4).export(tmp_path / "ball.stl")
    assert cut(tmp_path / "ball.stl", "point: [0, 0, 10 mm]").size == pytest.approx(math.sqrt(8e-4), rel=3e-3)
    trimesh.creation.box([50.0, 60.0, 70.0]).export(tmp_path / "box.stl")
    corners = np.array(cut(tmp_path / "box.stl", "normal: [0, -1, 0]").vertices)
    assert np.ptp(corners, axis=0) == pytest.approx([0.05, 0.07], rel=1e-6)
    with pytest.raises(cg.InputError, match=r"object.cut: the plane misses the mesh, from -0.03 to 0.03 m"):
        cut(tmp_path / "ball.stl", "point: [0, 0, 50 mm]")
    with pytest.raises(cg.InputError, match="cut: missing; a mesh needs the plane of the section"):
        cg.load(
            "configs/grasp/mug.yaml",
            [f"object={{shape: outline, file: {tmp_path / 'ball.stl'}, scale: 1 mm, mass: 0.3, position: [0, 0]}}"],
        )


# -- cavities ----------------------------------------------------------------------------------------------------------


def hull_of(*solids):
    """Shells in one file; of (extents, center, rotation vector, turned inside out) of boxes [mm]."""
    parts = []
    for extents, center, turn, inverted in solids:
        part = trimesh.creation.box(extents)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = Rotation.from_rotvec(turn).as_matrix(), center
        part.apply_transform(matrix)
        if inverted:
            part.invert()
        parts.append(part)
    return trimesh.util.concatenate(parts)


def of_boxes(solids):
    """Volume, centroid and inertia tensor about it, per mass, of the first of some boxes without the others."""
    signs = [1.0, *[-1.0] * (len(solids) - 1)]
    masses = np.array([sign * np.prod(box[0]) for sign, box in zip(signs, solids, strict=True)])
    centers = np.array([box[1] for box in solids])
    center = masses @ centers / masses.sum()
    inertia = np.zeros((3, 3))
    for mass, (extents, place, turn, _) in zip(masses, solids, strict=True):
        squares, axes = np.array(extents) ** 2, Rotation.from_rotvec(turn).as_matrix()
        away = np.array(place) - center
        own = axes @ np.diag(squares.sum() - squares) @ axes.T / 12.0
        inertia += mass * (own + away @ away * np.eye(3) - np.outer(away, away))
    return masses.sum(), center, inertia / masses.sum()


@pytest.mark.parametrize(("scale", "unit"), [("1 mm", 1.0), ("1 m", 1e-3)])
@pytest.mark.parametrize("seed", range(4))
def test_a_body_with_cavities_is_hollow_whichever_way_these_are_turned(seed, scale, unit, tmp_path):
    rng = np.random.default_rng(seed)
    boxes = [((60.0, 50.0, 40.0), (7.0, -3.0, 100.0), (0.3, 0.2, -0.1), False)]
    axes = Rotation.from_rotvec(boxes[0][2]).as_matrix()
    for side in (-14.0, 14.0)[: 1 + seed % 2]:
        center = axes @ [side, *rng.uniform(-5.0, 5.0, 2)] + boxes[0][1]
        boxes.append((tuple(rng.uniform(6.0, 12.0, 3)), tuple(center), tuple(rng.normal(size=3)), rng.random() < 0.5))
    mesh = hull_of(*boxes)
    mesh.apply_scale(unit)
    mesh.export(tmp_path / "part.ply")
    body = meshed(tmp_path / "part.ply", f"scale: {scale}")
    volume, center, inertia = of_boxes(boxes)
    assert body.volume == pytest.approx(1e-9 * volume, rel=1e-5)
    assert body.weighed == pytest.approx(1e-6 * volume, rel=1e-5)
    assert body.surface.inertia == pytest.approx(1e-6 * inertia, abs=1e-5 * 1e-6 * inertia.max())
    # The outer shell alone is left, and the origin is the centroid of the material.
    corners = trimesh.creation.box(boxes[0][0]).vertices @ axes.T + boxes[0][1] - center
    found = body.surface.corners
    assert len(body.surface.triangles) == 12
    assert found[np.lexsort(found.round(6).T)] == pytest.approx(
        1e-3 * corners[np.lexsort((1e-3 * corners).round(6).T)], abs=1e-7
    )


BOX, WITHIN = (60.0, 50.0, 40.0), ((30.0, 30.0, 20.0), (1.0, 2.0, 3.0), (0.0, 0.0, 0.0), True)
SMALL, STRAIGHT = (9.0, 5.0, 5.0), (0.0, 0.0, 0.0)
SHELLS = {
    "a loose body in a cavity": ([WITHIN, (SMALL, STRAIGHT, (0.4, 0.0, 0.0), False)], "loose in a cavity .0.009"),
    "a cavity in a cavity": ([WITHIN, (SMALL, STRAIGHT, (0.4, 0.0, 0.0), True)], "loose in a cavity .0.009"),
    "a cavity that cuts the wall": (
        [((30.0, 9.0, 9.0), (30.0, 0.0, 0.0), STRAIGHT, True)],
        "shells that cross .*unite",
    ),
    "another body": ([(SMALL, (50.0, 0.0, 0.0), STRAIGHT, False)], r"has 2 bodies \(0.06 m, 0.009 m\)"),
    "a body next to a hollow one": ([WITHIN, (SMALL, (50.0, 0.0, 0.0), STRAIGHT, False)], "has 2 bodies"),
    "a cavity along an edge": ([((10.0, 10.0, 40.0), (25.0, 20.0, 0.0), STRAIGHT, True)], "more than two triangles"),
}


@pytest.mark.parametrize("case", SHELLS)
def test_other_shells_are_refused_by_what_they_are(case, tmp_path):
    others, message = SHELLS[case]
    hull_of((BOX, (0.0,) * 3, (0.0,) * 3, False), *others).export(tmp_path / "part.ply")
    with pytest.raises(cg.InputError, match=f"object.file: part.ply .*{message}"):
        meshed(tmp_path / "part.ply")


def test_an_outer_shell_that_is_inside_out_is_refused_with_any_cavity(tmp_path):
    hull_of((BOX, (0.0,) * 3, (0.0,) * 3, True), WITHIN).export(tmp_path / "part.ply")
    with pytest.raises(cg.InputError, match="is inside-out"):
        meshed(tmp_path / "part.ply")


def test_a_cavity_that_touches_the_wall_in_a_corner_is_one(tmp_path):
    """The corner of a small box lies amid a face of the large one, where both then have a corner."""
    outer = trimesh.creation.box(BOX).subdivide()
    turn = Rotation.align_vectors([[1.0, 0.0, 0.0]], [[1.0, 1.0, 1.0]])[0].as_rotvec()
    inner = hull_of(((6.0,) * 3, (30.0 - 3.0 * math.sqrt(3.0), 0.0, 0.0), turn, False))
    trimesh.util.concatenate([outer, inner]).export(tmp_path / "part.ply")
    body = meshed(tmp_path / "part.ply")
    assert body.volume == pytest.approx(1e-9 * (np.prod(BOX) - 6.0**3), rel=1e-6)


def test_a_section_through_a_cavity_names_it(tmp_path):
    hull_of((BOX, (0.0,) * 3, (0.0,) * 3, False), WITHIN).export(tmp_path / "part.ply")
    assert np.ptp(cut(tmp_path / "part.ply", "normal: [0, 0, 1]").vertices, axis=0) == pytest.approx([0.06, 0.05])
