"""How far an object is from what should hold it, where its pose may be chosen; and what rounding leaves."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import continuum_grasp as cg
from continuum_grasp.base import InputError

MUG = Path(__file__).parents[2] / "configs" / "grasp" / "mug.yaml"
RADIUS = 0.04
ON = {"supports.palm.touch": "on"}
EXACT = 1e-4  # m


@pytest.mark.parametrize("free", [None, {"y": [-0.01, 0.01]}, {"angle": [-0.1, 0.1]}, {"x": [RADIUS + EXACT, 0.05]}])
def test_a_gap_that_no_pose_closes_is_named_at_load(free):
    at = {**ON, "object.position": [RADIUS + EXACT, 0.0], "object.free": free}
    with pytest.raises(
        InputError, match=r"supports.palm should touch the object, which is (0.0001|8.889e-05) m"
    ) as caught:
        cg.load(MUG, at)
    assert caught.value.key == "supports.palm"


@pytest.mark.parametrize(("share", "loads"), [(0.999, False), (1.001, True)])
def test_a_pose_that_closes_the_gap_is_taken(share, loads):
    at = {**ON, "object.position": [RADIUS + EXACT, 0.0], "object.free": {"x": [RADIUS + EXACT - share * EXACT, 0.05]}}
    if loads:
        cg.load(MUG, at)
    else:
        with pytest.raises(InputError, match="should touch the object"):
            cg.load(MUG, at)


def test_the_range_of_a_gap_holds_that_of_all_poses():
    """A box near a wall and a peg, against many poses by brute force."""
    free = {"x": [0.05, 0.06], "y": [-0.01, 0.02], "angle": [-0.3, 0.8]}
    box = {"shape": "box", "width": 0.03, "height": 0.05, "mass": 0.3, "position": [0.055, 0.0], "free": free}
    peg = {"type": "point", "position": [0.2, 0.05], "radius": 0.01}
    scene = cg.load(MUG, {"object": box, "supports.peg": peg})
    (wall,), (round_one,) = scene.walls, scene.pegs
    rng = np.random.default_rng(1)
    corners = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * [0.015, 0.025]
    gaps = []
    for _ in range(100):
        x, y, turn = (rng.choice([low, high, rng.uniform(low, high)]) for low, high in free.values())
        c, s = math.cos(turn), math.sin(turn)
        world = corners @ np.array([[c, s], [-s, c]]) + [x, y]
        moved = scene.changed({"object.position": [x, y], "object.angle": turn})
        gaps.append((world[:, 0].min(), moved.object.distance(round_one.position) - round_one.radius))
    for body, found in zip((wall, round_one), np.array(gaps).T, strict=True):
        least, most = scene.gap_range(body)
        assert least <= found.min()
        assert found.max() <= most
    assert scene.gap_range(wall) == pytest.approx(
        (0.05 - 0.015 * math.cos(0.8) - 0.025 * math.sin(0.8), 0.06 - 0.015), abs=1e-4
    )


@pytest.mark.parametrize(("depth", "loads"), [(0.999e-6, True), (1.001e-6, False)])
def test_a_base_on_the_object_to_rounding_is_outside(depth, loads):
    """Up to a millionth of the object's size, as objects lie on supports."""
    half = cg.load(MUG).finger.thickness_radius
    at = {"object.position": [RADIUS, 0.0], "finger.base.position": [RADIUS, -RADIUS - half + depth * RADIUS]}
    if loads:
        cg.load(MUG, at)
    else:
        with pytest.raises(InputError, match=r"finger.base lies 4.004e-08 m inside the object"):
            cg.load(MUG, at)


def test_outlines_of_many_corners_are_taken():
    turns = 2.0 * np.pi * np.arange(200) / 200
    corners = [[RADIUS * math.cos(t), RADIUS * math.sin(t)] for t in turns.tolist()]
    body = {"shape": "polygon", "vertices": corners, "mass": 0.3, "position": [RADIUS, 0.0]}
    assert cg.load(MUG, {"object": body}).object.size == pytest.approx(RADIUS)
