"""Starts against the benchmark's oracles; from inside: all starts of a mode, of which a result shows one grasp.

Starts against the benchmark's oracles: sequential quadratic programming from tables of its own, which share nothing
with the scan, and rods that are integrated here.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.grasp_oracle.scenes import scene_of
from benchmarks.grasp_oracle.truth import answers
from continuum_grasp.grasp.modes import contact_modes
from continuum_grasp.grasp.starts.candidates import find_candidates
from continuum_grasp.grasp.starts.scan import touching as scan
from continuum_grasp.grasp.starts.scan.curves import sample
from continuum_grasp.grasp.starts.starts import basin_starts, make_starts
from continuum_grasp.grasp.starts.supports import object_poses
from tests.grasp.test_grasp_starts import finger_at, starts_of, touching
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


def rod(curvature, force, direction):
    """Shape of a rod of length and E I one under a force at its tip, from its curvature at the base: d kappa / ds =
    -(tangent x force).
    """
    pull = force * np.exp(1j * direction)

    def slopes(s, y):
        tangent = 1j * np.exp(1j * y[0])
        return [y[1], -(np.conj(tangent) * pull).imag, tangent.real, tangent.imag]

    return solve_ivp(slopes, (0.0, 1.0), [0.0, curvature, 0.0, 0.0], rtol=1e-9, atol=1e-9, dense_output=True).sol


def rods_on_discs(count):
    """Random rods whose tips press on a disc at the edge of the friction cone, and where it is, per length."""
    rng = np.random.default_rng(5)
    while count:
        force, direction = math.exp(rng.uniform(-2.0, 4.4)), rng.uniform(-math.pi, math.pi)
        shape = rod(rng.uniform(-9.0, 9.0), force, direction)
        at = np.linspace(0.0, 1.0, 65)
        turn, curvature, x, y = shape(at)
        normal = np.exp(1j * (direction + rng.choice([-1, 1]) * (math.atan(0.5) - rng.uniform(0.0, 0.06))))
        center = complex(x[-1], y[-1]) - 0.22 * normal
        ahead = (normal * np.conj(1j * np.exp(1j * turn[-1]))).real < -0.05
        clear = np.abs(x[:-1] + 1j * y[:-1] - center).min() > 0.22
        if ahead and clear and np.abs(curvature).max() < 14.0 and np.abs(turn).max() < 5.0:
            count -= 1
            yield x + 1j * y, center


def test_a_rod_that_its_tip_bends_is_near_a_posture_of_the_scan():
    away = []
    for points, center in rods_on_discs(20):
        body = {"shape": "circle", "diameter": 0.08, "position": (0.2 * center.real, 0.2 * center.imag)}
        model = {"family": "matched_clothoid", "elements": 4, "bending_range": 6.28}
        scene = touching(body, "tip", base=(0.0, 0.0, 0.0)).changed({"fidelity": model})
        found = find_candidates(scene, scene.setups[0], [(0.0, 0.0, 0.0)], scene.object.pose, {"f.tip"})
        at = np.tile(np.linspace(0.0, 1.0, 65), (len(found), 1))
        away.append(np.abs(sample(found.knots, found.curvatures, at) - points).max(axis=1).min())
    # One is bent more at its tip than two clothoids can be.
    assert sorted(away)[-2] < 0.05


@pytest.mark.parametrize("moved", ["object", "base"])
def test_what_is_out_of_reach_is_moved_into_reach(moved):
    """A tip 0.2 long and a disc half a meter away, one of which may move by a meter."""
    at, there = ((0.5, 0.15), (0.0, 0.0)) if moved == "object" else ((0.0, 0.15), (0.5, 0.0))
    body = {"shape": "circle", "diameter": 0.08, "position": at}
    free = {"free": {"x": (-0.5, 0.5)}} if moved == "object" else {}
    finger = finger_at(*there, 0.0, contacts={"middle": "off"}) | ({} if free else {"base_free": {"x": (-0.5, 0.5)}})
    assert starts_of(scene_at(body | free, {"f": finger}))[0].label == "scan"


def test_a_polygon_lies_on_as_many_of_its_faces_as_poses_are_tried():
    corners = 0.05 * np.exp(2j * math.pi * np.arange(12) / 12)
    body = {"shape": "polygon", "vertices": [(z.real, z.imag) for z in corners], "position": (0.0, 0.05)}
    floor = {"floor": {"type": "palm", "point": (0.0, 0.0), "normal_angle": 0.5 * math.pi}}
    free = {"free": {"y": (0.0, 0.1), "angle": (-3.0, 3.0)}}
    finger = {"f": finger_at(0.0, 0.3, math.pi, contacts={"middle": "off"})}
    poses = object_poses(scene_at(body | free, finger, supports=floor), frozenset({"floor"}))
    flat = [pose for pose in poses if abs(math.remainder(pose[2] - math.pi / 12, math.pi / 6)) < 1e-9]
    assert len(flat) == 5
    assert len({round(turn, 6) for _, _, turn in flat}) == 5
