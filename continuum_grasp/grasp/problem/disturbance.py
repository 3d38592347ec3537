"""Disturbances as part of the problem: the elastic answer of fingers and object to a wrench, to first order.

Under a small wrench the fingers bend, the object moves, the contacts roll without slipping (surface points of finger
and object move together, supports stay), and forces and tensions change. What must then hold is written for a grasp
that has yielded; its derivative at the grasp, times the changes d( ) per wrench, which are unknowns, gives

    finger    d(inverse dynamics at rest) = 0
    object    d(sum of forces and moments about the center of mass) + rho * wrench = 0
    contact   d(surface point of the finger) = d(surface point of the object)
              where finger and object turn by d phi and d psi, the contact rolls on by (d phi - d psi) / (ko + kf) and
              its normal turns by (kf d psi + ko d phi) / (ko + kf), ko and kf being the curvatures of their surfaces
    limits    forces + changes within their cones, tensions + changes within their limits

Retensioned tendons change their tension freely; locked ones have a fixed length, so the tip's angle stays and the
tension reacts, shared equally between two tendons; with constant tensions neither reacts.

A push p d of any direction d in the plane changes forces by p (F_x, F_y) d, from the answers to pushes along x and y. A
linear limit c . f >= 0 holds for all directions if c . f >= p |c' (F_x, F_y)|.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import casadi as ca

from continuum_grasp.grasp.problem.blocks import Columns, rotation
from continuum_grasp.grasp.problem.parts import friction_cone
from continuum_grasp.grasp.problem.planar import PlanarPart, Touch
from continuum_grasp.grasp.problem.unit_finger import UnitFinger

LEAST = 0.02
"""Least sum of the curvatures of two surfaces that touch, per size of the object: below it the contact
point would run along the finger without bound as it rolls; a finger that fits the object counts as wrapped."""

CORNERS = 16
"""Number of corners of the polygon around all pushes, for friction cones that are not linear: it overestimates by 2
%."""

_Row = tuple[str, ca.SX, str, str]
"""Name, expression, unit and key of what must stay zero."""


def add_disturbances(problem: PlanarPart, wrenches: ca.SX) -> None:
    """Add unknowns and constraints of a part for all wrenches (3, W), which act on it."""
    tendons = "locked" if problem.spec.locked else "retensioned"
    cases = [str(k) for k in range(problem.spec.wrenches)]
    for case, change in zip(cases, _changes(problem, wrenches, tendons, cases), strict=True):
        _keep_limits(problem, change, case)


def add_push(problem: PlanarPart, push: ca.SX) -> None:
    """Add unknowns and constraints of a part for a push in any direction on it; zero if the push acts on another
    part.
    """
    tendons = "locked" if problem.spec.locked else "constant"
    along = _changes(problem, ca.vertcat(push * ca.SX.eye(2), ca.SX(1, 2)), tendons, ["push x", "push y"])
    number = problem.numbers
    for contact in problem.contacts:
        name = contact.spec.name
        force = contact.force[: problem.spec.dimensions]
        changes = ca.horzcat(*(change[f"change of force, {name}"] for change in along))
        friction = number(f"{name}.friction")
        # 1e-24 keeps the root differentiable if nothing changes.
        more = ca.sqrt(ca.sumsqr(changes[0, :]) + 1e-24)
        spare = ca.vertcat(force[0] - more, number(f"{name}.normal_force_max") - force[0] - more)
        problem.rows.require(f"pushed normal force, {name}", spare, "N", "contacts.normal_force_max", upper=ca.inf)
        key = f"contacts.friction ({name})"
        for sign in (1.0, -1.0) if force.numel() == 2 else ():
            across = ca.sqrt(ca.sumsqr(friction * changes[0, :] + sign * changes[1, :]) + 1e-24)
            cone = friction * force[0] + sign * force[1] - across
            problem.rows.require(f"pushed friction cone, {name}, {sign:+.0f}", cone, "N", key, upper=ca.inf)
        for k in range(CORNERS if force.numel() > 2 else 0):
            angle = 2.0 * math.pi * k / CORNERS
            corner = ca.DM([math.cos(angle), math.sin(angle)]) / math.cos(math.pi / CORNERS)
            moved = ca.vertcat(force[:2] + changes @ corner, force[2])
            cone = friction_cone(number, friction, moved)
            problem.rows.require(f"pushed friction cone, {name}, {k}", cone, "N", key, upper=ca.inf)


def _changes(problem: PlanarPart, wrenches: ca.SX, tendons: str, cases: Sequence[str]) -> list[dict[str, ca.SX]]:
    """Add the unknown changes of a part under wrenches (3, W) by name, one per case, and their constraints."""
    changes = Columns()
    rows = list(_yielded(problem, changes, tendons))
    z = changes.symbol
    slopes = [ca.substitute(ca.jacobian(row, z), z, ca.DM.zeros(z.numel())) for _, row, _, _ in rows]
    each = []
    for k, case in enumerate(cases):
        change = {name: problem.x(f"{name}, {case}", at.stop - at.start) for name, at in changes.at.items() if at.start}
        column = ca.vertcat(wrenches[:, k], *change.values())
        for (name, _, unit, key), slope in zip(rows, slopes, strict=True):
            problem.rows.require(f"{name}, {case}", slope @ column, unit, key)
        each.append(change)
    return each


def _yielded(problem: PlanarPart, changes: Columns, tendons: str) -> Iterator[_Row]:
    """Rows that stay zero as a grasp yields, right to first order, in ``changes``: the wrench (3,), then changes of
    coordinates, tensions, contact forces along axes that turn with the contact, and the object's pose.
    """
    wrench = changes("wrench", 3)
    contacts = problem.contacts
    bends = [changes(f"{finger.spec.name}.change of q", finger.q.numel()) for finger in problem.fingers]
    pulls = [changes(f"{finger.spec.name}.change of pulls", 2) for finger in problem.fingers]
    forces = [contact.force[:2] + changes(f"change of force, {contact.spec.name}", 2) for contact in contacts]
    pose = changes("change of pose", 3)
    spun = rotation(pose[2])
    states = []
    for index, (finger, bend, pull) in enumerate(zip(problem.fingers, bends, pulls, strict=True)):
        # A round tip rolls about its own center.
        couple = sum(
            -finger.half(c.spec) * (force[1] - c.force[1]) / _moment(finger)
            for c, force in zip(contacts, forces, strict=True)
            if c.spec.finger == index and c.spec.joint < 0
        )
        states.append((finger.q + bend, finger.u + finger.input(pull, ca.SX(couple))))
    ends = [finger.backbone.joints(*state, finger.p) for finger, state in zip(problem.fingers, states, strict=True)]
    loads: list[tuple[dict[int, ca.SX], dict[int, ca.SX]]] = [({}, {}) for _ in problem.fingers]
    force = wrench[:2]
    moment = wrench[2]
    gaps = list[_Row]()
    for contact, components in zip(contacts, forces, strict=True):
        spec = contact.spec
        half = ca.SX(0)
        turned = ca.SX(0)
        gap = pose[:2] + spun @ (contact.point - problem.pose[:2])
        if spec.finger >= 0:
            finger, (places, angles) = problem.fingers[spec.finger], ends[spec.finger]
            end = finger.end_of(spec)
            half = finger.half(spec)
            turned = angles[end] + finger.base[2] - finger.angles[end]
            gap += half * rotation(turned) @ contact.normal - finger.world(places[:, end])
        turn, step = _rolled(problem, contact, turned, pose[2])
        load = rotation(turn) @ (components[0] * contact.normal + components[1] * contact.across)
        arm = spun @ (contact.point - problem.center_of_mass) + step * contact.across
        force -= load
        moment -= arm[0] * load[1] - arm[1] * load[0]
        if spec.finger >= 0:
            # The force moves on with the contact, by the step along the skin less what the section turns ahead of it.
            lever = half * (turned - turn) - step
            on, couples = loads[spec.finger]
            on[spec.joint] = rotation(-finger.base[2]) @ load / finger.number("force share")
            couples[spec.joint] = (contact.force[0] * lever - half * components[1]) / _moment(finger)
        gaps.append((f"sticking contact, {spec.name}", gap, "m", "disturbances"))
    for finger, (q, u), carried, pull in zip(problem.fingers, states, loads, pulls, strict=True):
        missing = _moment(finger) * finger.missing_force(q, u, finger.loads(*carried))
        yield f"disturbed finger, {finger.spec.name}", missing, "N m", "disturbances"
        if tendons == "locked":
            retained = _retained(finger, finger.backbone.drawn(q, u, finger.p), pull)
            yield f"locked tendons, {finger.spec.name}", retained, "rad", "disturbances.tendons"
        elif tendons == "constant":
            yield f"constant tensions, {finger.spec.name}", pull, "1", "disturbances.tendons"
    yield "disturbed object, forces", force, "N", "disturbances"
    yield "disturbed object, moment", moment / problem.numbers("size"), "moment per size", "disturbances"
    yield from gaps


def _moment(finger: UnitFinger) -> ca.SX:
    return finger.number("force share") * finger.number("length")


def _rolled(problem: PlanarPart, contact: Touch, finger_turn: ca.SX, object_turn: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Turn of the normal and step along the surface, rolling without slipping: the arc lengths traveled on both
    surfaces are equal.
    """
    ours, theirs = _curvatures(problem, contact)
    both = ca.fmax(ours + theirs, LEAST / problem.numbers("size"))
    return (theirs * object_turn + ours * finger_turn) / both, (finger_turn - object_turn) / both


