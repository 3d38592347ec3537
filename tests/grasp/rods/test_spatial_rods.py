"""The problem of rods in space, from inside: no door lets it through yet.

Truths are finite differences, a rod of SciPy with rotation matrices, sums of forces by hand, and the plane.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import continuum_grasp as cg
from continuum_grasp.grasp.rods.guess import PosedFinger, ShotFinger, filled
from continuum_grasp.grasp.rods.hand_numbers import hand_numbers, hand_table
from continuum_grasp.grasp.rods.kinds import stage_kind
from continuum_grasp.grasp.rods.places import NearPair
from continuum_grasp.grasp.rods.planar_numbers import planar_numbers, planar_table
from continuum_grasp.grasp.rods.problem import GraspRods
from continuum_grasp.grasp.rods.spatial import SPACE, columns, quaternion_of
from continuum_grasp.scene import GraspScene, HandScene

CONFIGS = Path(cg.__file__).parents[1] / "configs/hand"
FINGER = {
    "rod": {"length": 0.12, "bending_stiffness": 6e-3, "linear_density": 0.02},
    "half_thickness": 0.006,
    "tendons": {"offset": 0.006, "max_tension": 60.0},
}


def ball(**changes):
    return cg.load(CONFIGS / "ball.yaml").changed(changes)


@cache
def problem_of_ball():
    """A middle contact, a tip and a free tip near a ball, with torsional friction and a strain limit, at random."""
    scene = ball(**{"contacts.torsional_friction": 2e-3})
    on = frozenset({"finger_1.middle", "finger_1.tip", "finger_2.tip", "finger_3.middle"})
    numbers = hand_numbers(scene, on, hand_table(scene))
    numbers = replace(numbers, fingers=[replace(finger, curvature_limit=20.0) for finger in numbers.fingers])
    problem = GraspRods(numbers, stages=6, near=[NearPair(0, 3, 1, 2)])
    bends = [(0.9, 2.1), (0.6, 0.2), (1.1, -0.3)]
    guesses = [
        PosedFinger(np.array([0.0, 1.0]), np.array(bend), (0.6,) * len(finger.middles), np.array([0.7, 0.1]), HELD)
        for bend, finger in zip(bends, problem.numbers.fingers, strict=True)
    ]
    x = filled(problem, guesses, {})
    low, high = problem.limits
    return scene, problem, x + 0.01 * np.random.default_rng(3).normal(size=x.size) * (low < high)


class AnyForce(dict):
    """The same force at each contact."""

    def __missing__(self, name):
        return np.array([0.5, 0.1, -0.05, 0.02])


HELD = AnyForce()


def test_derivatives_are_those_of_finite_differences():
    _, problem, x = problem_of_ball()
    functions, p = problem.nlp.functions, problem.parameters
    random = np.random.default_rng(5)
    along = random.normal(size=x.size)
    forces = random.normal(size=problem.count)
    step = 1e-5

    def at(share):
        g, jacobian = functions["jac_g"](x + share * step * along, p)
        return np.array(g).ravel(), jacobian

    (before, first), (after, last) = at(-1.0), at(1.0)
    jacobian = at(0.0)[1]
    assert np.array(jacobian @ along).ravel() == pytest.approx((after - before) / (2 * step), rel=1e-6, abs=1e-6)
    hessian = np.array(functions["hess_lag"](x, p, 1.0, forces))
    costs = problem.parameters[-x.size :]
    slopes = np.array((last - first).T @ forces).ravel() / (2 * step) + costs * along
    whole = hessian + np.triu(hessian, 1).T
    assert whole @ along == pytest.approx(slopes, rel=1e-5, abs=1e-4)


def test_the_balance_is_the_sum_of_the_contacts_forces_and_moments():
    """Of a ball, whose normals go through its center."""
    scene, problem, x = problem_of_ball()
    numbers = problem.numbers
    force, moment = np.zeros(3), np.zeros(3)
    center = np.array(scene.object.position)
    for finger, part in zip(numbers.fingers, problem.parts, strict=True):
        for name, node in zip(finger.contacts, part.touching, strict=True):
            point = finger.length * x[part.nodes[node]][:3]
            normal = (point - center) / np.linalg.norm(point - center)
            side = np.cross(finger.across, normal)
            side = side / np.linalg.norm(side)
            pressed, along, beside, twist = finger.force * x[problem.contacts[name]]
            on_finger = pressed * normal + along * side + beside * np.cross(normal, side)
            force = force - on_finger
            # The skin is where the ball is touched.
            moment = moment + np.cross(point - 0.006 * normal - center, -on_finger) - 2e-3 / 0.6 * twist * normal
    rows = numbers.force * problem.row_values(x, problem.balance, ["middle_space", "tip_space"])
    assert rows[:3] == pytest.approx(force, abs=1e-5)
    assert rows[3:] * numbers.size == pytest.approx(moment, abs=1e-6)
    assert numbers.weight[:3] * numbers.force == pytest.approx([0.0, 0.0, -9.81 * scene.object.mass])


def test_a_stage_is_the_rod_of_scipy():
    """An independent rod in SI units: rotation matrices, moments in the section's axes, and its own weight."""
    scene = ball(**{"hand.finger.rest_curvature": 5.0, "hand.finger.rod.linear_density": 0.2, "gravity": [3, -4, -9]})
    numbers = hand_numbers(scene, frozenset({"finger_1.tip"}), hand_table(scene))
    finger, length, bending, offset = numbers.fingers[0], 0.12, 6e-3, 0.006
    turned, moment = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix(), np.array([0.4, -0.6, 0.9]) * bending / length
    force, tensions = np.array([0.5, 0.3, -0.4]), np.array([8.0, 1.0])
    pulls = [tensions[0 if pull.side > 0 else 1] / pull.unit for pull in finger.section.pulls]
    kind, count = stage_kind(SPACE, finger.section.form), 48
    state = np.array([0.1, 0.2, -0.3, *quaternion_of(turned), *moment / finger.moment])
    for k in range(count):
        unknowns = [*state, *np.zeros(10), *force / finger.force, *pulls, 0.0, 1.0]
        # The row is where the stage leads less where it ends.
        state = kind.value(np.array(unknowns), np.array([*finger.acting(0), k / count, (k + 1) / count]), np.zeros(0))
    section = scene.hand.finger.cross_section

    def rates(s, y):
        axes, own = y[3:12].reshape(3, 3), y[12:]
        bend = 5.0 + (own[2] + offset * (tensions[0] - tensions[1])) / bending
        rate = np.array([own[0] / (section.lateral * bending), own[1] / (section.torsion * bending), bend])
        skew = np.array([[0, -rate[2], rate[1]], [rate[2], 0, -rate[0]], [-rate[1], rate[0], 0]])
        inner = axes.T @ (force - 0.2 * s * np.array([3.0, -4.0, -9.0]))
        turning = -np.cross(rate, own) - np.cross([0.0, 1.0, 0.0], inner)
        return np.concatenate([axes[:, 1], (axes @ skew).ravel(), turning])

    begin = np.concatenate([length * np.array([0.1, 0.2, -0.3]), turned.ravel(), turned.T @ moment])
    end = solve_ivp(rates, (0.0, length), begin, rtol=1e-11, atol=1e-13).y[:, -1]
    axes = end[3:12].reshape(3, 3)
    assert length * state[:3] == pytest.approx(end[:3], abs=1e-6 * length)
    assert np.column_stack(columns(state[3:7])) == pytest.approx(axes, abs=2e-6)
    assert finger.moment * state[7:] == pytest.approx(axes @ end[12:], abs=2e-6 * bending / length)


