"""Outlines of pictures and digitized points against the shapes that were drawn or measured."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
import shapely
from PIL import Image, ImageDraw, ImageFilter
from shapely import affinity

import continuum_grasp as cg
from continuum_grasp.scene import Outline, load
from tests.marks import every

SCENE = "configs/grasp/mug.yaml"


def rounded(width, height, radius):
    return shapely.box(*(sign * (0.5 * side - radius) for sign in (-1, 1) for side in (width, height))).buffer(
        radius, quad_segs=200
    )


SHAPES = {
    "rectangle": (shapely.box(-20, -30, 20, 30), 4),
    "triangle": (shapely.Polygon([(-25, -15), (25, -15), (5, 25)]), 3),
    "ell": (shapely.Polygon([(0, 0), (50, 0), (50, 18), (18, 18), (18, 50), (0, 50)]), 6),
    "circle": (shapely.Point(0, 0).buffer(25, quad_segs=400), 0),
    "stadium": (shapely.LineString([(-15, 0), (15, 0)]).buffer(14, quad_segs=400), 2),
    "box": (rounded(40, 50, 8), 4),
    "bottle": (shapely.union_all([rounded(40, 50, 8), shapely.box(-7, 20, 7, 40)]), 8),
}
"""Shapes [mm], and how many straight sides each has."""
PICTURES = {
    "clear": {},
    "blur": {"blur": 2.0},
    "noise": {"blur": 1.0, "noise": 8.0},
    "much noise": {"blur": 0.7, "noise": 20.0},
    "jpeg": {"blur": 1.0, "noise": 8.0, "quality": 40},
    "salt and pepper": {"blur": 1.0, "noise": 4.0, "wrong": 0.01},
    "slope of light": {"blur": 2.0, "noise": 4.0, "slope": 40.0},
}


def picture(file, shape, scale, blur=0.0, noise=0.0, quality=None, wrong=0.0, slope=0.0):
    """Draw a shape [mm] in gray with so many pixels per mm, eight times as fine as these."""
    low_x, low_y, high_x, high_y = shape.bounds
    margin = 12.0 / scale
    columns, rows = (int((span + 2 * margin) * scale) for span in (high_x - low_x, high_y - low_y))
    large = Image.new("L", (8 * columns, 8 * rows), 225)
    points = [
        (8 * scale * (x - low_x + margin) - 0.5, 8 * (rows - scale * (y - low_y + margin)) - 0.5)
        for x, y in shape.exterior.coords
    ]
    ImageDraw.Draw(large).polygon(points, fill=40)
    image = large.resize((columns, rows), Image.Resampling.BOX).filter(ImageFilter.GaussianBlur(blur))
    rng = np.random.default_rng(1)
    gray = np.asarray(image, dtype=float) + rng.normal(0.0, noise, (rows, columns))
    gray -= slope * np.linspace(0.0, 1.0, columns)
    chance = rng.random(gray.shape)
    gray[chance < 0.5 * wrong] = 0.0
    gray[chance > 1.0 - 0.5 * wrong] = 255.0
    image = Image.fromarray(gray.clip(0, 255).round().astype(np.uint8))
    if quality is not None:
        image.save(buffer := io.BytesIO(), "JPEG", quality=quality)
        image = Image.open(buffer)
    image.save(file)


def digitized(file, shape, count, noise, seed=0):
    """Points on the edge of a shape [mm] that a hand has measured."""
    length = shape.exterior.length
    points = np.array([shape.exterior.interpolate(length * k / count).coords[0] for k in range(count)])
    table(file, points + np.random.default_rng(seed).normal(0.0, noise, points.shape))


def table(file, points):
    np.savetxt(file, points, delimiter=",", header="x [mm],y [mm]", comments="", fmt="%.9f")


def outline(file, **keys):
    body = {"shape": "outline", "file": str(file), "mass": 0.1, "position": [0.2, 0.0]} | keys
    return load(SCENE).changed({"object": body, "supports": {}, "gravity": [0.0, 0.0, 0.0]}).object


def off_by(body, shape):
    """Hausdorff distance from a shape [mm] about its centroid."""
    (part,) = body.parts
    centered = affinity.translate(shape, -shape.centroid.x, -shape.centroid.y)
    return shapely.Polygon(1e3 * np.array(part.outline(4000))).exterior.hausdorff_distance(centered.exterior)


def straight(body, least):
    """Directions of sides that are longer than ``least`` [mm], between half a turn [rad], sorted."""
    (part,) = body.parts
    lines = [face for face in part.faces if face.turn == 0.0]
    sides = [1e3 * (complex(*face.end) - complex(*face.start)) for face in lines]
    return sorted(math.atan2(side.imag, side.real) % math.pi for side in sides if abs(side) > least)


@pytest.mark.parametrize(
    ("name", "kind", "angle"),
    every(5, [(name, kind, angle) for angle in (0.0, 31.0) for name in SHAPES for kind in PICTURES]),
)
def test_a_picture_is_the_shape_that_was_drawn(tmp_path, name, kind, angle):
    shape, sides = SHAPES[name]
    turned = affinity.rotate(shape, angle, origin=(0, 0))
    picture(tmp_path / "one.png", turned, 5.0, **PICTURES[kind])
    body = outline(tmp_path / "one.png", scale="0.2 mm", path="silhouette 1")
    # Half a pixel; corners that blur has rounded are there again.
    assert off_by(body, turned) < 0.1
    found = straight(body, 4.0)
    assert len(found) == sides
    corners = np.array(turned.simplify(1e-3).exterior.coords)
    true = [math.atan2(y, x) % math.pi for x, y in np.diff(corners, axis=0) if math.hypot(x, y) > 4.0]
    # Ends of a side of 5 mm are a fifth of a pixel off.
    for side in found if sides else ():
        assert min(abs(math.remainder(side - other, math.pi)) for other in true) < 0.08 / 5.0
    # The stated error covers what the fit explains; the pixels of a picture are known to 0.06 of one.
    assert 0.0 < body.drawn.error < 0.2e-3


@pytest.mark.parametrize("noise", [0.2, 0.05])
@pytest.mark.parametrize("name", ["rectangle", "triangle", "circle", "stadium"])
@pytest.mark.parametrize("count", [40, 100, 300])
def test_points_of_a_hand_are_the_shape_that_was_measured(tmp_path, name, count, noise):
    shape, sides = SHAPES[name]
    digitized(tmp_path / "one.csv", shape, count, noise, seed=count)
    body = outline(tmp_path / "one.csv")
    assert len(straight(body, 4.0)) == sides
    assert off_by(body, shape) < max(3.0 * noise, 1e-3 * 60)
    assert off_by(body, shape) < 1.3 * 1e3 * body.drawn.off


@pytest.mark.parametrize("name", ["rectangle", "circle"])
@pytest.mark.parametrize("wrong", [[], [7], [7, 60]])
def test_points_that_are_not_on_the_curve_are_counted(tmp_path, name, wrong):
    shape, _ = SHAPES[name]
    digitized(tmp_path / "one.csv", shape, 100, 0.1, seed=3)
    rows = np.loadtxt(tmp_path / "one.csv", delimiter=",", skiprows=1)
    for row in wrong:
        rows[row] *= 1.4  # more than 8 mm outside
    table(tmp_path / "one.csv", rows)
    assert off_by(outline(tmp_path / "one.csv"), shape) < 0.3
    note = Outline(shape="outline", file=str(tmp_path / "one.csv"), mass=0.1, position=(0.0, 0.0)).note
    counts = ["", "; left out: 1 point that is", "; left out: 2 points that are"]
    assert note.partition(" not on")[0].endswith(counts[len(wrong)] or "of one.csv")


def polar(radii, angles):
    return [(r * math.cos(a), r * math.sin(a)) for r, a in zip(radii, angles, strict=True)]


EXACT = {
    "twelve corners": polar([20, 18] * 6, np.arange(12) * math.tau / 12),
    "gear": polar([22, 27, 27, 22] * 12, [math.pi / 6 * (k + s) for k in range(12) for s in (-0.3, -0.16, 0.16, 0.3)]),
    "knurl": polar([20, 20.3] * 120, np.arange(240) * math.tau / 240),
    "star": polar([20, 14] * 30, np.arange(60) * math.tau / 60),
    "ellipse": [(38 * math.cos(a), 42 * math.sin(a)) for a in np.arange(72) * math.tau / 72],
}


@pytest.mark.parametrize("name", EXACT)
def test_exact_corners_stay_as_they_are(tmp_path, name):
    table(tmp_path / "one.csv", np.array(EXACT[name]))
    body = outline(tmp_path / "one.csv")
    centroid = np.array(shapely.Polygon(EXACT[name]).centroid.coords[0])
    assert np.abs(1e3 * np.array(body.vertices) - (np.array(EXACT[name]) - centroid)).max() < 1e-7
    assert body.drawn is None


def test_mirror_images_and_quarter_turns_give_the_same_outline(tmp_path):
    shape, _ = SHAPES["bottle"]
    picture(tmp_path / "one.png", shape, 5.0, blur=1.0, noise=8.0)
    body = outline(tmp_path / "one.png", scale="0.2 mm")
    (part,) = body.parts
    truth = shapely.Polygon(part.outline(4000))
    transforms = {
        Image.Transpose.FLIP_LEFT_RIGHT: lambda ring: affinity.scale(ring, -1.0, 1.0, origin=(0, 0)),
        Image.Transpose.ROTATE_90: lambda ring: affinity.rotate(ring, 90, origin=(0, 0)),
    }
    for transform, moved in transforms.items():
        with Image.open(tmp_path / "one.png") as image:
            image.transpose(transform).save(tmp_path / "other.png")
        (other,) = outline(tmp_path / "other.png", scale="0.2 mm").parts
        # But for where the noise is estimated, which depends on the first point.
        assert shapely.Polygon(other.outline(4000)).hausdorff_distance(moved(truth)) < body.drawn.error < 6e-5


WALLS = {"palm": 0.0, "table": 0.5 * math.pi, "slope": 0.7}


@pytest.mark.parametrize("wall", WALLS)
@pytest.mark.parametrize("form", ["png", "csv"])
def test_a_side_that_is_flat_within_its_noise_touches_with_both_ends(tmp_path, wall, form):
    """The bottle's bottom on a wall with any normal: both ends of 24 mm are as high."""
    shape, _ = SHAPES["bottle"]
    if form == "png":
        picture(tmp_path / "one.png", shape, 5.0, blur=1.0, noise=12.0)
    else:
        digitized(tmp_path / "one.csv", shape, 400, 0.1)
    normal = WALLS[wall]
    support = {"type": "palm", "point": [0.0, 0.0], "normal_angle": normal}
    body = {"shape": "outline", "file": str(tmp_path / f"one.{form}"), "mass": 0.1, "against": wall}
    body |= {"scale": "0.2 mm"} if form == "png" else {}
    # The bottom, along -y of the picture, faces the wall.
    body |= {"position": [0.05 * math.cos(normal), 0.05 * math.sin(normal)], "angle": normal - 0.5 * math.pi}
    scene = load(SCENE).changed({"supports": {wall: support}, "object": body})
    heights = np.array(scene.object.vertices)[:, 1]
    lowest = np.flatnonzero(heights < heights.min() + 1e-6 * scene.object.size)
    assert len(lowest) == 2
    assert np.ptp(np.array(scene.object.vertices)[lowest, 0]) == pytest.approx(0.024, abs=2e-3)


