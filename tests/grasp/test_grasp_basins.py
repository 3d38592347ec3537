"""The scan of one finger's postures; from inside: bends, chords and imbalances of single postures.

The scan of one finger's postures, against curves traced finely and linear programming at single postures.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from grasp_scenes import UPRIGHT, make_scene
from scipy.optimize import brentq, linprog

from continuum_grasp.grasp.starts.basins import Basins
from continuum_grasp.grasp.starts.force import ForceBlock, Loads, imbalance
from continuum_grasp.grasp.starts.scan.curves import bends_to, chords, exact_bends


def ends(bend, turn, steps=4000):
    """End of a clothoid of length one by the midpoint rule."""
    s = (np.arange(steps) + 0.5) / steps
    return (1j * np.exp(1j * (bend * s + (turn - bend) * s**2))).mean()


def test_all_curves_in_a_direction_are_found():
    """Every sign change of a fine scan over the first curvature is among those from the table."""
    rng = np.random.default_rng(1)
    aims, turns = np.exp(1j * rng.uniform(0.0, math.tau, 25)), rng.uniform(-6.0, 6.0, 25)
    rows, guess = bends_to(aims, turns)
    bend, length, good = exact_bends(aims[rows], turns[rows], guess)
    # Near enough for Newton's method; with a fourth of the lines 2 in 1,000 roots are lost.
    assert np.abs(bend - guess)[good].max() < 0.02
    fine = np.linspace(-11.0, 11.0, 4001)
    for row, (aim, turn) in enumerate(zip(aims, turns, strict=True)):
        off = chords(fine, np.full(fine.shape, turn))[0] * np.conj(aim)
        at = np.flatnonzero((off.imag[:-1] * off.imag[1:] < 0.0) & (off.real[:-1] > 0.05))
        for k in at:
            root = brentq(lambda a, aim=aim, turn=turn: (ends(a, turn) * np.conj(aim)).imag, fine[k], fine[k + 1])
            mine = good & (rows == row) & (np.abs(bend - root) < 1e-4)
            # Two that nearly merge may lie between two lines of the table.
            assert mine.any() or (np.abs(at - k) < 60).sum() > 1
            if mine.any():
                assert length[mine][0] == pytest.approx(1.0 / abs(ends(root, turn)), rel=1e-5)


def test_forces_are_those_of_linear_programming():
    """Where balance is possible, the least tensions; tensions act on the sections alone, as those of a finger do."""
    rng = np.random.default_rng(3)
    loads = Loads(1.0, 1.0, -1j, 0.0, -1j, False)
    found, wanted = [], []
    for _ in range(40):
        onto, moments = rng.normal(size=(1, 3, 8)), rng.normal(size=(1, 2, 8))
        onto[..., -2:] = 0.0
        force = rng.uniform(0.1, 2.0, 8)
        # The last contact force closes the balance of the object.
        onto[0, :, 5] = (loads.target - onto[0, :, :5] @ force[:5]) / force[5]
        needed = moments @ force
        block = ForceBlock(onto, moments, needed, np.zeros(8), np.full(8, 5.0), np.array([0.0] * 6 + [1.0, 1.0]))
        rows = np.concatenate([onto[0], moments[0]])
        right = np.concatenate([loads.target, needed[0]])
        exact = linprog(block.cost, A_eq=rows, b_eq=right, bounds=[(0.0, 5.0)] * 8)
        if exact.status == 0:
            left, cost, _ = imbalance(loads, [block], [np.zeros(1, int)])
            assert left[0] < 1e-3
            found.append(cost[0] * 10.0)
            wanted.append(exact.fun)
    assert len(found) > 5
    assert found == pytest.approx(wanted, abs=0.02)


def test_no_posture_is_no_basin():
    """An object out of reach of the first curve leaves nothing to scan."""
    scene = make_scene("matched_clothoid", UPRIGHT)
    far = scene.replaced(contacts=scene.contacts.model_copy(update={"middle_range": (1e-3, 2e-3)}))
    assert Basins(far, frozenset({"finger.middle", "finger.tip", "palm"})).postures == 0
