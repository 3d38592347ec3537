"""Grasps of outlines that are not convex: against unions by hand, and depths by shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.interpolate import CubicSpline

from continuum_grasp.errors import SolverError
from continuum_grasp.grasp import certify, optimize_grasp
from continuum_grasp.grasp.problem import solver_run
from continuum_grasp.grasp.search import Search
from continuum_grasp.model.surfaces import surface_of
from continuum_grasp.nlp import Budget
from continuum_grasp.scene.load import load

# An L, 60 mm by 60 mm of bars 25 mm wide, whose foot is away from the palm; from its center of mass.
ELL = np.array([(0.0, 0.0), (0.06, 0.0), (0.06, 0.025), (0.025, 0.025), (0.025, 0.06), (0.0, 0.06)]) - 0.025
BARS = (
    {"shape": "box", "width": 0.06, "height": 0.025, "position": (0.005, -0.0125)},
    {"shape": "box", "width": 0.025, "height": 0.035, "position": (-0.0125, 0.0175)},
)
PLACED = {"mass": 0.1, "center_of_mass": (0.0, 0.0), "position": (0.025, 0.0)}


def scene_of(body, *changes):
    return load("configs/grasp/mug_arcs.yaml", ["solver.effort=quick", *changes]).changed({"object": PLACED | body})


def depth(result, vertices):
    """Greatest depth of the fingers in a polygon [m], by shapely at 2,000 places of each."""
    x, y, angle = result.arrays["object.pose"]
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    solid, found = shapely.Polygon(np.asarray(vertices) @ turn + (x, y)), []
    for setup in result.scene.setups:
        line = result.arrays[f"{setup.name}.backbone"]
        points = CubicSpline(line[:, 0], line[:, 1:3])(np.linspace(0.0, line[-1, 0], 2000))
        away = shapely.distance(solid, shapely.points(points))
        found.append(float((setup.finger.profile.half_thickness.constant - away).max()))
    return max(found)


@pytest.mark.deep
def test_an_outline_is_grasped_as_the_union_of_its_bars_is():
    whole = optimize_grasp(scene_of({"shape": "polygon", "vertices": ELL.tolist()}))
    union = optimize_grasp(scene_of({"shape": "union", "members": BARS}))
    assert whole.status == union.status == "optimal"
    assert whole.tension == pytest.approx(union.tension, rel=1e-9)


def test_a_contact_goes_on_where_a_face_ends(monkeypatch):
    """From the face beside the corner of a tooth that the tip of the best grasp is on; not beyond its end, 8 % more."""
    scene = load("configs/grasp/gear.yaml", ["fidelity.elements=2"])
    search = Search(scene, Budget.of(scene.solver))
    search.run()
    solver, best, (part,) = search.best.solver, search.best.attempt, scene.object.parts
    every = surface_of(part).features(part)
    beside = best.features | {"finger.tip": every[every.index(best.features["finger.tip"]) - 1]}
    monkeypatch.setattr(solver_run, "contact_features", lambda *_: beside)
    moved = solver.run(scene, best.start, Budget())
    stopped = solver.run(scene, best.start, Budget(), features=beside)
    assert moved.optimal
    assert stopped.optimal
    assert moved.objective == pytest.approx(best.objective, rel=1e-6)
    assert moved.features == best.features
    assert stopped.objective > 1.05 * best.objective


def random_outline(seed):
    """From the centroid [m]; teeth, notches and hooks between 20 and 50 mm from the center."""
    rng = np.random.default_rng(seed)
    while True:
        count = int(rng.integers(6, 14))
        turns = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 2.0 * np.pi / count
        reach = rng.uniform(0.5, 1.0, count) * rng.uniform(0.03, 0.05)
        solid = shapely.Polygon(np.column_stack([reach * np.cos(turns), reach * np.sin(turns)]))
        if solid.is_valid and solid.area < 0.98 * solid.convex_hull.area:
            return np.round(np.array(solid.exterior.coords[:-1]) - np.array(solid.centroid.coords[0]), 9)


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(24))
def test_certified_grasps_of_random_outlines_are_clear_of_them(seed):
    corners = random_outline(seed)
    body = {"shape": "polygon", "vertices": corners.tolist(), "position": (float(-corners[:, 0].min()), 0.0)}
    scene = scene_of(body, "fidelity.family=clothoid", "solver.max_total_iterations=1500", "contacts.friction=0.7")
    try:
        result = optimize_grasp(scene)
    except SolverError:
        return
    assert result.certificate.passed
    assert depth(result, corners) < 2e-6
    # The same fingers beside an object that is elsewhere.
    arrays = dict(result.arrays)
    arrays["object.pose"] = arrays["object.pose"] + [0.0, -1e-3, 0.0]
    assert not certify(scene, arrays).passed
