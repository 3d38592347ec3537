"""Objects that lie against supports, against shapely and closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from continuum_grasp.base import InputError
from continuum_grasp.scene import load

MUG = "configs/grasp/mug.yaml"
DISC = {"shape": "circle", "diameter": 0.06}
SHAPES = {
    "disc": DISC,
    "box": {"shape": "box", "width": 0.05, "height": 0.03, "corner_radius": 0.004},
    "superellipse": {"shape": "superellipse", "width": 0.05, "height": 0.03, "exponent": 5.0},
    "polygon": {
        "shape": "polygon",
        "vertices": [[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.06], [0, 0.06]],
    },
    "union": {
        "shape": "union",
        "members": [DISC, {"shape": "ellipse", "width": 0.02, "height": 0.01, "position": [0.04, 0.01], "angle": 0.4}],
        "center_of_mass": [0.0, 0.0],
    },
}
PALM = {"type": "palm", "point": [0.01, 0.0], "normal_angle": 0.3}
SUPPORTS = {
    "palm": PALM,
    "edge": {"type": "line", "start": [-0.5, -0.1], "end": [0.5, -0.1]},
    "peg": {"type": "point", "position": [0.16, -0.08], "radius": 0.005},
    "groove": {"type": "v_groove", "apex": [0.0, -0.3], "opening_angle": 1.8, "axis_angle": 1.4},
}
NORMALS = {"palm": 0.3, "edge": 0.5 * math.pi}


def placed(shape, against, supports, **keys):
    body = SHAPES[shape] | {"mass": 0.1, "position": [0.1, 0.05], "angle": 0.7, "against": against} | keys
    chosen = {name: SUPPORTS[name] | {"touch": "off"} for name in supports}
    return load(MUG).changed({"supports": chosen, "object": body, "finger.base.position": [3.0, 3.0]})


def outline(scene):
    """The object in the world, its curved parts by many points."""
    x, y, angle = scene.object.pose
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    rings = [np.array(part.outline(40_000)) @ turn + (x, y) for part in scene.object.parts]
    return shapely.union_all([shapely.Polygon(ring) for ring in rings])


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", NORMALS)
def test_an_object_moves_along_the_normal_until_it_touches(shape, name):
    scene = placed(shape, name, [name])
    normal, point = np.array([math.cos(NORMALS[name]), math.sin(NORMALS[name])]), scene.walls[0].point
    heights = (np.array(outline(scene).convex_hull.exterior.coords) - point) @ normal
    assert heights.min() == pytest.approx(0.0, abs=1e-8)
    moved = np.array(scene.object.position) - (0.1, 0.05)
    assert moved @ [-normal[1], normal[0]] == pytest.approx(0.0, abs=1e-15)
    assert scene.object.angle == 0.7
    assert scene.changed({"object.mass": 0.2}).object.position == pytest.approx(scene.object.position, abs=1e-15)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("against", [["palm", "edge"], ["peg"], ["edge", "peg"], ["groove"]], ids=str)
def test_an_object_touches_all_that_it_lies_against(shape, against):
    keys = {"position": [0.0, 0.0]} if against == ["groove"] else {}
    scene = placed(shape, against, against, **keys)
    body = outline(scene)
    for wall in scene.walls:
        heights = (np.array(body.convex_hull.exterior.coords) - wall.point) @ wall.normal
        assert heights.min() == pytest.approx(0.0, abs=1e-8)
    for peg in scene.pegs:
        assert body.distance(shapely.Point(peg.position)) == pytest.approx(peg.radius, abs=1e-8)


def test_an_object_against_a_support_follows_its_shape_and_angle():
    scene = load(MUG, ["object.against=palm"])
    assert scene.changed({"object.diameter": 0.05}).object.position == pytest.approx((0.025, 0.0), abs=1e-15)
    box = placed("box", "palm", ["palm"], corner_radius=0.0)
    corner = math.hypot(0.05, 0.03) / 2
    turned = box.changed({"object.angle": 0.3 + math.atan2(0.03, 0.05)}).object.position
    normal = np.array([math.cos(0.3), math.sin(0.3)])
    assert (np.array(turned) - PALM["point"]) @ normal == pytest.approx(corner, abs=1e-12)


def test_a_search_starts_where_a_free_object_touches():
    free = ["object.against=palm", "object.position=[0.05,0.01]", "object.free={x: [0.03, 0.06], y: [0.0, 0.02]}"]
    assert load(MUG, free).object.position == pytest.approx((0.04, 0.01))
    with pytest.raises(InputError, match=r"free\.x = \[0\.045, 0\.06\] does not hold"):
        load(MUG, [*free, "object.free.x=[0.045, 0.06]"])


def test_a_table_in_the_plane_is_a_support_of_motions():
    table = {"friction": 0.3, "point": [0.0, -0.2], "normal_angle": 0.5 * math.pi}
    changes = {"object.against": ["table", "palm"], "table": table, "out_of_plane_gravity": 0.0}
    scene = load("configs/simulate/close_on_mug.yaml").changed(changes)
    assert scene.object.position == pytest.approx((0.04, -0.16))


@pytest.mark.parametrize(
    ("against", "supports", "message"),
    [
        ("plam", ["palm"], "no support 'plam'; did you mean 'palm'"),
        ("palm", [], "no support 'palm'"),
        (["palm", "edge", "peg"], ["palm", "edge", "peg"], "more than the two surfaces"),
        (["palm", "groove"], ["palm", "groove"], "more than the two surfaces"),
    ],
)
def test_supports_that_place_nothing_are_refused(against, supports, message):
    with pytest.raises(InputError, match=rf"object\.against.*{message}"):
        placed("disc", against, supports)


def test_parallel_supports_and_the_end_of_an_edge_are_refused():
    two = {"palm": PALM, "other": PALM | {"normal_angle": 0.3 + math.pi, "point": [1.0, 0.0]}}
    with pytest.raises(InputError, match="are parallel"):
        load(MUG, {"supports": two, "object.against": ["palm", "other"]})
    short = {"edge": {"type": "line", "start": [0.2, -0.1], "end": [0.3, -0.1]}}
    with pytest.raises(InputError, match="beside the ends of edge"):
        load(MUG, {"supports": short, "object.against": "edge"})


@pytest.mark.parametrize("off", [-5.5e-5, -1e-6, 1e-6, 5.5e-5])
def test_an_object_that_all_but_touches_is_refused(off):
    position = {"object.position": [0.04 + off, 0.0]}
    with pytest.raises(InputError, match=r"supports\.palm.*object\.against"):
        load(MUG, position)
    assert load(MUG, position | {"object.against": "palm"}).object.position == pytest.approx((0.04, 0.0), abs=1e-15)


@pytest.mark.parametrize("exponent", [2.0, 3.0, 12.0])
def test_distances_from_a_superellipse_are_exact(exponent):
    body = SHAPES["superellipse"] | {"exponent": exponent, "mass": 0.1, "position": [0.0, 0.0]}
    part = load(MUG).changed({"object": body, "supports": {}}).object.parts[0]
    t = np.linspace(0.0, math.tau, 200_001)
    ring = shapely.Polygon(
        np.column_stack(
            [r * np.copysign(np.abs(f) ** (2 / exponent), f) for r, f in ((0.025, np.cos(t)), (0.015, np.sin(t)))]
        )
    )
    for x, y in np.random.default_rng(1).uniform(-0.04, 0.04, (30, 2)):
        point = shapely.Point(x, y)
        truth = ring.exterior.distance(point) * (-1.0 if ring.contains(point) else 1.0)
        assert part.distance((x, y)) == pytest.approx(truth, abs=2e-9)
