"""Disturbances as part of the problem: the elastic answer of fingers and object to a wrench, to first order.

Under a small wrench the fingers bend, the object moves, the contacts roll without slipping (surface points of finger
and object move together, supports stay), and forces and tensions change. With the changes d( ) per wrench as unknowns:

    finger    d(inverse dynamics at rest) = 0
    object    d(sum of forces and moments about the center of mass) + rho * wrench = 0
    contact   d(surface point of the finger) = d(surface point of the object)
              where finger and object turn by d phi and d psi, the contact rolls on by (d phi - d psi) / (ko + kf) and
              its normal turns by (kf d psi + ko d phi) / (ko + kf), ko and kf being the curvatures of their surfaces
    limits    forces + changes within their cones, tensions + changes within their limits

Retensioned tendons change their tension freely; locked ones have a fixed length, so the tip's angle stays and the
tension reacts, shared equally where both tendons are there.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from continuum_grasp.grasp.problem.blocks import rotation
from continuum_grasp.grasp.problem.limits import friction_cone
from continuum_grasp.grasp.problem.unit_finger import UnitFinger
from continuum_grasp.grasp.problem.unknowns import Touch, Unknowns

LEAST = 0.02
"""Least sum of the curvatures of two surfaces that touch, per size of the object: below it the contact
point would run along the finger without bound as it rolls; a finger that fits the object counts as wrapped."""


@dataclass(frozen=True)
class _Change:
    """Changes of the unknowns under one wrench."""

    q: list[ca.SX]  # per finger
    pulls: list[ca.SX]  # per finger
    forces: list[ca.SX]  # per contact, of N and f in the axes of the contact
    pose: ca.SX


@dataclass(frozen=True)
class _Roll:
    """How a contact moves on where finger (or support) and object turn."""

    turn: ca.SX  # of the normal
    step: ca.SX  # along the surface


@dataclass(frozen=True)
class _Moved:
    """A finger after the changes."""

    missing: ca.SX  # generalized force, in units of the finger
    ends: ca.SX  # elements' ends (2, N), in units and axes of the finger
    angles: ca.SX  # angles there (N,)
    drawn: ca.SX  # what is drawn in of the tendons, per offset
    rolls: dict[str, _Roll]  # of its contacts, by name


def add_disturbances(problem: Unknowns) -> ca.SX:
    """Add unknowns and constraints for all wrenches; returns the factor by which each of them is resisted."""
    spec, add = problem.spec, problem.x
    factor = add("resisted disturbance")
    wrenches = ca.reshape(problem.numbers("wrenches", 3 * spec.wrenches), 3, spec.wrenches)
    slopes = [_slope(finger, problem.loads(index)) for index, finger in enumerate(problem.fingers)]
    for k in range(spec.wrenches):
        change = _Change(
            [add(f"{f.spec.name}.change of q, {k}", f.q.numel()) for f in problem.fingers],
            [add(f"{f.spec.name}.change of pulls, {k}", 2) for f in problem.fingers],
            [add(f"change of force, {c.spec.name}, {k}", 2) for c in problem.contacts],
            add(f"change of pose, {k}", 3),
        )
        moved = [_moved(problem, change, index, slope) for index, slope in enumerate(slopes)]
        _balance_fingers(problem, change, moved, k)
        _balance_object(problem, change, moved, factor * wrenches[:, k], k)
        _stick(problem, change, moved, k)
        _keep_limits(problem, change, k)
    return factor


def _spin(turn: ca.SX, arm: ca.SX) -> ca.SX:
    """Change of an arm that turns."""
    return turn * ca.vertcat(-arm[1], arm[0])


def _rolled(problem: Unknowns, contact: Touch, finger_turn: ca.SX, object_turn: ca.SX) -> _Roll:
    """Rolling without slipping: the arc lengths traveled on both surfaces are equal."""
    ours, theirs = _curvatures(problem, contact)
    both = ca.fmax(ours + theirs, LEAST / problem.numbers("size"))
    turn = (theirs * object_turn + ours * finger_turn) / both
    return _Roll(turn, (finger_turn - object_turn) / both)


def _curvatures(problem: Unknowns, contact: Touch) -> tuple[ca.SX, ca.SX]:
    """Curvatures of the object's surface and of what touches it, convex positive."""
    spec, name = contact.spec, contact.spec.name
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


def _force_change(contact: Touch, change: ca.SX, turn: ca.SX) -> ca.SX:
    """Change of the world force of a contact whose axes turn."""
    return change[0] * contact.normal + change[1] * contact.across + _spin(turn, contact.world)


def _slope(finger: UnitFinger, loads: ca.SX) -> ca.SX:
    """Derivative of (missing force, ends, angles, what is drawn in of the tendons) with respect to (q, u, w), in units
    and axes of the finger.
    """
    sizes = (("q", finger.q.numel()), ("u", 3), ("w", finger.model.nw))
    q, u, w = (ca.SX.sym(name, size) for name, size in sizes)
    missing = finger.missing_force(q, u, w)
    ends, angles = finger.joints_at(q, u)
    slope = ca.jacobian(ca.vertcat(missing, ca.vec(ends), angles, finger.drawn(q, u)), ca.vertcat(q, u, w))
    return ca.substitute(slope, ca.vertcat(q, u, w), ca.vertcat(finger.q, finger.u, loads))


