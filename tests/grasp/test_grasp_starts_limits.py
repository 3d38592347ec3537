"""The limits by which starts are made; from inside: depths and imbalances on either side of each are put in.

The limits by which starts are made: each decides otherwise on either side of it.
"""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from grasp_scenes import UPRIGHT, make_scene

from continuum_grasp.grasp.starts import basins, starts
from continuum_grasp.grasp.starts.basins import Basins
from continuum_grasp.grasp.starts.candidates import spread_order
from continuum_grasp.grasp.starts.scan import task, touching
from continuum_grasp.grasp.starts.scan.touching import Branch
from continuum_grasp.grasp.starts.starts import doubt

ON = frozenset({"finger.middle", "finger.tip", "palm"})


def branch(count=2, **last):
    """Postures that are alike, but for numbers of the last one."""
    values = {name: np.zeros(count) for name in Branch.__dataclass_fields__}
    values |= {"side": np.ones(count, int), "joint": np.full(count, 0.5), "ends": np.zeros((count, 4))}
    for name, value in last.items():
        values[name] = values[name].copy()
        values[name][-1] = value
    return Branch(**values)


def neighbors(**last):
    return bool(basins.along_outline(branch(**last))[0, 1])


def neighboring_arcs(**last):
    return bool(basins.in_bends(branch(**last), 0.05)[0, 1])


def within(curvature):
    """Whether a curve to the first contact may be bent so much, whose limit is 8 per length."""
    bounds = {
        "bounds": (0.1, 0.9),
        "bending_range": 6.0,
        "counts": (1, 1),
        "middles": (True,),
        "limits": np.array([8.0]),
    }
    return bool(touching._within(SimpleNamespace(**bounds), branch(1, ends=curvature))[0])


def judged(depth):
    """Whether postures so deep in something are left."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(basins, "obstruction", lambda task, knots, *_: np.full(len(knots), depth))
        return Basins(make_scene("matched_clothoid", UPRIGHT), ON).postures > 0


def violates_nothing(depth=0.0, bent=0.0):
    straight = SimpleNamespace(limits=np.full(65, 8.0), bending_range=100.0, counts=(1,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(task, "obstruction", lambda *_: np.array([depth]))
        wrong = task.violation(straight, np.array([[0.0, 1.0]]), np.full((1, 2), bent), np.zeros((1, 0)))
    return bool(wrong[0] == 0.0)


def comes_before_another(score):
    """Whether a posture 1.0 from the best comes before another one far away that is worse by ``score``."""
    features = np.array([[0.0], [1.0], [18.0]])
    return spread_order(np.array([0.0, 1.0, 1.0 + score]), features, 3)[1] == 2


LIMITS = [
    ("places apart of neighbors", 1.6, lambda x: neighbors(place=x)),
    ("the same round the end of the ring", 1.6, lambda x: neighbors(place=touching.PLACES - x)),
    ("joints apart of neighbors", 0.08, lambda x: neighbors(joint=0.5 + x)),
    ("curvatures apart of neighbors", 2.5, lambda x: neighbors(ends=np.array([0.0, x, x, 0.0]))),
    ("normals apart of neighbors", 0.5, lambda x: neighbors(tip_normal=x)),
    ("bends apart of neighboring arcs", 1.6 * 0.05, lambda x: neighboring_arcs(ends=np.array([x, x, x, x]))),
    ("curvature above its limit", 8.0 * 1.02, within),
    ("depth of a posture that counts", 2e-4, judged),
    ("depth of a rough start", 2e-3, lambda x: violates_nothing(depth=x)),
    ("score for a posture unlike the best", 0.5 * math.exp(-1.0), comes_before_another),
]  # fmt: skip


@pytest.mark.parametrize(("limit", "decides"), [row[1:] for row in LIMITS], ids=[row[0] for row in LIMITS])
def test_starts_are_otherwise_on_either_side_of_a_limit(limit, decides):
    assert decides((1.0 - 1e-6) * limit)
    assert not decides((1.0 + 1e-6) * limit)


def test_beyond_two_parts_in_a_hundred_imbalance_ranks_less():
    """What IPOPT brings to zero: there the doubt has its kink."""
    left = np.array([0.0, 0.01, 0.02 - 1e-9, 0.02, 0.03])
    steep, flat = np.diff(doubt(left))[[0, 3]] / 0.01
    assert steep == pytest.approx(10.0)
    assert flat == pytest.approx(2.0)
    assert doubt(left[2]) == pytest.approx(doubt(left[3]))


def test_basins_come_the_best_first():
    score = np.arange(20.0)[::-1]
    assert basins.minima(score, np.eye(20, dtype=bool)).tolist() == [*range(19, -1, -1)]


@pytest.mark.parametrize("part", ["left", "wrong", "above"])
def test_a_posture_that_cannot_hold_ranks_behind_all_that_can(part, monkeypatch):
    """What is left of the balance beyond the tensions' own weight, depth, and curvature above its limit cost as much as
    all tension that a finger has from 1 % of each, or 10 % of the curvature, on.
    """
    off = {"left": 2e-4, "wrong": 0.0, "above": 0.0}
    scan, some = Basins(make_scene("matched_clothoid", UPRIGHT), ON), branch(1)
    scan.task = SimpleNamespace(limits=np.array([8.0]))

    def score(off):
        found = np.array([off["left"]]), np.array([0.5]), np.zeros((1, 2))
        monkeypatch.setattr(basins, "imbalance", lambda *_: found)
        some.ends[:] = 8.0 * (1.0 + off["above"])
        block = SimpleNamespace(needed=np.zeros(1), cost=np.ones(1), high=np.ones(1))
        monkeypatch.setattr(basins, "finger_block", lambda *_: block)
        return float(scan._weighed(some, SimpleNamespace(violation=np.array([off["wrong"]]))).score[0])

    assert score(off) == pytest.approx(0.5)
    assert score(off | {part: off[part] + (0.1 if part == "above" else 0.01)}) == pytest.approx(1.5)


def test_of_one_finger_the_hundred_postures_with_least_in_the_way_are_weighed(monkeypatch):
    scene, on = make_scene("clothoid", UPRIGHT, elements=4), frozenset({"finger.tip"})
    weighed = []
    monkeypatch.setattr(starts.Weighing, "_weigh", lambda self, pose, found, *_: weighed.append(found[0].violation))
    starts.Weighing(scene, on).at_pose(scene.object.pose, 0)
    every = starts.find_candidates(scene, scene.setups[0], starts.base_poses(scene.setups[0], 0), scene.object.pose, on)
    wrong = np.sort(every.violation)
    assert len(wrong) > 200
    assert weighed[0].max() == wrong[100]
    assert len(weighed[0]) == np.count_nonzero(wrong <= wrong[100])
