"""The inequalities of a grasp: friction cones, clearance, limits of fingers and models."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca

from continuum_grasp.grasp.numbers import APEX
from continuum_grasp.grasp.obstacles import SIZE, distance_to
from continuum_grasp.grasp.unit_finger import rotation

if TYPE_CHECKING:
    from continuum_grasp.grasp.problem import FingerState, GraspProblem

__all__ = ["add_limits", "guarded"]


def add_limits(problem: GraspProblem) -> None:
    """Add the inequalities to a problem whose unknowns and contacts are there."""
    _bound_contacts(problem)
    for finger in problem.fingers:
        _keep_clear(problem, finger)
        _keep_limits(problem, finger)
    if problem.make.free:
        _keep_object_clear(problem)


def guarded(finger: FingerState) -> tuple[ca.SX, list[int], list[bool]]:
    """World positions (2, K) that are kept clear along a finger, the elements that they are in, and whether the finger
    touches the object there.

    These are waypoints, joints, and probes, which the search puts where a finger is deepest.
    """
    make, model = finger.make, finger.unit.model
    touching = {n - 1 for n, on in zip(make.before, make.touching, strict=True) if on}
    touching |= {make.elements - 1} if make.tip else set()
    joints, count = range(make.elements), finger.unit.probes
    at = ca.reshape(finger.unit.number("probes", count * make.elements), count, make.elements)
    points = ca.horzcat(
        finger.world(model.waypoints(finger.q, finger.u, finger.p)),
        *(finger.ends[:, k] for k in joints),
        finger.world(model.probes(count)(finger.q, finger.u, at, finger.p)),
    )
    inside = [k for k, _ in finger.unit.waypoint_shares]
    elements = [*inside, *joints, *(k for k in range(make.elements) for _ in range(count))]
    touches = [*(False for _ in inside), *(k in touching for k in joints)]
    return points, elements, touches + [False] * (len(elements) - len(touches))


def _bound_contacts(problem: GraspProblem) -> None:
    require, number = problem.parts.require, problem.numbers
    for contact in problem.contacts:
        name, (n, f, lift) = contact.make.name, ca.vertsplit(contact.force)
        friction = number(f"{name}.friction") + problem.give["friction"]
        if "greatest_friction_margin" in problem.make.aims:
            friction *= 1.0 - problem.parts.variables["friction margin"].symbol
        if problem.make.gravity == "out_of_plane":
            apex = APEX * problem.numbers("force reference")
            cone = friction * n - ca.sqrt(f**2 + lift**2 + apex**2)
        else:
            cone = ca.vertcat(friction * n - f, friction * n + f)
        key = f"contacts.friction ({name})"
        require(f"friction cone, {name}", cone, "N", key, upper=ca.inf)
        most = number(f"{name}.normal_force_max") + problem.give["normal force"]
        require(f"normal force, {name}", most - n, "N", "contacts.normal_force_max", upper=ca.inf)


def _keep_clear(problem: GraspProblem, finger: FingerState) -> None:
    make, number, require = finger.make, finger.unit.number, problem.parts.require
    points, places, touches = guarded(finger)
    tolerance, half = problem.numbers("tolerance"), problem.thickness(finger)
    back = rotation(-problem.pose[2])
    room = []
    for j in range(len(places)):
        if touches[j]:
            continue
        local = back @ (points[:, j] - problem.pose[:2])
        for part in range(problem.make.parts):
            obstacle = number(f"obstacle_{part}_{j}", SIZE)
            room.append(distance_to(local, obstacle) - half + problem.give["room at the object"] + tolerance)
    require(f"penetration into the object, {make.name}", ca.vertcat(*room), "m", "object", upper=ca.inf)
    supports = problem.make.planes + problem.make.lines + problem.make.pegs
    room = []
    for k in range(supports):
        for j in range(len(places)):
            off = distance_to(points[:, j], number(f"support_{k}_{j}", SIZE))
            room.append(off - number(f"needed_{k}_{j}") + problem.give["room at the supports"] + tolerance)
    require(f"penetration into a support, {make.name}", ca.vertcat(*room), "m", "supports", upper=ca.inf)


def _keep_limits(problem: GraspProblem, finger: FingerState) -> None:
    require, give, number = problem.parts.require, problem.give, finger.unit.number
    name = finger.make.name
    over = finger.pulls - number("pull_max") - give["tension"] * number("pull_per_force")
    require(f"tendon tension, {name}", over, "1", f"{name}.tendons.max_tension", lower=-ca.inf)
    bends = finger.unit.model.bending(finger.q, finger.u, finger.p)
    most = number("bending_range") + give["bending range"]
    room = ca.vertcat(most - bends, most + bends)
    require(f"bending range, {name}", room, "rad", "fidelity.bending_range", upper=ca.inf)
    if finger.make.strained:
        curvature = finger.unit.curvatures(finger.q, finger.u, finger.p)
        most = number("curvature_limit") * (1.0 + give["strain"])
        room = ca.vertcat(most - curvature, most + curvature)
        require(f"bending strain, {name}", room, "1", f"{name}.strain_limit", upper=ca.inf)
    on = [joint for joint, touches in zip(finger.joints, finger.make.touching, strict=True) if touches]
    if len(on) > 1:
        gaps = ca.vertcat(*(b - a for a, b in zip(on, on[1:], strict=False))) - 0.02
        require(f"order of the middle contacts, {name}", gaps, "1", "contacts.middle", upper=ca.inf)


def _keep_object_clear(problem: GraspProblem) -> None:
    number, make, tolerance = problem.numbers, problem.make, problem.numbers("tolerance")
    turn = rotation(problem.pose[2])
    height = []
    for k in range(make.planes):
        normal, at = number(f"plane_{k}.normal", 2), number(f"plane_{k}.point", 2)
        for part in range(make.parts):
            shape = number(f"part_{part}", 6 if make.smooth_parts[part] else 2 * make.corners[part] + 1)
            if make.smooth_parts[part]:  # support function, opposite to the plane's normal
                a, b, power, angle = shape[0], shape[1], shape[2], shape[5]
                local = rotation(-problem.pose[2] - angle) @ normal
                dual = power / (power - 1.0)
                square = (ca.vertcat(a, b) * local) ** 2 + 1e-14
                reach = ca.sum1(square ** (0.5 * dual)) ** (1.0 / dual)
                height.append(ca.dot(normal, problem.pose[:2] + turn @ shape[3:5] - at) - reach)
            else:
                for c in range(make.corners[part]):
                    corner = problem.pose[:2] + turn @ shape[2 * c : 2 * c + 2]
                    height.append(ca.dot(normal, corner - at) - shape[-1])
    for k in range(make.pegs):
        local = rotation(-problem.pose[2]) @ (number(f"peg_{k}.position", 2) - problem.pose[:2])
        for part in range(make.parts):
            height.append(distance_to(local, number(f"peg_{k}.obstacle_{part}", SIZE)) - number(f"peg_{k}.radius"))
    if height:
        room = ca.vertcat(*height) + tolerance
        problem.parts.require("object in a support", room, "m", "supports", upper=ca.inf)
