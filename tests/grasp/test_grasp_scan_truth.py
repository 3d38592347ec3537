"""Starts against the benchmark's oracles: sequential quadratic programming from tables of its own, which share nothing
with the scan, and rods that are integrated here.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest

from benchmarks.grasp_oracle.scenes import scene_of
from benchmarks.grasp_oracle.truth import answers
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.starts.scan import touching as scan
from continuum_grasp.grasp.starts.starts import basin_starts, make_starts
from continuum_grasp.grasp.starts.supports import object_poses
from tests.grasp.test_grasp_starts import finger_at, starts_of
from tests.grasp.test_grasp_starts import scene_of as scene_at

NARROW = (217, 289, 471, 653, 763, 818, 856, 906, 925, 946, 976, 1381, 1544, 1687, 1753, 1898, 1940, 2454, 2650, 2707)
STEEP = (20, 226, 461, 585, 682, 1214, 1314, 1739, 1823, 2250, 2286, 2363, 2403, 2957)
"""Scenes of one finger that coarser or more hasty scans miss: short feasible pieces, narrow basins, roots that nearly
merge, curvatures at their limits, tips that touch with their sides."""
ROUGH = [
    (51, 0.01),
    (55, 0.01),
    (70, 0.01),
    (661, 0.01),
    (929, 0.01),
    (1071, 0.01),
    (1242, 0.04),
    (2197, 0.03),
    (2928, 0.01),
]
"""Scenes whose best posture few rough starts are near, and by what part their estimate may be off."""
TIPS = [("two", 2), ("two", 28), ("two", 58), ("two", 77), ("three", 13), ("three", 19)]
"""Scenes of fingers that touch with their tips alone."""
WITH_SEVERAL = (226, 1154, 1514)
"""Scenes with a second basin beside a side of few postures."""


@cache
def tensions(kind):
    return {row["seed"]: row["tension"] for row in answers(kind)}


def estimates(seed):
    """Of all basins of all sets of contacts [N], in order."""
    scene = scene_of("one", seed)
    found = [basin_starts(scene, mode) for mode in contact_modes(scene)]
    return sorted(start.estimate for starts, _ in filter(None, found) for start in starts)


@pytest.mark.parametrize("seed", NARROW + STEEP)
def test_the_best_basin_takes_the_tension_of_the_oracle(seed):
    assert estimates(seed)[0] == pytest.approx(tensions("one")[seed], rel=0.01)


@pytest.mark.parametrize(("seed", "part"), ROUGH)
def test_rough_starts_come_near_to_the_tension_of_the_oracle(seed, part):
    scene = scene_of("one", seed)
    found = [make_starts(scene, mode, 6) for mode in contact_modes(scene)]
    best = min(start.estimate for starts in found for start in starts if start.label == "scan")
    assert best == pytest.approx(tensions("one")[seed], rel=part)


@pytest.mark.parametrize(("kind", "seed"), TIPS)
def test_a_set_of_tips_takes_nearly_the_tension_of_the_oracle(kind, seed):
    scene = scene_of(kind, seed)
    starts = make_starts(scene, contact_modes(scene)[0], 8)
    found = np.array([start.estimate for start in starts if start.label == "scan"])
    assert np.nanmin(np.abs(found / tensions(kind)[seed] - 1.0)) < 0.06


@pytest.mark.parametrize("seed", WITH_SEVERAL)
def test_a_scan_with_four_times_the_places_has_no_other_basins(seed, monkeypatch):
    known = estimates(seed)
    monkeypatch.setattr(scan, "PLACES", 4 * scan.PLACES)
    assert known == pytest.approx(estimates(seed), rel=0.01)


@pytest.mark.parametrize("moved", ["object", "base"])
def test_what_is_out_of_reach_is_moved_into_reach(moved):
    """A tip 0.2 long and a disc half a meter away, one of which may move by a meter."""
    at, there = ((0.5, 0.15), (0.0, 0.0)) if moved == "object" else ((0.0, 0.15), (0.5, 0.0))
    body = {"shape": "circle", "diameter": 0.08, "position": at}
    free = {"free": {"x": (-0.5, 0.5)}} if moved == "object" else {}
    finger = finger_at(*there, 0.0, contacts={"middle": "off"}) | ({} if free else {"base_free": {"x": (-0.5, 0.5)}})
    assert starts_of(scene_at(body | free, {"f": finger}))[0].label == "scan"


def test_a_polygon_lies_on_four_of_its_faces():
    corners = 0.05 * np.exp(2j * math.pi * np.arange(12) / 12)
    body = {"shape": "polygon", "vertices": [(z.real, z.imag) for z in corners], "position": (0.0, 0.05)}
    floor = {"floor": {"type": "palm", "point": (0.0, 0.0), "normal_angle": 0.5 * math.pi}}
    free = {"free": {"y": (0.0, 0.1), "angle": (-3.0, 3.0)}}
    finger = {"f": finger_at(0.0, 0.3, math.pi, contacts={"middle": "off"})}
    poses = object_poses(scene_at(body | free, finger, supports=floor), frozenset({"floor"}))
    flat = [pose for pose in poses if abs(math.remainder(pose[2] - math.pi / 12, math.pi / 6)) < 1e-9]
    assert len(flat) == 4