def _moved(problem: Unknowns, change: _Change, index: int, slope: ca.SX) -> _Moved:
    """A finger after the changes."""
    finger = problem.fingers[index]
    share, size = finger.number("force share"), finger.spec.elements
    back = rotation(-finger.base[2])
    touching = [(c, own) for c, own in zip(problem.contacts, change.forces, strict=True) if c.spec.finger == index]
    n, rows = finger.q.numel(), slope.shape[0] - 1 - size
    angles, du = slope[rows:-1, :], finger.input(change.pulls[index], ca.SX(0))
    moments = share * finger.number("length")
    for contact, own in touching:  # a round tip rolls about its own center
        if contact.spec.joint < 0:
            du[2] = -finger.half(contact.spec) * own[1] / moments
    turns = angles[:, : n + 3] @ ca.vertcat(change.q[index], du)
    rolls, couples, moved = {}, {}, {}
    for contact, own in touching:
        turn = turns[finger.end_of(contact.spec)]
        roll = rolls[contact.spec.name] = _rolled(problem, contact, turn, change.pose[2])
        h = finger.half(contact.spec)
        # The force moves on with the contact, by the step along the skin less what the section turns ahead of it.
        lever = h * (turn - roll.turn) - roll.step
        couples[contact.spec.joint] = (-h * own[1] + contact.force[0] * lever) / moments
        moved[contact.spec.joint] = back @ _force_change(contact, own, roll.turn) / share
    values = slope @ ca.vertcat(change.q[index], du, finger.loads(moved, couples))
    return _Moved(values[:n], ca.reshape(values[n:rows], 2, size), values[rows:-1], values[-1], rolls)


def _balance_fingers(problem: Unknowns, change: _Change, moved: list[_Moved], k: int) -> None:
    require = problem.rows.require
    for index, finger in enumerate(problem.fingers):
        name = finger.spec.name
        scale = finger.number("force share") * finger.number("length")
        require(f"disturbed finger, {name}, {k}", scale * moved[index].missing, "N m", "disturbances")
        if problem.spec.locked:
            retained = _retained(finger, moved[index].drawn, change.pulls[index])
            require(f"locked tendons, {name}, {k}", retained, "rad", "disturbances.tendons")


def _retained(finger: UnitFinger, drawn: ca.SX, pulls: ca.SX) -> ca.SX:
    """What is zero where the drives hold still while the bend draws in and the pulls change."""
    if not finger.spec.wound:
        # Fixed lengths need one moment: what one tendon gains, the other loses.
        return ca.vertcat(drawn, ca.sum1(pulls))
    arm, servo, rows = finger.number("arm"), finger.number("servo"), []
    yielded = servo * (pulls[0] - pulls[1])
    for k, (side, compliance) in enumerate(zip((1.0, -1.0), finger.compliances(), strict=True)):
        path = side * (arm * drawn + yielded) if finger.spec.pulley else side * arm * drawn + servo * pulls[k]
        # A slack tendon stays slack: weighted with how taut it is.
        square = finger.pulls[k] ** 2
        taut = square / (square + finger.number("taut") ** 2)
        # Per arm, so that it is an angle as above.
        rows.append((compliance * pulls[k] + taut * path) / arm)
    return ca.vertcat(*rows)


def _balance_object(problem: Unknowns, change: _Change, moved: list[_Moved], wrench: ca.SX, k: int) -> None:
    force, moment = wrench[:2], wrench[2]
    turn = change.pose[2]
    rolls = {name: roll for finger in moved for name, roll in finger.rolls.items()}
    for contact, own in zip(problem.contacts, change.forces, strict=True):
        arm = contact.point - problem.center_of_mass
        roll = rolls.get(contact.spec.name) or _rolled(problem, contact, ca.SX(0), turn)
        added = _force_change(contact, own, roll.turn)
        force -= added
        swung = _spin(turn, arm) + roll.step * contact.across
        load = contact.world
        moment -= arm[0] * added[1] - arm[1] * added[0] + swung[0] * load[1] - swung[1] * load[0]
    require = problem.rows.require
    require(f"disturbed object, forces, {k}", force, "N", "disturbances")
    require(f"disturbed object, moment, {k}", moment / problem.numbers("size"), "N", "disturbances")


def _stick(problem: Unknowns, change: _Change, moved: list[_Moved], k: int) -> None:
    for contact in problem.contacts:
        gap = change.pose[:2] + _spin(change.pose[2], contact.point - problem.pose[:2])
        if contact.spec.finger >= 0:
            finger = problem.fingers[contact.spec.finger]
            own, end = moved[contact.spec.finger], finger.end_of(contact.spec)
            gap -= finger.number("length") * rotation(finger.base[2]) @ own.ends[:, end]
            gap += _spin(own.angles[end], finger.half(contact.spec) * contact.normal)
        problem.rows.require(f"sticking contact, {contact.spec.name}, {k}", gap, "m", "disturbances")


def _keep_limits(problem: Unknowns, change: _Change, k: int) -> None:
    require, number = problem.rows.require, problem.numbers
    for contact, own in zip(problem.contacts, change.forces, strict=True):
        name = contact.spec.name
        # Wrenches act in the plane: the lift stays.
        n, f, lift = contact.force[0] + own[0], contact.force[1] + own[1], contact.force[2]
        cone = friction_cone(problem, number(f"{name}.friction"), n, f, lift)
        require(f"disturbed friction cone, {name}, {k}", cone, "N", "contacts.friction", upper=ca.inf)
        spare = ca.vertcat(n, number(f"{name}.normal_force_max") - n)
        require(f"disturbed normal force, {name}, {k}", spare, "N", "contacts.normal_force_max", upper=ca.inf)
    for finger, own in zip(problem.fingers, change.pulls, strict=True):
        pulls = finger.pulls + own
        spare = ca.vertcat(pulls - finger.number("pull_min", 2), finger.number("pull_most", 2) - pulls)
        require(f"disturbed tension, {finger.spec.name}, {k}", spare, "1", "tendons", upper=ca.inf)
