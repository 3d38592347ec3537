"""Fingers that curl up, by shapely; from inside: the check gets curves made here, as no grasp found fails it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from continuum_grasp import SolverError, optimize_grasp
from continuum_grasp.grasp.certificate.check import self_overlap
from continuum_grasp.scene import GraspScene


def rod(curvatures, half):
    """A finger of length 1 whose curvature is linear between values at even places, as the check sees it."""
    s = np.linspace(0.0, 1.0, 801)
    curvature = np.interp(s, np.linspace(0.0, 1.0, len(curvatures)), curvatures)
    angles = np.concatenate([[0.0], np.cumsum(0.5 * (curvature[1:] + curvature[:-1]) * np.diff(s))])
    middle = 0.5 * (angles[1:] + angles[:-1])
    points = np.concatenate([[0.0], np.cumsum(np.exp(1j * middle) * np.diff(s))])
    points = np.stack([points.real, points.imag], axis=1)
    edges = SimpleNamespace(edges=s)
    return SimpleNamespace(points=points, angles=angles, rod=edges, thickness=np.full(s.size, half), length=1.0)


def apart(points, half):
    """Least distance of a point of a line from what follows beyond half a circle of the half thickness."""
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    least = np.inf
    for k in range(len(points)):
        after = points[s - s[k] > np.pi * half]
        if len(after) > 1:
            least = min(least, shapely.LineString(after).distance(shapely.Point(points[k])))
    return least


def test_a_circle_that_is_all_but_closed_or_passed_again():
    half, turns = 0.004, 0.99
    ends = 2.0 * np.sin(np.pi * (1.0 - turns)) / (2.0 * np.pi * turns)
    assert -self_overlap(rod([2.0 * np.pi * turns] * 2, half)) == pytest.approx(ends - 2.0 * half, rel=1e-3)
    assert self_overlap(rod([2.0 * np.pi * 1.2] * 2, half)) > 1.999 * half


def test_a_finger_that_turns_by_less_than_half_a_circle_cannot_reach_itself():
    assert self_overlap(rod([3.0, 3.0], 0.05)) < 0.0
    assert self_overlap(rod([0.0, 0.0], 0.05)) < 0.0


def test_depth_agrees_with_distances_of_random_fingers():
    """With a finger mirrored and thicker ones; those that cross are deeper than they are thick."""
    rng, crossed = np.random.default_rng(5), 0
    for _ in range(25):
        curvatures, half = rng.normal(6.0, 7.0, 4), rng.uniform(0.002, 0.02)
        finger = rod(curvatures, half)
        if np.abs(np.diff(finger.angles)).sum() < np.pi:
            continue
        found, least = self_overlap(finger), apart(finger.points, half)
        assert self_overlap(rod(-curvatures, half)) == pytest.approx(found, abs=1e-9)
        if shapely.LineString(finger.points).is_simple:
            assert found == pytest.approx(2.0 * half - least, abs=1e-4)
        else:
            crossed += 1
            assert found > 2.0 * half - 1e-9
    assert crossed > 3


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
            "gravity": {"mode": "out_of_plane", "magnitude": 9.81, "tilt": "ignore"},
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


def test_where_every_posture_passes_through_itself_the_message_says_so():
    asked = (0.3, 0.003, 0.03, (0.015, 0.0), (0.0036, -0.03), -0.5 * np.pi)
    with pytest.raises(SolverError, match="no grasp was found in which finger does not pass through itself") as error:
        optimize_grasp(scene(*asked, middle="on").changed({"fidelity.elements": 8}))
    assert "shorter finger" in error.value.advice
