"""Any outline, against shapely and closed forms; from inside: distances of the certificate, and corners.

Any outline: polygons that are not convex, and curves read from files, against shapely and closed forms.
"""

from __future__ import annotations

import itertools
import math

import casadi as ca
import ezdxf
import numpy as np
import pytest
import shapely
import yaml
from shapely.affinity import rotate, translate

from continuum_grasp.addons.design import Design
from continuum_grasp.addons.design.space import SINGLE, design_space_of
from continuum_grasp.addons.sweeps import Sweep, SweepPlan
from continuum_grasp.base import InputError
from continuum_grasp.grasp.judge import surfaces
from continuum_grasp.model import Vec, nearest, surface_of
from continuum_grasp.model.surfaces.offset_polygon import pieces_of
from continuum_grasp.scene import ConfigurationData, GraspScene, OffsetPolygon, Polygon, load
from continuum_grasp.scene.polygons import corners_of

SCENE = "configs/grasp/mug.yaml"
# An L of two bars, 60 mm and 40 mm long, both 20 mm wide.
ELL = ((0.0, 0.0), (0.06, 0.0), (0.06, 0.02), (0.02, 0.02), (0.02, 0.06), (0.0, 0.06))
COMB = (*((0.01 * (k // 2), 0.03 * ((k + 1) // 2 % 2)) for k in range(12)), (0.05, -0.01), (0.0, -0.01))


def star(seed, count=16):
    rng = np.random.default_rng(seed)
    turns, reach = np.sort(rng.uniform(0.0, math.tau, count)), rng.uniform(0.02, 0.05, count)
    ring = shapely.Polygon(np.column_stack([reach * np.cos(turns), reach * np.sin(turns)]))
    return tuple(ring.exterior.coords[:-1]) if ring.is_valid else star(seed + 1000, count)


OUTLINES = {"ell": ELL, "comb": COMB, **{f"star {k}": star(k) for k in range(6)}}


@pytest.mark.parametrize("corners", OUTLINES.values(), ids=OUTLINES)
def test_pieces_are_convex_and_cover_the_outline_once(corners):
    whole = shapely.Polygon(corners)
    pieces = [shapely.Polygon(piece.vertices) for piece in OffsetPolygon(corners_of(corners)).pieces]
    assert all(piece.convex_hull.area == pytest.approx(piece.area, rel=1e-9) for piece in pieces)
    assert sum(piece.area for piece in pieces) == pytest.approx(whole.area, rel=1e-12)
    assert shapely.union_all(pieces).symmetric_difference(whole).area < 1e-9 * whole.area
    reflex = sum(turn < 0.0 for _, turn in OffsetPolygon(corners_of(corners)).turns)
    assert 0.5 * reflex + 1 <= len(pieces) <= 2 * reflex + 1


@pytest.mark.parametrize("radius", [0.0, 0.004])
@pytest.mark.parametrize("corners", OUTLINES.values(), ids=OUTLINES)
def test_every_distance_is_that_of_shapely(corners, radius):
    part, whole = OffsetPolygon(corners_of(corners), radius), shapely.Polygon(corners)
    points = np.random.default_rng(0).uniform(-0.06, 0.08, (200, 2))
    # On the lines of the edges and beside corners, where two edges are as near.
    points = np.concatenate([points, 1.5 * np.array(corners) - 0.5 * np.roll(corners, 1, axis=0), np.array(corners)])
    inside = shapely.contains_xy(whole, points)
    truth = shapely.distance(whole.exterior, shapely.points(points)) * np.where(inside, -1.0, 1.0) - radius
    at = ca.SX.sym("at", 2)
    moving = ca.Function("d", [at], [nearest([part], Vec(at[0], at[1])).distance]).map(len(points))
    found = {
        "scene": [part.distance(tuple(point)) for point in points],
        "search": surface_of(part).outline(part).distance(points @ [1.0, 1j]),
        "motion": np.array(moving(points.T)).ravel(),
        "certificate": surfaces.nearest(part, points).distance,
    }
    for name, distances in found.items():
        assert np.abs(distances - truth).max() < 1e-12, name
    beyond = truth > 1e-9
    pieces = np.min([surfaces.nearest(piece, points).distance for piece in part.pieces], axis=0)
    assert np.abs(pieces - truth)[beyond].max() < 1e-12


def test_center_of_mass_and_inertia_of_an_ell_are_those_of_its_bars():
    areas, centers = np.array([0.06 * 0.02, 0.02 * 0.04]), np.array([[0.03, 0.01], [0.01, 0.04]])
    middle = areas @ centers / areas.sum()
    own = areas * np.array([0.06**2 + 0.02**2, 0.02**2 + 0.04**2]) / 12.0
    second = (own + areas * ((centers - middle) ** 2).sum(axis=1)).sum()
    for corners in (ELL, ELL[::-1]):
        body = {"shape": "polygon", "vertices": corners, "mass": 0.3, "position": (0.2, 0.0)}
        scene = load("configs/mpc/turn_bar.yaml").changed({"object": body})
        assert scene.object.com == pytest.approx(middle, rel=1e-12)
        assert scene.inertia == pytest.approx(0.3 * second / areas.sum(), rel=1e-12)


def test_rounded_corners_are_those_of_shapely_and_reflex_ones_stay():
    body = Polygon(shape="polygon", vertices=ELL, corner_radius=0.006, mass=0.1, position=(0.0, 0.0))
    (part,) = body.parts
    truth = shapely.Polygon(ELL).buffer(-0.006, join_style="mitre").buffer(0.006, quad_segs=2000)
    points = np.random.default_rng(1).uniform(-0.02, 0.08, (200, 2))
    distance = shapely.distance(truth, shapely.points(points))
    found = surfaces.nearest(part, points).distance
    assert np.abs(np.maximum(found, 0.0) - distance).max() < 1e-8
    assert shapely.Polygon(part.outline(4000)).symmetric_difference(truth).area < 1e-8


def test_contacts_sit_on_faces_and_convex_corners_alone():
    part = OffsetPolygon(ELL)
    pieces = pieces_of(part)
    assert {(one.base.real, one.base.imag) for one in pieces if one.turn} == set(ELL) - {(0.02, 0.02)}
    assert len(pieces) == 11


def test_walls_meet_the_outermost_corners_and_what_lies_between_feet_is_no_face():
    arch = ((0.0, 0.0), (0.01, 0.0), (0.01, 0.02), (0.04, 0.02), (0.04, 0.0), (0.05, 0.0), (0.05, 0.04), (0.0, 0.04))
    part = OffsetPolygon(arch)
    outline = surface_of(part).outline(part)
    ends = [point for point, _ in outline.extremes(-1j, 1e-9)]
    assert sorted(z.real for z in ends) == [0.0, 0.05]
    assert sorted(outline.face_normals) == pytest.approx([-0.5 * math.pi, 0.0, 0.5 * math.pi, math.pi])
    assert len(surface_of(part).lowest_points(part, Vec(0.0, -1.0))) == 4


def test_a_tip_between_two_faces_touches_that_whose_normal_it_states():
    """A tip in the corner of an L touches both of its bars, also where one is nearer by what a finger may be deep."""
    part, center = OffsetPolygon(ELL), np.array([0.025, 0.025])
    for (normal, foot), off in itertools.product(
        (((1.0, 0.0), (0.02, 0.025)), ((0.0, 1.0), (0.025, 0.02))), (0.0, 1e-8, -1e-8)
    ):
        touched = surfaces.touched(part, center + np.array([off, 0.0]), np.array(normal), 2e-8)
        found = surfaces.nearest(touched, center[None])
        assert found.normal[0] == pytest.approx(normal)
        assert found.point[0] == pytest.approx(foot)
        # From afar the other bar, which lies in front of the face, does not count.
        assert surfaces.nearest(touched, (center + 0.1 * np.array(normal))[None]).point[0] == pytest.approx(foot)
    # Where it is clearly nearer to one, no normal makes it touch the other.
    beside = surfaces.touched(part, center + np.array([1e-5, 0.0]), np.array([1.0, 0.0]), 2e-8)
    assert surfaces.nearest(beside, center[None]).point[0] == pytest.approx((0.025, 0.02))


# -- files ---------------------------------------------------------------------------------------------------------

DROP = """M 0 -30 C 20 -10 20 20 0 20 C -8 20 -4 8 -14 6 Z"""


def drop(count=4000):
    """The same curve by Bernstein polynomials, y up [m]."""
    pieces = [[(0, -30), (20, -10), (20, 20), (0, 20)], [(0, 20), (-8, 20), (-4, 8), (-14, 6)]]
    t = np.linspace(0.0, 1.0, count)[:, None]
    weights = np.hstack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3])
    points = np.concatenate([weights @ np.array(piece, float) for piece in pieces])
    return shapely.Polygon(points * [1e-3, -1e-3])


def written(folder, form):
    file = folder / f"drop.{form}"
    ring = np.array(drop(400).exterior.coords[:-1])
    if form == "svg":
        size = 'width="80mm" height="80mm" viewBox="-40 -40 80 80" xmlns="http://www.w3.org/2000/svg"'
        file.write_text(f'<svg {size}><path id="drop" d="{DROP}"/></svg>')
    elif form == "csv":
        file.write_text("x_mm,y_mm\n" + "\n".join(f"{x * 1e3:.6f},{y * 1e3:.6f}" for x, y in ring))
    elif form == "dxf":
        drawing = ezdxf.new(units=ezdxf.units.MM)
        drawing.modelspace().add_lwpolyline(ring * 1e3, close=True, dxfattribs={"layer": "drop"})
        drawing.saveas(file)
    else:
        from PIL import Image, ImageDraw

        image = Image.new("L", (1600, 2480), 255)
        ImageDraw.Draw(image).polygon([(800 + 4e4 * x, 1240 - 4e4 * y) for x, y in ring], fill=0)
        image.resize((400, 620), Image.Resampling.BOX).save(file)
    return file


UNITS = {"svg": {}, "dxf": {"path": "drop"}, "csv": {"scale": "1 mm"}, "png": {"scale": "0.1 mm"}}


def object_of(file, **keys):
    keys = {"shape": "outline", "file": str(file), "mass": 0.1, "position": [0.06, 0.0], "tolerance": "0.05 mm"} | keys
    return load(SCENE).changed({"object": keys, "supports": {}, "gravity": [0.0, 0.0, 0.0]}).object


@pytest.mark.parametrize("form", UNITS)
def test_a_curve_of_any_file_is_that_polygon_to_the_tolerance(tmp_path, form):
    file = written(tmp_path, form)
    body, truth = object_of(file, **UNITS[form]), drop()
    assert isinstance(body, Polygon)
    found = shapely.Polygon(body.vertices)
    centered = translate(truth, -truth.centroid.x, -truth.centroid.y)
    # The polygon is within the tolerance of the curve, and its centroid, the origin, is so, too.
    assert found.hausdorff_distance(centered) < (0.12e-3 if form == "png" else 0.1e-3)
    assert found.area == pytest.approx(truth.area, rel=5e-3)
    assert body.com == pytest.approx((0.0, 0.0), abs=1e-9)
    assert len(body.vertices) < 60
    rougher = object_of(file, **UNITS[form] | {"tolerance": "0.5 mm"})
    assert len(rougher.vertices) < len(body.vertices)


def test_a_mirrored_curve_is_the_mirrored_outline(tmp_path):
    ring = np.array(drop(50).exterior.coords[:-1])
    (tmp_path / "one.csv").write_text("\n".join(f"{x:.9f},{y:.9f}" for x, y in ring))
    (tmp_path / "other.csv").write_text("\n".join(f"{-x:.9f},{y:.9f}" for x, y in ring))
    one, other = (shapely.Polygon(object_of(tmp_path / name).vertices) for name in ("one.csv", "other.csv"))
    assert shapely.affinity.scale(one, -1.0, 1.0, origin=(0.0, 0.0)).symmetric_difference(other).area < 1e-9


def test_a_file_is_beside_the_configuration_and_members_of_a_union_may_be_outlines(tmp_path):
    written(tmp_path, "csv")
    member = "{shape: outline, file: drop.csv, scale: 1 mm, position: [0.01, 0.0], angle: 90 deg}"
    text = (
        f"schema_version: 1\nfinger: {load(SCENE).finger.model_dump_json(exclude_unset=True)}\n"
        f"object:\n  shape: union\n  members: [{member}, {{shape: circle, diameter: 20 mm}}]\n"
        "  center_of_mass: [0, 0]\n  mass: 0.1\n  position: [0.09, 0.03]\ngravity: [0.0, 0.0, 0.0]\n"
        "contacts: {friction: 0.5, normal_force_max: 10, middle: on, tip: on}\n"
        "fidelity: {family: arc, elements: 2}\nobjective: least_tension\n"
    )
    (tmp_path / "scene.yaml").write_text(text)
    first, _ = load(tmp_path / "scene.yaml").object.parts
    truth = drop()
    turned = translate(rotate(translate(truth, -truth.centroid.x, -truth.centroid.y), 90, (0, 0)), 0.01)
    assert shapely.Polygon(first.vertices).hausdorff_distance(turned) < 2e-4


SQUARE = "0,0\n40,0\n40,40\n0,40\n"
BAD = {
    "crossing": (
        "csv",
        "0,0\n40,40\n40,0\n0,40\n",
        {},
        r"object.file: curve of bad.csv must be .* at \(0.02, 0.02\) m",
    ),
    "no curve": ("csv", "0,0\n40,40\n", {}, "object.file: no closed curve in bad.csv"),
    "not two columns": ("csv", "0,0\n40,0,1\n", {}, "object.file: cannot be read: .*bad.csv:2: expected 2 cells"),
    "unit": ("csv", SQUARE, {"scale": 1.0}, r"object.scale: the outline would be 40 m long; in which unit"),
    "tolerance": ("csv", SQUARE, {"tolerance": 0.05}, "object.tolerance: 0.05 m leaves nothing"),
    "unknown form": (
        "gif",
        SQUARE,
        {},
        "object.file: expected .svg, .dxf, .csv, .png, .stl, .obj, .ply, .3mf, got bad.gif",
    ),
    "unknown key": ("csv", SQUARE, {"scal": 1e-3}, "object.scal: unknown key; did you mean 'scale'"),
    "no such path": ("csv", SQUARE, {"path": "rim"}, "object.path: no curve 'rim' in bad.csv"),
    "not a picture": ("png", "none", {}, "object.file: cannot be read"),
}


@pytest.mark.parametrize(("form", "content", "keys", "message"), BAD.values(), ids=BAD)
def test_errors_say_which_key_and_what_is_wrong(tmp_path, form, content, keys, message):
    (tmp_path / f"bad.{form}").write_text(content)
    with pytest.raises(InputError, match=message):
        object_of(tmp_path / f"bad.{form}", **{"scale": "1 mm"} | keys)


def test_pictures_without_a_scale_and_files_that_are_not_there_are_refused(tmp_path):
    from PIL import Image

    Image.fromarray(np.pad(np.zeros((8, 8), np.uint8), 2, constant_values=255)).save(tmp_path / "dark.png")
    with pytest.raises(InputError, match="object: scale: missing"):
        object_of(tmp_path / "dark.png")
    with pytest.raises(InputError, match=r"object.file: no such file of an outline"):
        object_of(tmp_path / "none.png")


def test_polygons_that_cross_or_touch_themselves_are_refused_with_the_place():
    with pytest.raises(InputError, match=r"self-intersection at \(0.01, 0.01\) m"):
        Polygon(shape="polygon", vertices=((0, 0), (0.02, 0.02), (0.02, 0), (0, 0.02)), mass=0.1, position=(0, 0))
    with pytest.raises(InputError, match="a corner is there twice"):
        Polygon(shape="polygon", vertices=(*ELL, ELL[0]), mass=0.1, position=(0.0, 0.0))


def test_scale_and_tolerance_of_an_outline_vary(tmp_path):
    """Every value has the drawing read anew, a circle here."""
    turns = np.arange(720) * math.tau / 720
    np.savetxt(tmp_path / "disc.csv", 20.0 * np.column_stack([np.cos(turns), np.sin(turns)]), delimiter=",")
    data = load(SCENE).model_dump(mode="json", exclude_unset=True) | {"schema_version": 1}
    data["object"] = {"shape": "outline", "file": "disc.csv", "scale": "1 mm", "mass": 0.1, "position": [0.04, 0.0]}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(data))
    keys = {"object.scale": {"values": ["1 mm", "2 mm"]}, "object.tolerance": {"values": ["0.01 mm", "1 mm"]}}
    plan = SweepPlan.of(Sweep(scene=str(tmp_path / "scene.yaml"), vary=keys))
    for point in plan:
        scene = GraspScene.model_validate(plan.data_of(point))
        scale, tolerance = point.values
        assert scene.object.size == pytest.approx(20.0 * scale, abs=2.0 * tolerance)
        # Chords of a circle that stay within a tolerance t of it span angles of acos(1 - t / r) either way.
        least = math.pi / math.acos(1.0 - tolerance / (20.0 * scale))
        assert 0.9 * least < len(scene.object.parts[0].vertices) < 2.5 * least
    chosen = {"object.scale": {"min": 1e-3, "max": 2e-3}}
    design = Design(scene=str(tmp_path / "scene.yaml"), variables=chosen, minimize="tension")
    space = design_space_of(ConfigurationData.of(design, "design", tmp_path / "design.yaml"))
    assert space.start == [1e-3]
    assert space.scene(SINGLE, [1.5e-3]).object.size == pytest.approx(0.03, abs=2e-4)


def test_columns_of_an_outline_that_nothing_reads_are_named(tmp_path):
    rows = "".join(f"{x},{y},{k},0\n" for k, (x, y) in enumerate([(0, 0), (40, 0), (40, 30), (0, 30)]))
    (tmp_path / "box.csv").write_text("x [mm],y [mm],z [mm],note\n" + rows)
    data = load(SCENE).model_dump(mode="json", exclude_unset=True) | {"schema_version": 1}
    data["object"] = {"shape": "outline", "file": "box.csv", "mass": 0.1, "position": [0.04, 0.0]}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(data))
    read = ConfigurationData.load(tmp_path / "scene.yaml")
    assert shapely.Polygon(read.scene.object.vertices).area == pytest.approx(1.2e-3, rel=1e-9)
    (note,) = read.notes
    assert note.endswith("left out: column z, column note")