def _curvatures(problem: PlanarPart, contact: Touch) -> tuple[ca.SX, ca.SX]:
    """Curvatures of the object's surface and of what touches it, convex positive."""
    spec = contact.spec
    name = contact.spec.name
    ours = contact.local.curvature
    if ours is None:
        ours = problem.numbers(f"{name}.curvature")
    if spec.finger < 0:
        return ours, problem.numbers(f"{name}.support curvature")
    finger = problem.fingers[spec.finger]
    if spec.joint < 0:  # the tip is round
        return ours, 1.0 / finger.half(spec)
    end = finger.end_of(spec)
    at = finger.curvatures()[1]
    # Where the curvature steps, at the joint of two arcs, the mean of both sides.
    bent = 0.5 * (at[-1, end] + at[0, end + 1])
    side = ca.dot(contact.normal, ca.vertcat(ca.cos(finger.angles[end]), ca.sin(finger.angles[end])))
    bent = side * bent / finger.number("length")
    # The skin is a parallel curve of the backbone: radii differ by half the thickness.
    return ours, -bent / (ca.sqrt(1.0 - finger.lean(spec) ** 2) - finger.half(spec) * bent)


def _retained(finger: UnitFinger, drawn: ca.SX, pulls: ca.SX) -> ca.SX:
    """Rows that are zero where the drives hold still while the bend draws in and the pulls change."""
    if not finger.spec.wound:
        # Fixed lengths need one moment: what one tendon gains, the other loses.
        return ca.vertcat(drawn, ca.sum1(pulls))
    arm = finger.number("arm")
    servo = finger.number("servo")
    rows = []
    yielded = servo * (pulls[0] - pulls[1])
    for k, (side, compliance) in enumerate(zip((1.0, -1.0), finger.compliances(), strict=True)):
        path = side * (arm * drawn + yielded) if finger.spec.pulley else side * arm * drawn + servo * pulls[k]
        # A slack tendon stays slack: weighted with how much it pulls.
        square = finger.pulls[k] ** 2
        tight = square / (square + finger.number("pulling") ** 2)
        # Per arm, so that it is an angle as above.
        rows.append((compliance * pulls[k] + tight * path) / arm)
    return ca.vertcat(*rows)


def _keep_limits(problem: PlanarPart, change: dict[str, ca.SX], case: str) -> None:
    require = problem.rows.require
    number = problem.numbers
    for contact in problem.contacts:
        name = contact.spec.name
        # Wrenches act in the plane: the lift stays.
        moved = contact.force[:2] + change[f"change of force, {name}"]
        force = ca.vertcat(moved, contact.force[2])[: problem.spec.dimensions]
        cone = friction_cone(number, number(f"{name}.friction"), force)
        require(f"disturbed friction cone, {name}, {case}", cone, "N", "contacts.friction", upper=ca.inf)
        spare = ca.vertcat(moved[0], number(f"{name}.normal_force_max") - moved[0])
        require(f"disturbed normal force, {name}, {case}", spare, "N", "contacts.normal_force_max", upper=ca.inf)
    for finger in problem.fingers:
        pulls = finger.pulls + change[f"{finger.spec.name}.change of pulls"]
        spare = ca.vertcat(pulls - finger.number("pull_min", 2), finger.number("pull_most", 2) - pulls)
        name = finger.spec.name
        require(f"disturbed tension, {name}, {case}", spare, f"tension, {name}", f"{name}.tendons", upper=ca.inf)
