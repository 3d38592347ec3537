"""The inequalities of fingers: clearance, limits of their tendons, drives and models."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca

from continuum_grasp.grasp.problem.blocks import rotation
from continuum_grasp.grasp.problem.parts import ProblemPart
from continuum_grasp.grasp.problem.planar import PlanarPart
from continuum_grasp.grasp.problem.unit_finger import UnitFinger
from continuum_grasp.model import SHORTEST, TouchingCircle


def keep_clear(problem: PlanarPart, finger: UnitFinger) -> ca.SX:
    """A finger keeps clear of object and supports at its guarded places, world positions (2, K)."""
    name = finger.spec.name
    number = problem.numbers
    spec = problem.spec
    require = problem.rows.require
    points, _, touches, thick = finger.guarded
    size = TouchingCircle.SIZE
    count = points.shape[1]
    tolerance = finger.number("tolerance")
    seen = rotation(-problem.pose[2]) @ (points - ca.repmat(problem.pose[:2], 1, count))  # from the object
    # A place that touches has its gap as an equation already: the inequality beside it would be dependent. Of several
    # pieces, those that it does not touch are in its way.
    free = [j for j, touching in enumerate(touches) if spec.obstacles > 1 or not touching]
    for part in range(spec.obstacles):
        # The tolerance is never zero: a finger that lies along the object makes all its places active at once, and the
        # active constraints dependent (93 % of 60 discs converged with 0, all with 1e-9 and more).
        slack = problem.slack["clearance at the object"] + tolerance
        near = ca.reshape(finger.number(f"near_{part}", size * len(free)), size, len(free))
        spare = TouchingCircle(near).distance(seen[:, free]).T - thick[free] + slack
        require(f"penetration into the object, {name}", spare, "m", "object", upper=ca.inf)
    slack = problem.slack["clearance at the supports"] + tolerance
    rows = list[ca.SX]()
    for k in range(spec.planes):
        normal, at = number(f"plane {k}.normal", 2), number(f"plane {k}.point", 2)
        needed = ca.vertcat(*(finger.number(f"needed_{k}_{j}") for j in range(count)))
        rows.append((points - ca.repmat(at, 1, count)).T @ normal - needed + slack)
    for k in range(spec.edges + spec.pegs):
        near = ca.reshape(finger.number(f"near_fixed_{k}", size * count), size, count)
        rows.append(TouchingCircle(near).distance(points).T - thick + slack)
    require(f"penetration into a support, {name}", ca.vertcat(*rows), "m", "supports", upper=ca.inf)
    return points


def keep_apart(problem: PlanarPart, pair: tuple[UnitFinger, UnitFinger], places: tuple[ca.SX, ca.SX]) -> None:
    """Two fingers keep clear of each other, or one of itself: of each element, the place nearest to the other finger,
    or to what follows along it, and the one that was nearest before, else solutions would go back and forth.

    The places are between guarded ones (2, K), with weights that the search renews; the gaps needed make up for the
    bend between these. They are apart along the direction in which they were: fingers do not pass through each other,
    and may slide along each other.
    """
    finger, other = pair
    name = f"{finger.spec.name}, {other.spec.name}"
    number = problem.numbers
    count = 2 * (finger.spec.elements + (other.spec.elements if other is not finger else 0))
    near = [
        points @ ca.reshape(number(f"{side} of {name}", count * points.shape[1]), points.shape[1], count)
        for side, points in zip(("first", "second"), places, strict=True)
    ]
    direction = ca.reshape(number(f"direction of {name}", 2 * count), 2, count)
    away = ca.sum1((near[0] - near[1]) * direction).T
    spare = away - number(f"gap of {name}", count) + number("tolerance")
    if other is finger:
        problem.rows.require(f"passes through itself, {finger.spec.name}", spare, "m", finger.spec.name, upper=ca.inf)
        return
    spare += problem.slack["overlap"]
    problem.rows.require(f"overlap of fingers, {name}", spare, "m", "overlap", upper=ca.inf)


def keep_limits(problem: ProblemPart, finger: UnitFinger) -> None:
    """A finger keeps the limits of its tendons, drives and model."""
    require = problem.rows.require
    slack = problem.slack
    number = finger.number
    name = finger.spec.name
    over = finger.pulls - number("pull_max") - slack["tension"] * number("pull_per_force")
    require(f"tendon tension, {name}", over, f"tension, {name}", f"{name}.tendons.max_tension", lower=-ca.inf)
    if finger.spec.drive is not None and finger.spec.drive.pulley:
        difference = finger.pulls[0] - finger.pulls[1]
        limit = number("torque_max") + slack["tension"] * number("pull_per_force")
        spare = ca.vertcat(limit - difference, limit + difference)
        require(f"torque, {name}", spare, f"torque, {name}", f"{name}.tendons.drive.torque_max", upper=ca.inf)
    bends = ca.vec(finger.curvatures()[2].T)
    limit = number("bending_range") + slack["bending range"]
    spare = ca.vertcat(limit - bends, limit + bends)
    require(f"bending range, {name}", spare, "rad", "fidelity.bending_range", upper=ca.inf)
    if finger.spec.strained:
        # The strain of the skin is curvature times half the diameter: a limit on the curvature, relaxed by a part.
        curvature = finger.curvatures()[0]
        limit = number("curvature_limit") * (1.0 + slack["strain"])
        spare = ca.vertcat(limit - curvature, limit + curvature)
        require(f"bending strain, {name}", spare, "1", f"{name}.strain_limit", upper=ca.inf)
    on = [joint for joint, touches in zip(finger.joints, finger.spec.touching, strict=True) if touches]
    if len(on) > 1:
        # The moments of shorter elements are all but dependent.
        gaps = ca.vertcat(*(b - a for a, b in pairwise(on))) - SHORTEST
        require(f"order of the middle contacts, {name}", gaps, "1", "contacts.middle", upper=ca.inf)
