"""Starts of pinches: every shape of one finger that touches with its tip has one tension and one contact force.

For two curvatures of a finger the third follows from the gap of its tip; tension and force then follow from its
equilibrium, three linear equations. Shapes of two fingers whose forces nearly hold the object are where to start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.grasp_oracle.rod import walk

if TYPE_CHECKING:
    from benchmarks.grasp_oracle.pairs import Pinches

Array = NDArray[Any]
STEPS = 33
RANGE = 7.0
"""Greatest curvature times length at base and joint."""


@dataclass
class Table:
    """Shapes of one finger and what they do to the object.

    Attributes
    ----------
    shapes : ndarray (n, 3)
        Nodal curvatures times the length.
    pulls : ndarray (n,)
        Net tension [N].
    forces : ndarray (n, 2)
        N and f [N].
    wrenches : ndarray (n, 3)
        On the object: force, and moment about its center of mass by its size [N].
    """

    shapes: Array
    pulls: Array
    forces: Array
    wrenches: Array


def tables(pinches: Pinches) -> list[Table]:
    """The shapes of each finger that bear their contact."""
    return [_table(pinches, k) for k in range(len(pinches.hands))]


def starts(pinches: Pinches, count: int) -> list[tuple[Array, Array, Array]]:
    """Shapes, net tensions and forces (n, 2) of the fingers from which a pinch may be near, best first."""
    numbers = pinches.numbers
    one, two = tables(pinches)
    if not len(one.shapes) or not len(two.shapes):
        return []
    weight = numbers.limits.mass * np.array([*numbers.gravity, 0.0])
    tree = cKDTree(two.wrenches)
    near, which = tree.query(-(one.wrenches + weight), k=min(4, len(two.shapes)))
    near, which = near.reshape(len(one.shapes), -1), which.reshape(len(one.shapes), -1)
    size = np.linalg.norm(one.wrenches, axis=1) + pinches.force
    pull = np.abs(one.pulls)[:, None] + np.abs(two.pulls)[which]
    cost = near / size[:, None] + 0.1 * pull / (2.0 * numbers.limits.tension)
    chosen: list[tuple[int, int]] = []
    for flat in np.argsort(cost, axis=None)[:4000]:
        i, j = np.unravel_index(flat, cost.shape)
        pair = (int(i), int(which[i, j]))
        apart = all(
            np.abs(one.shapes[pair[0]] - one.shapes[a]).max() + np.abs(two.shapes[pair[1]] - two.shapes[b]).max() > 1.5
            for a, b in chosen
        )
        if apart:
            chosen.append(pair)
        if len(chosen) == count:
            break
    return [
        (
            np.concatenate([one.shapes[a], two.shapes[b]]),
            np.array([one.pulls[a], two.pulls[b]]),
            np.array([one.forces[a], two.forces[b]]),
        )
        for a, b in chosen
    ]


def _table(pinches: Pinches, k: int) -> Table:
    hand, finger, numbers = pinches.hands[k], pinches.fingers[k], pinches.numbers
    half = 0.5 * hand.length
    line = np.linspace(-RANGE, RANGE, STEPS)
    first, second = (g.ravel() for g in np.meshgrid(line, line))
    joint = finger.base + walk(hand.angle, first / hand.length, second / hand.length, half)
    angle = hand.angle + 0.25 * (first + second)
    center = np.array(numbers.com)
    reach = numbers.size + hand.thickness + half
    some = np.linalg.norm(joint - center, axis=1) < reach
    first, second, joint, angle = first[some], second[some], joint[some], angle[some]
    grid = np.linspace(-2.0 * RANGE, 2.0 * RANGE, 57)
    tips = joint[:, None] + walk(angle[:, None], second[:, None] / hand.length, grid / hand.length, half)
    gap = np.linalg.norm(tips - center, axis=-1) - numbers.size - hand.thickness
    close = gap < 0.0  # within the circle around the object: where the true gap is worth its cost
    gap[close] = finger.outline.gap(tips[close])
    row, column = np.nonzero(np.sign(gap[:, :-1]) != np.sign(gap[:, 1:]))
    g0, g1 = gap[row, column], gap[row, column + 1]
    third = grid[column] + g0 / (g0 - g1) * (grid[1] - grid[0])
    shapes = np.column_stack([first[row], second[row], third])
    if not len(shapes):
        return Table(shapes, np.empty(0), np.empty((0, 2)), np.empty((0, 3)))
    lean = hand.angle + 0.25 * (shapes[:, 0] + 2.0 * shapes[:, 1] + shapes[:, 2])
    end = joint[row] + walk(angle[row], shapes[:, 1] / hand.length, third / hand.length, half)
    normal = finger.outline.nearest(end)[1]
    shapes = shapes[np.cos(lean) * normal[:, 1] - np.sin(lean) * normal[:, 0] < 0.1]  # it comes from outside
    pulls, forces, wrenches = _borne(pinches, k, shapes)
    mu = numbers.limits.friction
    good = (forces[:, 0] > 0.0) & (np.abs(forces[:, 1]) < 1.2 * mu * forces[:, 0])
    good &= (forces[:, 0] < 1.2 * numbers.limits.normal) & (np.abs(pulls) < 1.2 * numbers.limits.tension)
    return Table(shapes[good], pulls[good], forces[good], wrenches[good])


def _borne(pinches: Pinches, k: int, shapes: Array) -> tuple[Array, Array, Array]:
    """Net tension, force at the tip, and what that does to the object, of many shapes."""
    hand, numbers = pinches.hands[k], pinches.numbers
    columns = []
    for pull, force in ((0.0, (0.0, 0.0)), (1.0, (0.0, 0.0)), (0.0, (1.0, 0.0)), (0.0, (0.0, 1.0))):
        value, _, _, points, normals = pinches._finger(k, hand, shapes, np.array([pull, 0.0]), np.array([*force, 0.0]))
        columns.append(value[:, 1:])
    matrix = np.stack([columns[j] - columns[0] for j in (1, 2, 3)], axis=-1)
    with np.errstate(all="ignore"):
        sound = np.abs(np.linalg.det(matrix)) > 1e-300
        matrix[~sound] = np.eye(3)
        found = np.linalg.solve(matrix, -columns[0][..., None])[..., 0]
    found[~sound] = np.nan
    across = np.stack([-normals[:, 1], normals[:, 0]], axis=-1)
    load = -(found[:, 1:2] * normals + found[:, 2:3] * across)
    arm = (points - np.array(numbers.com)) / numbers.size
    moment = arm[:, 0] * load[:, 1] - arm[:, 1] * load[:, 0]
    found[~np.isfinite(found).all(axis=1)] = math.inf
    return found[:, 0], found[:, 1:], np.nan_to_num(np.column_stack([load, moment]), nan=1e9)
