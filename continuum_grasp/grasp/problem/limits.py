"""The inequalities of a grasp: friction cones, clearance, limits of fingers and models."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca

from continuum_grasp.grasp.problem.blocks import rotation
from continuum_grasp.grasp.problem.unit_finger import UnitFinger
from continuum_grasp.grasp.problem.unknowns import Unknowns
from continuum_grasp.model.surfaces.surface import CORNERS, separation

APEX = 2e-4
"""Rounding of the apex of spatial friction cones, as a part of the weight; it lies inside the true one."""
SHORTEST = 0.02
"""Least distance of two middle contacts, as a part of the length: the moments of shorter elements are all but
dependent."""


def add_limits(problem: Unknowns) -> None:
    """Add the inequalities to a problem whose unknowns and contacts are there."""
    _bound_contacts(problem)
    for finger in problem.fingers:
        _keep_clear(problem, finger)
        _keep_limits(problem, finger)
    if problem.spec.free:
        _keep_object_clear(problem)


def guarded(finger: UnitFinger) -> tuple[ca.SX, list[int], list[bool], ca.SX]:
    """World positions (2, K) that must stay clear along a finger, the elements that they are in, whether the finger
    touches the object there, and half its thickness (K,) in units of the problem, one where it is the same everywhere.

    These are waypoints, joints, and probes, which the search puts where a finger is deepest.
    """
    spec = finger.spec
    touching = {n - 1 for n, on in zip(spec.before, spec.touching, strict=True) if on}
    touching |= {spec.elements - 1} if spec.tip else set()
    joints, count = range(spec.elements), finger.probes
    at = ca.reshape(finger.number("probes", count * spec.elements), count, spec.elements)
    along, owners, probed, half = finger.guarded(at)
    points = ca.horzcat(finger.world(along), *(finger.ends[:, k] for k in joints), finger.world(probed))
    elements = [*owners, *joints, *(k for k in joints for _ in range(count))]
    touches = [*(False for _ in owners), *(k in touching for k in joints), *(False for _ in range(count * len(joints)))]
    return points, elements, touches, half


def friction_cone(problem: Unknowns, friction: ca.SX, n: ca.SX, f: ca.SX, lift: ca.SX) -> ca.SX:
    """What is not negative for forces within a friction cone."""
    if problem.spec.gravity == "out_of_plane":
        # Rounded from inside: the root has a kink where nothing presses, at which IPOPT would zigzag.
        apex = APEX * problem.numbers("force reference")
        return friction * n - ca.sqrt(f**2 + lift**2 + apex**2)
    # In the plane the cone is two half planes: linear, nothing to round.
    return ca.vertcat(friction * n - f, friction * n + f)


def _bound_contacts(problem: Unknowns) -> None:
    require, number = problem.rows.require, problem.numbers
    for contact in problem.contacts:
        name, (n, f, lift) = contact.spec.name, ca.vertsplit(contact.force)
        friction = number(f"{name}.friction") + problem.slack["friction"]
        if "greatest_friction_margin" in problem.spec.aims:
            friction *= 1.0 - problem.x("friction margin")
        cone = friction_cone(problem, friction, n, f, lift)
        if problem.reserve is not None:
            cone -= problem.reserve * number("force reference")
            # Also without friction a contact presses.
            pressed = n - problem.reserve * number("force reference")
            require(f"pressed, {name}", pressed, "N", "contacts", upper=ca.inf)
        require(f"friction cone, {name}", cone, "N", f"contacts.friction ({name})", upper=ca.inf)
        most = number(f"{name}.normal_force_max") + problem.slack["normal force"]
        require(f"normal force, {name}", most - n, "N", "contacts.normal_force_max", upper=ca.inf)


def _keep_clear(problem: Unknowns, finger: UnitFinger) -> None:
    name, number, spec, require = finger.spec.name, problem.numbers, problem.spec, problem.rows.require
    points, _, touches, thick = guarded(finger)
    places, tolerance, half = ca.horzsplit(points), number("tolerance"), thick
    back = rotation(-problem.pose[2])
    # A place that touches has its gap as an equation already: the inequality beside it would be dependent.
    free = [j for j, touching in enumerate(touches) if not touching]
    for part, surface in enumerate(spec.surfaces):
        # The tolerance is never zero: a finger that lies along the object makes all its places active at once, and the
        # active constraints dependent (93 % of 60 discs converged with 0, all with 1e-9 and more).
        slack = problem.slack["clearance at the object"] + tolerance - half
        beta = _directions(problem, f"{name}.separating_{part}", len(free), surface.has_directions)
        spare = []
        for k, j in enumerate(free):
            local = back @ (places[j] - problem.pose[:2])
            near = finger.number(f"corners_{part}_{j}", 2 * CORNERS) if surface.looks_at_corners else None
            away = surface.clearance(local, beta[k] if beta.numel() else beta, _part_numbers(problem, part), near)
            spare.append(away + _each(slack, j))
        require(f"penetration into the object, {name}", ca.vertcat(*spare), "m", "object", upper=ca.inf)
    slack = problem.slack["clearance at the supports"] + tolerance
    spare = []
    for k in range(spec.planes):
        normal, at = number(f"plane_{k}.normal", 2), number(f"plane_{k}.point", 2)
        spare += [ca.dot(normal, z - at) - finger.number(f"needed_{k}_{j}") + slack for j, z in enumerate(places)]
    for k in range(spec.lines):
        ends = ca.reshape(number(f"line_{k}.ends", 4), 2, 2)
        beta = _directions(problem, f"{name}.beside_{k}", len(places), True)
        spare += [separation(z, beta[j], ends) - _each(half, j) + slack for j, z in enumerate(places)]
    for k in range(spec.pegs):
        at, radius = number(f"peg_{k}.position", 2), number(f"peg_{k}.radius")
        # 1e-24 keeps the root differentiable where a place is at the peg's center.
        spare += [ca.sqrt(ca.sumsqr(z - at) + 1e-24) - radius - _each(half, j) + slack for j, z in enumerate(places)]
    require(f"penetration into a support, {name}", ca.vertcat(*spare), "m", "supports", upper=ca.inf)


def _each(values: ca.SX, k: int) -> ca.SX:
    """One of several values, or the one that there is for all."""
    return values if values.numel() == 1 else values[k]


def _directions(problem: Unknowns, name: str, count: int, wanted: bool) -> ca.SX:
    """Angles of the normals of separating lines, as unknowns."""
    return problem.x(name, count) if wanted else ca.SX(0, 1)


def _part_numbers(problem: Unknowns, part: int) -> ca.SX:
    return problem.numbers(f"part_{part}", problem.spec.surfaces[part].number_count)


def _keep_limits(problem: Unknowns, finger: UnitFinger) -> None:
    require, slack, number = problem.rows.require, problem.slack, finger.number
    name = finger.spec.name
    over = finger.pulls - number("pull_max") - slack["tension"] * number("pull_per_force")
    require(f"tendon tension, {name}", over, "1", f"{name}.tendons.max_tension", lower=-ca.inf)
    bends = ca.vec(finger.curvatures()[2].T)
    most = number("bending_range") + slack["bending range"]
    spare = ca.vertcat(most - bends, most + bends)
    require(f"bending range, {name}", spare, "rad", "fidelity.bending_range", upper=ca.inf)
    if finger.spec.strained:
        # The strain of the skin is curvature times half the diameter: a limit on the curvature, relaxed by a part.
        curvature = finger.curvatures()[0]
        most = number("curvature_limit") * (1.0 + slack["strain"])
        spare = ca.vertcat(most - curvature, most + curvature)
        require(f"bending strain, {name}", spare, "1", f"{name}.strain_limit", upper=ca.inf)
    on = [joint for joint, touches in zip(finger.joints, finger.spec.touching, strict=True) if touches]
    if len(on) > 1:
        gaps = ca.vertcat(*(b - a for a, b in pairwise(on))) - SHORTEST
        require(f"order of the middle contacts, {name}", gaps, "1", "contacts.middle", upper=ca.inf)


def _keep_object_clear(problem: Unknowns) -> None:
    number, spec, tolerance = problem.numbers, problem.spec, problem.numbers("tolerance")
    back = rotation(-problem.pose[2])
    spare = []
    for k in range(spec.planes):
        normal, at = number(f"plane_{k}.normal", 2), number(f"plane_{k}.point", 2)
        for part, surface in enumerate(spec.surfaces):
            angle, shape = number(f"plane_{k}.angle"), _part_numbers(problem, part)
            spare += surface.wall_clearance(normal, at, angle, problem.pose, shape)
    for k in range(spec.pegs):
        local = back @ (number(f"peg_{k}.position", 2) - problem.pose[:2])
        for part, surface in enumerate(spec.surfaces):
            beta = _directions(problem, f"peg_{k}.separating_{part}", 1, surface.has_directions)
            near = number(f"peg_{k}.corners_{part}", 2 * CORNERS) if surface.looks_at_corners else None
            away = surface.clearance(local, beta, _part_numbers(problem, part), near)
            spare.append(away - number(f"peg_{k}.radius"))
    if spare:
        problem.rows.require("object in a support", ca.vertcat(*spare) + tolerance, "m", "supports", upper=ca.inf)
