"""Grasps of outlines that are not convex, against unions by hand, discs, and depths by shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.interpolate import CubicSpline

from benchmarks.grasp_images import drawn
from benchmarks.grasp_images import scene_of as scene_drawn
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import load
from tests.marks import few

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
    assert whole.status is union.status
    # Tables of distances round their corners otherwise.
    assert whole.tension == pytest.approx(union.tension, rel=1e-4)
    assert depth(whole, ELL) < 2e-6


def outline_of(scene):
    """Vertices of the object of a scene in its own frame."""
    return np.concatenate([np.asarray(part.outline()) for part in scene.object.parts])


@pytest.mark.parametrize("seed", few([855, 409, 126, 5, 181, *range(8)], 3))
def test_grasps_of_random_outlines_keep_clear_of_them(seed):
    """Between the teeth of an outline too; what is not held says how much of the load is not."""
    scene = scene_drawn(drawn("outline", seed), 8)
    grasp = optimize_grasp(scene, raise_on_failure=False)
    if not grasp.solved:
        assert grasp.reasons or grasp.advice
        return
    assert grasp.certificate.passed
    assert depth(grasp, outline_of(scene)) < 2e-5 * scene.object.size


def disc_scene(folder, corners, share):
    """The mug, its rim drawn by chords of a circle."""
    turns = np.arange(corners) * 2.0 * np.pi / corners
    np.savetxt(folder / "rim.csv", 0.04 * np.column_stack([np.cos(turns), np.sin(turns)]), delimiter=",")
    body = {"shape": "outline", "file": str(folder / "rim.csv"), "tolerance": share * 0.08, "mass": 0.3}
    changes = {"object": body | {"position": [0.04, 0.0], "against": "palm"}, "friction_states": "pulled"}
    return load("configs/grasp/mug.yaml", changes)


@pytest.mark.parametrize("share", few([2e-2, 5e-3, 1e-3], 1))
def test_a_rim_drawn_by_chords_is_held_as_the_disc_is(tmp_path, share):
    """As nearly as the drawing is: a chord's middle is off by its share of the diameter at most."""
    disc = optimize_grasp(load("configs/grasp/mug.yaml", {"friction_states": "pulled"})).tension
    grasp = optimize_grasp(disc_scene(tmp_path, 192, share))
    assert grasp.tension == pytest.approx(disc, rel=2.0 * share)
    assert grasp.outline.deviation <= share * 0.08
