"""Robust grasps against plants of another hand: arcs, virtual work by differences, linear programming."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import fsolve, linprog

from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.scene import Robust, load
from tests.grasp_scenes import CONFIGS
from tests.marks import few

LENGTH, STIFFNESS, SKIN, OFFSET, BASE = 0.18, 6.11e-3, 0.006, 0.005, (0.0, -0.055)
EDGES = np.linspace(0.0, 2.0 * np.pi, 32, endpoint=False)
BOUNDS = Robust(position=0.002, radius=0.03, friction=0.15, mass=0.1, draws=100)


def section(s: float, bends: NDArray, joint: float) -> tuple[NDArray, float]:
    """Place and direction of the finger at a position along its two arcs, which starts along +x."""
    at, turn = np.array(BASE), 0.0
    for bend, length, part in zip(bends, (joint, LENGTH - joint), (min(s, joint), max(s - joint, 0.0)), strict=True):
        angle = bend * part / length
        chord = part * np.sinc(angle / (2.0 * np.pi))
        at = at + chord * np.array([np.cos(turn + angle / 2.0), np.sin(turn + angle / 2.0)])
        turn += angle
    return at, turn


def reserve(tensions: NDArray, guess: NDArray, radius: float, y: float, friction: float, mass: float) -> float:
    """By how much all cones can be narrower [N] where the mug touches the palm at a height, with these tensions."""
    center, reach = np.array([radius, y]), radius + SKIN

    def gaps(x: NDArray) -> list[float]:
        (middle, turn), (tip, _) = (section(s, x[:2], x[2]) for s in (x[2], LENGTH))
        across = (middle - center) @ [np.cos(turn), np.sin(turn)]
        return [np.hypot(*(middle - center)) - reach, across, np.hypot(*(tip - center)) - reach]

    x, _, found, _ = fsolve(gaps, guess, full_output=True, xtol=1e-13)
    assert found == 1
    bends, joint = x[:2], x[2]
    normals = [(section(s, bends, joint)[0] - center) / reach for s in (joint, LENGTH)]
    columns: list[NDArray] = []  # of one newton in each direction: two moments, balance of object, lift, tilt
    for normal, s in zip([*normals, np.array([-1.0, 0.0])], (joint, LENGTH, None), strict=True):
        across = np.array([-normal[1], normal[0]])
        for force in (normal, across):
            work = np.zeros(2)
            if s is not None:
                _, turn = section(s, bends, joint)
                for k, step in enumerate(1e-6 * np.eye(2)):  # of the place of the skin that is touched
                    moved = []
                    for sign in (1.0, -1.0):
                        there, angle = section(s, bends + sign * step, joint)
                        c, d = np.cos(angle - turn), np.sin(angle - turn)
                        moved.append(there - SKIN * np.array([[c, -d], [d, c]]) @ normal)
                    work[k] = (moved[0] - moved[1]) @ force / 2e-6
            columns.append(
                np.concatenate([work, -force, [-radius * (normal[0] * force[1] - normal[1] * force[0])], np.zeros(3)])
            )
        columns.append(np.concatenate([np.zeros(5), [1.0], radius * normal]))
    lengths = np.array([joint, LENGTH - joint])
    needed = np.concatenate(
        [STIFFNESS * bends / lengths - (tensions[0] - tensions[1]) * OFFSET, np.zeros(3), [mass * 9.81], np.zeros(2)]
    )
    cones = []
    for k in range(3):
        for angle in EDGES:
            row = np.zeros(10)
            row[3 * k : 3 * k + 3] = -friction, np.cos(angle), np.sin(angle)
            row[9] = 1.0
            cones.append(row)
    forces = [(0.0, 30.0), (None, None), (None, None)] * 3
    equations, edges = np.column_stack([*columns, np.zeros(8)]), np.array(cones)
    costs = np.array([0.0] * 9 + [-1.0])
    best = linprog(costs, edges, np.zeros(len(edges)), equations, needed, [*forces, (None, None)])
    return float(best.x[9]) if best.status == 0 else -np.inf


@pytest.mark.deep
@pytest.mark.parametrize("count", few([40, 300], 1))
def test_as_many_plants_hold_as_reported(count: int) -> None:
    found = optimize_grasp(load(CONFIGS / "mug_arcs.yaml").replaced(robust=BOUNDS))
    plants = np.random.default_rng(99).uniform(-1.0, 1.0, (count, 4))
    plants *= [BOUNDS.position, BOUNDS.radius, BOUNDS.friction, BOUNDS.mass]
    nominal, robust = (
        np.array(
            [
                reserve(
                    grasp["finger.tensions"],
                    np.append(grasp["finger.q"], grasp["finger.lengths"][0]),
                    *(0.04 * (1.0 + size), y, 0.5 * (1.0 + slip), 0.3 * (1.0 + mass)),
                )
                for y, size, slip, mass in plants
            ]
        )
        for grasp in (found.robustness.nominal_arrays, found.arrays)
    )
    assert found.robustness.robust.holds
    assert (robust > -1e-3).all()  # N
    trials = found.robustness.nominal
    share, held = trials.held / trials.margins.size, np.mean(nominal > -1e-3)
    # Both are samples of one probability p: their difference has variance p (1 - p) (1 / plants + 1 / draws).
    assert 0.1 < share < 0.9
    assert abs(held - share) < 3.0 * np.sqrt(share * (1.0 - share) * (1.0 / count + 1.0 / trials.margins.size))


@pytest.mark.deep
def test_every_draw_has_an_answer_where_the_solver_finds_no_optimum():
    """Of 100 friction states two balance where the solver is stopped, as it cycles around an optimum: the grasp was not
    robust, its image was.
    """
    scene = load(CONFIGS / "mug_motor.yaml").changed(
        {"objective": "greatest_disturbance", "disturbances.wrenches": [[1.0, 0.0, 0.0], [0.0, -1.0, 0.02]]}
    )
    robust = optimize_grasp(scene).robustness.robust
    assert not np.isnan(robust.margins).any()
    assert robust.holds


@pytest.mark.deep
def test_greater_errors_need_more_tension():
    """With 1 mm nothing balances at one corner, and the solver began the joint problem where it had diverged there: the
    gear was called infeasible between errors with which it is held.
    """
    gear = load(CONFIGS / "gear.yaml")
    bounds = ({"draws": 1, "position": f"{mm} mm", "friction": "10 %", "mass": "5 %"} for mm in (0.5, 0.9, 1.0, 1.1))
    tensions = [optimize_grasp(gear.changed({"robust": bound})).tension for bound in bounds]
    assert sorted(tensions) == tensions