# -- simplification, and what touches --------------------------------------------------------------------------------


def disc_file(folder, radius, count=720, turn=0.0):
    turns = turn + np.arange(count) * math.tau / count
    np.savetxt(folder / "disc.csv", radius * np.column_stack([np.cos(turns), np.sin(turns)]), delimiter=",")
    return folder / "disc.csv"


@pytest.mark.parametrize("radius", [2e-4, 0.04, 2.0])
def test_the_default_tolerance_is_a_share_of_the_size_and_the_error_is_stated(tmp_path, radius):
    body = object_of(disc_file(tmp_path, radius), scale=1.0, tolerance=None, position=[2.0 * radius + 0.1, 0.0])
    sides = np.linalg.norm(np.diff([*body.vertices, body.vertices[0]], axis=0), axis=1)
    arrows = radius - np.sqrt(radius**2 - 0.25 * sides**2)  # of the circle over each chord
    assert body.drawn.deviation == pytest.approx(arrows.max(), rel=0.02)
    assert body.drawn.deviation <= 2e-3 * radius
    assert len(body.vertices) > 48
    assert body.redrawn().vertices == body.drawn.vertices
    finer = shapely.Polygon(body.drawn.vertices).exterior
    assert finer.hausdorff_distance(shapely.Point(0.0, 0.0).buffer(radius, 4000).exterior) < 6e-4 * radius


