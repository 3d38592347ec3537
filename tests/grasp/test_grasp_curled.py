"""Fingers that curl up, by shapely."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from benchmarks.grasp_images import scene_of
from benchmarks.grasp_populations import document
from continuum_grasp import SolverError, optimize_grasp
from continuum_grasp.scene import GraspScene


def apart(points, half):
    """Least distance of a point of a line from what follows beyond half a circle of the half thickness."""
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    least = np.inf
    for k in range(len(points)):
        after = points[s - s[k] > np.pi * half]
        if len(after) > 1:
            least = min(least, shapely.LineString(after).distance(shapely.Point(points[k])))
    return least


def scene(length, half_thickness, diameter, position, base, angle, **changes):
    """A long thin finger from a palm on which a light disc stands."""
    return GraspScene.model_validate(
        {
            "finger": {
                "rod": {"length": length, "linear_density": 0.02, "bending_stiffness": 0.002},
                "half_thickness": half_thickness,
                "tendons": {"offset": 0.0025, "max_tension": 120.0},
                "base": {"position": base, "angle": angle},
            },
            "object": {"shape": "circle", "diameter": diameter, "mass": 0.02, "position": position},
            "supports": {"palm": {"type": "palm", "point": (0.0, 0.0), "normal_angle": 0.0}},
            "contacts": {"friction": 0.8, "normal_force_max": 60.0, "middle": "auto", "tip": "on"} | changes,
            "gravity": [0.0, 0.0, -9.81],
            "upright": True,
            "fidelity": {"family": "matched_clothoid", "elements": 4, "bending_range": 6.2},
            "solver": {"effort": "quick"},
            "stability": "ignore",
        }
    )


@pytest.mark.parametrize(
    "asked",
    [
        (0.38346, 0.00541, 0.03238, (0.01619, 0.03215), (0.02513, -0.09377), -0.07601),
        (0.30076, 0.00377, 0.03100, (0.01550, 0.02339), (0.04869, -0.07145), 0.24465),
    ],
)
def test_where_the_best_posture_passes_through_itself_another_one_is_found(asked):
    """Both scenes had a verified grasp that did."""
    grasp = optimize_grasp(scene(*asked))
    backbone, half = grasp.arrays["finger.backbone"][:, 1:3], asked[1]
    assert shapely.LineString(backbone).is_simple
    assert apart(backbone, half) > 2.0 * half - 1e-4 * asked[0]


@pytest.mark.deep
def test_where_every_posture_passes_through_itself_other_contacts_are_named():
    asked = (0.3, 0.003, 0.03, (0.015, 0.0), (0.0036, -0.03), -0.5 * np.pi)
    with pytest.raises(SolverError, match=r"contacts\.middle = auto"):
        optimize_grasp(scene(*asked, middle="on"))
    other = optimize_grasp(scene(*asked, middle="auto"))
    assert shapely.LineString(other.arrays["finger.backbone"][:, 1:3]).is_simple


@pytest.mark.xfail(reason="rods find a grasp here whose fingers are apart, allowed to cross or not", strict=False)
def test_where_the_best_postures_cross_others_are_found():
    """Fingers keep apart in the problem only once they crossed in an attempt."""
    asked = scene_of(document("two", 6), 8)
    far = {}
    for overlap in ("allow", "forbid"):
        arrays = optimize_grasp(asked.changed({"overlap": overlap})).arrays
        lines = [shapely.LineString(arrays[f"{name}.backbone"][:, 1:3]) for name in asked.named_fingers]
        far[overlap] = lines[0].distance(lines[1])
    thick = sum(float(setup.finger.profile.half_thickness(0.0)) for setup in asked.setups)
    assert far["allow"] < 0.9 * thick
    assert far["forbid"] > thick - 1e-4 * asked.setups[0].finger.rod.length


@pytest.mark.xfail(reason="all starts of the rods cross here", strict=False)
def test_three_fingers_settle_side_by_side():
    """Where runs keep the nearest places apart alone, whatever the direction, none finds this."""
    asked = scene_of(document("three", 90), 8)
    grasp = optimize_grasp(asked)
    lines = [shapely.LineString(grasp.arrays[f"{name}.backbone"][:, 1:3]) for name in asked.named_fingers]
    half = [float(setup.finger.profile.half_thickness(0.0)) for setup in asked.setups]
    for k, m in asked.pairs:
        assert lines[k].distance(lines[m]) > half[k] + half[m] - 1e-4 * asked.setups[0].finger.rod.length
