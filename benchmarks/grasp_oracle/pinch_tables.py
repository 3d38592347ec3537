"""Starts of pinches: every shape of one finger that touches with its tip has one tension and one contact force.

For two curvatures of a finger the third follows from the gap of its tip; tension and force then follow from its
equilibrium, three linear equations. Shapes of all fingers whose forces, with those of the walls, nearly hold the object
are where to start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from benchmarks.grasp_oracle.numbers import Numbers, Rest
from benchmarks.grasp_oracle.rod import walk

if TYPE_CHECKING:
    from benchmarks.grasp_oracle.pinches import Pinches

Array = NDArray[Any]
STEPS = 33
RANGE = 7.0
"""Greatest curvature times length at base and joint."""
MOST = 200_000
"""Choices of all shapes but the last finger's that are looked at."""
SEEN = 20_000
"""Of those the best, among which starts are chosen that differ."""
APART = 1.5
"""Least difference of two starts: curvatures times lengths, the greatest of each finger, added up."""
TENSION_WEIGHT = 0.1
"""Weight of all tensions at their limits, per imbalance as great as the forces."""


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
    """Shapes, net tensions and forces (n, 2) of all contacts from which a pinch may be near, best first."""
    numbers = pinches.numbers
    every = tables(pinches)
    if not all(len(table.shapes) for table in every):
        return []
    friction = pinches.friction
    spread = float(np.median(np.concatenate([np.linalg.norm(t.wrenches, axis=1) for t in every])))
    rests = [_pushes(numbers, rest, mu, spread) for rest, mu in zip(pinches.rests, friction[len(every) :], strict=True)]
    # All choices but for the last finger's, the best of which a tree finds.
    others = int((MOST / math.prod(len(r.shapes) for r in rests)) ** (1.0 / (len(every) - 1)))
    parts = [table if len(every) == 2 else _thinned(table, others, pinches.force) for table in every[:-1]] + rests
    last = every[-1]
    choice = np.stack([g.ravel() for g in np.meshgrid(*(np.arange(len(p.shapes)) for p in parts), indexing="ij")])
    weight = numbers.limits.mass * np.array([*numbers.gravity, 0.0])
    wrench = weight + sum((p.wrenches[k] for p, k in zip(parts, choice, strict=True)), np.zeros(3))
    near, which = cKDTree(last.wrenches).query(-wrench, k=min(4, len(last.shapes)))
    near, which = near.reshape(len(wrench), -1), which.reshape(len(wrench), -1)
    size = pinches.force + np.maximum.reduce(
        [np.linalg.norm(p.wrenches[k], axis=1) for p, k in zip(parts, choice, strict=True)]
    )
    pull = sum(np.abs(p.pulls[k]) for p, k in zip(parts, choice, strict=True))[:, None] + np.abs(last.pulls)[which]
    cost = near / size[:, None] + TENSION_WEIGHT * pull / sum(map(numbers.most_tension, pinches.hands))
    if pinches.spatial:
        mus = [*friction[: len(every) - 1], *friction[len(every) :]]
        able = sum(_liftable(p, mu)[k] for p, k, mu in zip(parts, choice, mus, strict=True))[:, None]
        able = able + _liftable(last, friction[len(every) - 1])[which]
        cost += np.maximum(0.0, 1.0 - able / (numbers.limits.mass * numbers.lift))
    rows, columns = np.unravel_index(np.argsort(cost, axis=None)[:SEEN], cost.shape)
    fingers = len(every) - 1
    shapes = [parts[k].shapes[choice[k][rows]] for k in range(fingers)] + [last.shapes[which[rows, columns]]]
    pulls = [parts[k].pulls[choice[k][rows]] for k in range(fingers)] + [last.pulls[which[rows, columns]]]
    forces = [parts[k].forces[choice[k][rows]] for k in range(fingers)] + [last.forces[which[rows, columns]]]
    forces += [parts[k].forces[choice[k][rows]] for k in range(fingers, len(parts))]
    found = []
    left = np.ones(len(rows), dtype=bool)
    while left.any() and len(found) < count:
        k = int(np.argmax(left))
        found.append(
            (np.concatenate([s[k] for s in shapes]), np.array([p[k] for p in pulls]), np.array([f[k] for f in forces]))
        )
        left &= sum(np.abs(s - s[k]).max(axis=1) for s in shapes) > APART
    return found


def _liftable(table: Table, mu: float) -> Array:
    """Friction that is left across the plane (n,) [N]."""
    normal, along = table.forces.T
    return np.asarray(np.sqrt(np.maximum((mu * normal) ** 2 - along**2, 0.0)))


def _thinned(table: Table, most: int, unit: float) -> Table:
    """At most so many shapes: of those with nearly the same wrench the one with the least tension."""
    order = np.argsort(np.abs(table.pulls))
    size = np.linalg.norm(table.wrenches, axis=1) + unit
    place = np.column_stack([table.wrenches / size[:, None], np.log(size / unit)])[order]
    cell = 0.05
    while True:
        chosen = np.sort(np.unique(np.floor(place / cell).astype(int), axis=0, return_index=True)[1])
        if len(chosen) <= most:
            break
        cell *= 1.2
    chosen = order[chosen]
    return Table(table.shapes[chosen], table.pulls[chosen], table.forces[chosen], table.wrenches[chosen])


def _pushes(numbers: Numbers, rest: Rest, mu: float, spread: float) -> Table:
    """Some forces of a wall, in the form of a finger's table."""
    forces = np.array(
        [(0.0, 0.0), *((n * spread, n * f * mu * spread) for n in (0.3, 1.0, 3.0) for f in (-0.7, 0.0, 0.7))]
    )
    normal = np.array(rest.normal)
    load = -(forces[:, :1] * normal + forces[:, 1:] * np.array([-normal[1], normal[0]]))
    arm = (np.array(rest.point) - np.array(numbers.com)) / numbers.size
    wrenches = np.column_stack([load, arm[0] * load[:, 1] - arm[1] * load[:, 0]])
    return Table(np.empty((len(forces), 0)), np.zeros(len(forces)), forces, wrenches)


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
    good &= (forces[:, 0] < 1.2 * numbers.limits.normal) & (np.abs(pulls) < 1.2 * numbers.most_tension(hand))
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