def test_an_outline_that_is_a_polygon_has_no_error(tmp_path):
    (tmp_path / "square.csv").write_text(SQUARE)
    assert object_of(tmp_path / "square.csv", scale="1 mm").drawn is None


@pytest.mark.parametrize("angle", [0.0, 0.3])
@pytest.mark.parametrize("tolerance", [None, 2e-3])
def test_simplification_keeps_the_points_that_touch(tmp_path, angle, tolerance):
    """An egg off its axes, placed by the farthest points of its curve, which are no corners of a rough polygon."""
    turns = np.arange(1000) * math.tau / 1000 + 1e-3
    ring = np.column_stack([0.03 * np.cos(turns) + 0.004 * np.cos(2 * turns), 0.04 * np.sin(turns)])
    np.savetxt(tmp_path / "egg.csv", ring, delimiter=",")
    ring = ring - np.array(shapely.Polygon(ring).centroid.coords[0])
    turned = ring @ np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    x, y = -turned.min(axis=0)
    shape = {"shape": "outline", "file": str(tmp_path / "egg.csv"), "mass": 0.1, "tolerance": tolerance}
    palm, table = ({"type": "palm", "point": [0, 0], "normal_angle": a} for a in (0.0, 0.5 * math.pi))
    scene = load(SCENE).changed(
        {"supports": {"palm": palm, "table": table}, "object": shape | {"position": [x, y], "angle": angle}}
    )
    assert [place.name for place in scene.places] == ["palm", "table"]
    assert max(abs(scene.gap_range(place)[0]) for place in scene.places) < 1e-6 * scene.object.size
    assert len(scene.object.vertices) < 150