def pinch_in_a_plane():
    """Two fingers hold a disc in a plane, and a hand whose planes coincide holds a cylinder across it."""
    bases = {"left": (-0.05, math.radians(-4.0)), "right": (0.05, math.radians(4.0))}
    contacts = {"friction": 0.6, "normal_force_max": 30.0, "middle": "on", "tip": "off"}
    planar = GraspScene(
        schema_version=1,
        name="disc",
        fingers={name: FINGER | {"base": {"position": (x, 0.0), "angle": angle}} for name, (x, angle) in bases.items()},
        object={"shape": "circle", "diameter": 0.06, "mass": 0.05, "position": (0.003, 0.08)},
        contacts=contacts,
        gravity=(0.0, 9.81, 0.0),
    )
    named = {
        name: {
            "position": (x, 0.0, 0.0),
            "direction": (-math.sin(angle), math.cos(angle), 0.0),
            "bends_toward": (-math.cos(angle), -math.sin(angle), 0.0),
        }
        for name, (x, angle) in bases.items()
    }
    cylinder = {"shape": "cylinder", "diameter": 0.06, "height": 0.1, "edge_radius": 0.005, "mass": 0.05}
    spatial = HandScene(
        schema_version=1,
        name="cylinder",
        hand={"finger": FINGER | {"section": {"shape": "round"}}, "bases": named},
        object=cylinder | {"position": (0.003, 0.08, 0.0)},
        contacts=contacts,
        gravity=(0.0, 9.81, 0.0),
    )
    return planar, spatial


def test_a_hand_whose_planes_coincide_has_the_rows_of_the_plane():
    planar, spatial = pinch_in_a_plane()
    on = frozenset({"left.middle", "right.middle"})
    bases = tuple(setup.finger.base.pose for setup in planar.setups)
    numbers = hand_numbers(spatial, on, hand_table(spatial))
    flat = planar_numbers(planar, on, (planar.object.pose, bases), numbers.force, planar_table(planar))
    shots = [
        ShotFinger(-0.5, np.array([0.6, 0.2]), -0.9, (0.55,), [np.array([0.8, 0.1])]),
        ShotFinger(0.7, np.array([-0.5, 0.3]), 0.8, (0.6,), [np.array([0.9, -0.2])]),
    ]
    problems = [GraspRods(flat), GraspRods(numbers)]
    inner, outer = (filled(problem, [_in(problem, shot) for shot in shots], {}) for problem in problems)
    for part, other in zip(*(problem.parts for problem in problems), strict=True):
        states, theirs = inner[np.array(part.nodes)], outer[np.array(other.nodes)]
        assert theirs[:, :2] == pytest.approx(states[:, :2], abs=1e-5)
        assert theirs[:, 2] == pytest.approx(0.0, abs=1e-12)
        along = np.array([SPACE.tangent(state)[:2] for state in theirs])
        assert along == pytest.approx(np.column_stack([-np.sin(states[:, 2]), np.cos(states[:, 2])]), abs=1e-5)
        assert theirs[:, 9] == pytest.approx(states[:, 3], abs=1e-5)
    sums = [problem.row_values(x, problem.balance) for problem, x in zip(problems, (inner, outer), strict=True)]
    ratio = np.array([1.0, 1.0, 1.0, 1.0, 1.0, numbers.size / flat.size])
    # 3e-5: steps of both tables
    assert sums[1] * ratio == pytest.approx(sums[0], abs=3e-5)


def _in(problem, shot):
    """A shot whose force has the coordinates of a problem."""
    dimensions = problem.geometry.dimensions
    return ShotFinger(shot.bend, np.append(shot.force, 0.0)[:dimensions], shot.pull, shot.middles, shot.held)
