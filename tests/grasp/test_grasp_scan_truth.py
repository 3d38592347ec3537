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
from continuum_grasp.grasp.starts import basins
from continuum_grasp.grasp.starts.starts import basin_starts, make_starts
from tests.marks import every

NARROW = (217, 471, 653, 763, 818, 856, 906, 925, 946, 976, 1381, 1544, 1687, 1753, 1898, 1940, 2454, 2650, 2707)
STEEP = (20, 226, 585, 682, 1214, 1314, 1739, 2250, 2363, 2957)
"""Scenes of one finger that coarser or more hasty scans miss: short feasible pieces, narrow basins, roots that nearly
merge, curvatures at their limits, tips that touch with their sides."""
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


@pytest.mark.parametrize("seed", WITH_SEVERAL)
def test_a_scan_with_four_times_the_places_has_no_other_basins(seed, monkeypatch):
    known = estimates(seed)
    monkeypatch.setattr(basins, "_PLACES", 4 * basins._PLACES)
    assert known == pytest.approx(estimates(seed), rel=0.01)