BESIDE_A_WALL = """
schema_version: 1
finger:
  rod: {length: 0.12, diameter: 0.008, density: 1070.0, youngs_modulus: 4.3636e+5}
  tendons: {offset: 0.003, min_tension: 0.0, max_tension: 5.0, time_constant: 0.03}
  damping: {material: 2.0e-6}
  base: {position: [0.0, -0.042], angle: -90 deg}
  half_thickness: 0.004
object: {shape: circle, diameter: 0.04, mass: 0.03, position: [0.025, 0.0], against: wall}
supports: {wall: {type: palm, point: [0.0, 0.0], normal_angle: 0.0}}
contacts: {friction: 0.8, normal_force_max: 5.0, middle: on, tip: on}
gravity: [0.0, 0.0, -9.81]
objective: least_tension
"""


@pytest.mark.deep
def test_a_grasp_states_what_the_noise_of_its_outline_changes(tmp_path):
    """A bottle on a wall, from a picture and as it is: two contacts of the wall, tensions within the stated change."""
    neck = shapely.box(-7, -40, 7, -20)
    shape = shapely.union_all([rounded(40, 50, 8), neck])
    picture(tmp_path / "one.png", shape, 6.0, blur=3.0, noise=8.0)
    (tmp_path / "scene.yaml").write_text(BESIDE_A_WALL)
    scene = load(tmp_path / "scene.yaml")
    place = {"mass": 0.03, "position": [0.025, 0.0], "against": "wall"}
    measured = {"shape": "outline", "file": str(tmp_path / "one.png"), "scale": 1e-3 / 6.0} | place
    result = cg.optimize_grasp(scene.changed({"object": measured}))
    # Arcs of the exact shape in chords of 0.09 rad, which count as a curve.
    exact = shapely.union_all([shapely.box(-12, -17, 12, 17).buffer(8, quad_segs=18), neck])
    corners = 1e-3 * (np.array(exact.exterior.coords[:-1]) - np.array(shape.centroid.coords[0]))
    truth = cg.optimize_grasp(scene.changed({"object": {"shape": "polygon", "vertices": corners.tolist()} | place}))
    for grasp in (result, truth):
        assert sum(contact.name.startswith("wall.") for contact in grasp.contacts) == 2
    stated = abs(result.outline.change.tension_change)
    assert 0.0 < stated < 0.02
    assert result.tension == pytest.approx(truth.tension, rel=stated)
