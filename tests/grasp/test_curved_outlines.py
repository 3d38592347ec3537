"""Polygons that stand for curves; from inside: pieces of the outline, as the grasp problem sees them.

Grasps of polygons with many corners are those of the curves that they are drawn on, wherever their corners are.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
import shapely

from benchmarks.grasp_images import mirrored
from benchmarks.grasp_phases import scene_of
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.grasp.judge import surfaces
from continuum_grasp.model import surface_of
from continuum_grasp.model.surfaces.offset_polygon import pieces_of
from continuum_grasp.scene import GraspScene, OffsetPolygon, load
from continuum_grasp.scene.curved_parts import curved
from continuum_grasp.scene.polygons import corners_of
from tests.marks import few

GROWN = 0.004
"""Half the thickness of what touches [m]."""


def on(points):
    return curved(OffsetPolygon(corners_of([(float(x), float(y)) for x, y in points])))


def oval(corners, phase=0.0, axes=(0.038, 0.042)):
    turns = 2.0 * np.pi * (np.arange(corners) + phase) / corners
    return np.column_stack([axes[0] * np.cos(turns), axes[1] * np.sin(turns)])


def notched():
    turns = np.linspace(0.15, 2.0 * np.pi - 0.15, 150)
    ring = 0.04 * np.column_stack([np.cos(turns), np.sin(turns)])
    return np.vstack([ring, [(0.02, -0.006), (0.02, 0.006)]])


def with_a_round_corner():
    turns = np.linspace(0.0, 0.5 * np.pi, 20)
    arc = np.array([0.03, 0.02]) + 0.01 * np.column_stack([np.cos(turns), np.sin(turns)])
    return np.vstack([arc, [(-0.04, 0.03), (-0.04, -0.03), (0.04, -0.03)]])


CURVES = {"oval": oval(100), "notched": notched(), "round corner": with_a_round_corner()}


@pytest.mark.parametrize(("corners", "phase"), few([(96, 0.5), (768, 0.25), (64, 0.0), (192, 0.0), (384, 0.5)], 2))
def test_a_disc_of_many_corners_is_held_as_the_disc_whatever_its_phase(corners, phase):
    disc = optimize_grasp(scene_of(0, 0.0))
    polygon = optimize_grasp(scene_of(corners, phase))
    assert polygon.status == disc.status == "optimal"
    assert polygon.tension == pytest.approx(disc.tension, rel=1e-3)


@pytest.mark.parametrize(("corners", "phase"), few([(160, 0.0), (80, 0.5), (320, 0.25)], 1))
def test_an_oval_of_many_corners_is_held_as_the_ellipse_that_it_is_drawn_on(corners, phase):
    found = []
    for shape in (
        {"shape": "ellipse", "width": 0.076, "height": 0.084},
        {"shape": "polygon", "vertices": oval(corners, phase).tolist()},
    ):
        body = shape | {"mass": 0.15, "position": [0.038, 0.0], "against": "palm"}
        found.append(optimize_grasp(load("configs/grasp/mug.yaml", {"object": body, "contacts.reserve": 0.0})).tension)
    assert found[1] == pytest.approx(found[0], rel=3e-3)


def test_the_mirror_image_of_an_oval_is_held_alike():
    body = {"shape": "polygon", "vertices": oval(150, 0.3).tolist(), "mass": 0.15, "position": [0.038, 0.0]}
    scene = load("configs/grasp/mug.yaml", {"object": body | {"against": "palm"}, "contacts.reserve": 0.0})
    image = GraspScene.model_validate(mirrored(scene.model_dump(exclude_unset=True)))
    tensions = [optimize_grasp(each).tension for each in (scene, image)]
    # Arcs are as long as they fit from the first corner on.
    assert tensions[1] == pytest.approx(tensions[0], rel=2e-3)


@pytest.mark.parametrize("name", CURVES)
def test_curves_pass_by_the_corners_and_distances_are_those_from_them(name):
    part, corners = on(CURVES[name]), CURVES[name]
    dense = []
    for face in part.faces:
        turns = face.normal + np.linspace(0.0, face.turn, 200 + int(5000 * face.turn))
        x, y = face.center
        arc = np.column_stack([x + face.radius * np.cos(turns), y + face.radius * np.sin(turns)])
        dense.append(arc if face.turn else np.array([face.start, face.end]))
    solid = shapely.Polygon(np.concatenate(dense)).buffer(0)
    assert shapely.distance(solid.exterior, shapely.points(corners)).max() < 2e-6
    points = np.random.default_rng(1).uniform(-0.06, 0.06, (2000, 2))
    there = shapely.points(points)
    true = shapely.distance(solid.exterior, there) * np.where(shapely.contains(solid, there), -1.0, 1.0)
    z = points @ [1.0, 1j]
    assert np.abs(surface_of(part).outline(part).distance(z) - true).max() < 1e-9
    found = surfaces.nearest(part, points)
    assert np.abs(found.distance - true).max() < 1e-9
    assert np.abs(found.point + found.distance[:, None] * found.normal - points).max() < 1e-12
    assert np.abs([part.distance((x, y)) for x, y in points[:200]] - true[:200]).max() < 1e-9
    for turn in np.linspace(0.0, 6.2, 50):
        way = np.array([math.cos(turn), math.sin(turn)])
        reach = float((np.concatenate(dense) @ way).max())
        assert part.support(turn) == pytest.approx(reach, abs=1e-9)
        assert surfaces.support_point(part, way) @ way == pytest.approx(reach, abs=1e-9)
        outermost = surface_of(part).outline(part).extremes(complex(*way), 1e-9)[0][0]
        assert np.array([outermost.real, outermost.imag]) @ way == pytest.approx(reach, abs=1e-9)


@pytest.mark.parametrize("name", CURVES)
def test_walks_along_curves_have_their_derivatives(name):
    part = on(CURVES[name])
    outline = surface_of(part).outline(part)
    w, step = np.random.default_rng(2).uniform(0.0, outline.period, 400), 1e-7
    joint = np.abs(w[:, None] - outline.joints).min(axis=1) < 2.0 * step
    before, at, after = (outline.walk(w[~joint] + k * step) for k in (-1, 0, 1))
    assert np.abs((after.point - before.point) / (2.0 * step) - at.dpoint).max() < 1e-6
    assert np.abs((after.angle - before.angle) / (2.0 * step) - at.dangle).max() < 1e-6


@pytest.mark.parametrize("number", [0, 17, 40])
def test_a_contact_slides_over_arcs_on_a_smooth_outline(number):
    """Along the grown outline: one speed, across the normal, over all arcs of a window, by differences."""
    part = on(oval(100))
    surface = surface_of(part)
    feature = surface.feature(part, number, GROWN)
    u = ca.SX.sym("u")
    at = surface.point(u, ca.SX(feature.numbers))
    center = ca.Function("center", [u], [at.point + GROWN * at.normal, at.normal])
    (low,), (high,) = feature.lower, feature.upper
    step = 1e-6 * (high - low)
    places = np.linspace(low + step, high - step, 301)
    ends = [np.array(center.map(len(places))(places[None] + side * step)[0]) for side in (-1.0, 1.0)]
    normal = np.array(center.map(len(places))(places[None])[1])
    speed = (ends[1] - ends[0]) / (2.0 * step)
    assert np.abs((speed * normal).sum(axis=0)).max() < 1e-7
    assert np.ptp(np.hypot(*speed)) < 1e-6 * np.hypot(*speed).max()
    # Every place is on the curve, with its normal.
    points = np.array(center.map(len(places))(places[None])[0]).T
    found = surfaces.nearest(part, points)
    assert found.distance == pytest.approx(np.full(len(points), GROWN), abs=1e-11)
    assert np.abs(found.normal - normal.T).max() < 1e-9
    # Beyond its end the next window begins.
    following, place = surface.beyond(part, feature, 1)
    next_at = surface.point(u, ca.SX(following.numbers))
    end = ca.Function("end", [u], [next_at.point])(*place)
    here = ca.Function("here", [u], [at.point])(high)
    assert np.array(end).ravel() == pytest.approx(np.array(here).ravel(), abs=1e-12)
    assert len(pieces_of(part)) > 7


def test_corners_that_are_no_points_of_a_curve_stay():
    turns = 2.0 * np.pi * np.arange(24) / 24
    bent_box = [(-0.04, 0.0), (0.04, 0.0), (0.04, 0.05), (0.0, 0.0515), (-0.04, 0.05)]
    roof = [(-0.005, -0.04), (0.005, -0.04), (0.005, 0.04), (0.0, 0.0402), (-0.005, 0.04)]
    for points in (0.04 * np.column_stack([np.cos(turns), np.sin(turns)]), bent_box, roof):
        assert on(points).bends == ()
    # Of a notch, its corners and sides.
    assert sum(face.turn == 0.0 for face in on(notched()).faces) == 3


def test_coordinates_in_micrometers_give_the_same_circle():
    part = on(np.round(oval(384, 0.3, (0.04, 0.04)), 6))
    radii = [face.radius for face in part.faces]
    assert len(radii) < 60
    # Of two arcs of a pair, one may be short, and then its radius says little.
    assert np.average(radii, weights=[face.turn for face in part.faces]) == pytest.approx(0.04, rel=1e-4)
    assert 0.025 < min(radii) < max(radii) < 0.06


def test_an_object_that_stands_on_a_corner_of_its_curve_stands_on_the_curve():
    """Corners are at the supports; between them the curve reaches farther."""
    ring = oval(120, 0.2)
    body = {"shape": "polygon", "vertices": ring.tolist(), "mass": 0.1, "position": [-float(ring[:, 0].min()), 0.0]}
    scene = load("configs/grasp/mug.yaml", {"object": body})
    (palm,) = scene.places
    assert abs(scene.gap_range(palm)[0]) < 1e-9
    assert 0.0 < scene.object.position[0] - body["position"][0] < 1e-5
