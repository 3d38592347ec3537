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

from continuum_grasp.grasp.problem.limits import friction_cone
from continuum_grasp.grasp.problem.unit_finger import FingerSpec, rotation
from continuum_grasp.grasp.problem.unknowns import FingerState, TouchState, Unknowns

LEAST = 0.02
"""Least sum of the curvatures of two surfaces that touch, per size of the object: below it the contact
point would run along the finger without bound as it rolls; a finger that fits the object counts as wrapped."""


@dataclass(frozen=True)
class _Change:
    """Changes of the unknowns under one wrench."""

    q: list[ca.SX]
    pulls: list[ca.SX]
    forces: list[ca.SX]
    """Per contact, changes of N and f in the axes of the contact."""
    pose: ca.SX


def add_disturbances(problem: Unknowns) -> ca.SX:
    """Add unknowns and constraints for all wrenches; returns the factor by which each of them is resisted."""
    factor = problem.parts.unknown("resisted disturbance")
    wrenches = ca.reshape(problem.numbers("wrenches", 3 * problem.spec.wrenches), 3, problem.spec.wrenches)
    slopes = [
        _slope(finger, [c for c in problem.contacts if c.spec.finger == index])
        for index, finger in enumerate(problem.fingers)
    ]
    for k in range(problem.spec.wrenches):
        change = _changes(problem, k)
        moved = [_moved(problem, change, index, slope) for index, slope in enumerate(slopes)]
        _balance_fingers(problem, change, moved, k)
        rolls = {name: roll for finger in moved for name, roll in finger.rolls.items()}
        _balance_object(problem, change, rolls, factor * wrenches[:, k], k)
        _stick(problem, change, moved, k)
        _keep_limits(problem, change, k)
    return factor


def _changes(problem: Unknowns, k: int) -> _Change:
    add = problem.parts.unknown
    return _Change(
        [add(f"{f.spec.name}.change of q, {k}", f.unit.model.n) for f in problem.fingers],
        [add(f"{f.spec.name}.change of pulls, {k}", 2) for f in problem.fingers],
        [add(f"change of force, {c.spec.name}, {k}", 2) for c in problem.contacts],
        add(f"change of pose, {k}", 3),
    )


def _spin(turn: ca.SX, arm: ca.SX) -> ca.SX:
    """Change of an arm that turns."""
    return turn * ca.vertcat(-arm[1], arm[0])


@dataclass(frozen=True)
class _Roll:
    """How a contact moves on where finger (or support) and object turn."""

    turn: ca.SX
    """Of the normal."""
    step: ca.SX
    """Along the surface."""

    @staticmethod
    def of(problem: Unknowns, contact: TouchState, finger_turn: ca.SX, object_turn: ca.SX) -> _Roll:
        ours, theirs = _curvatures(problem, contact)
        both = ca.fmax(ours + theirs, LEAST / problem.numbers("size"))
        turn = (theirs * object_turn + ours * finger_turn) / both
        return _Roll(turn, (finger_turn - object_turn) / both)


def _curvatures(problem: Unknowns, contact: TouchState) -> tuple[ca.SX, ca.SX]:
    """Curvatures of the object's surface and of what touches it, convex positive."""
    spec, name = contact.spec, contact.spec.name
    ours = contact.local.curvature
    if ours is None:
        ours = problem.numbers(f"{name}.curvature")
    if spec.finger < 0:
        return ours, problem.numbers(f"{name}.support curvature")
    finger = problem.fingers[spec.finger]
    if spec.joint < 0:
        return ours, 1.0 / problem.thickness(finger)
    unit, end = finger.unit, finger.end_of(spec)
    at = unit.curvatures_at_places(finger.q, finger.u, finger.p)
    bent = 0.5 * (at[-1, end] + at[0, end + 1])
    side = ca.dot(contact.normal, ca.vertcat(ca.cos(finger.angles[end]), ca.sin(finger.angles[end])))
    bent = side * bent / unit.number("length")
    return ours, -bent / (1.0 - problem.thickness(finger) * bent)


def _force_change(contact: TouchState, change: ca.SX, turn: ca.SX) -> ca.SX:
    """Change of the world force of a contact whose axes turn."""
    return change[0] * contact.normal + change[1] * contact.across + _spin(turn, contact.world)


@dataclass(frozen=True)
class _Moved:
    """A finger after the changes."""

    missing: ca.SX
    """Generalized force, in units of the finger."""
    ends: ca.SX
    """Elements' ends (2, N), in units and axes of the finger."""
    angles: ca.SX
    """Angles there (N,)."""
    rolls: dict[str, _Roll]
    """Of its contacts, by name."""


def _slope(finger: FingerState, touching: list[TouchState]) -> ca.SX:
    """Derivative of (missing force, ends, angles) with respect to (q, u, w), in units and axes of the finger."""
    unit, spec = finger.unit, finger.spec
    model, share, h = unit.model, unit.number("force share"), unit.number("thickness")
    q, u, w = (ca.SX.sym(name, size) for name, size in (("q", model.n), ("u", 3), ("w", model.nw)))
    rest = ca.SX.zeros(model.n)
    missing = model.inverse_dynamics(q, rest, rest, u, w, finger.p)
    missing -= unit.hanging_masses(q, u, finger.p, finger.base[2])
    ends, angles = model.joints(q, u, finger.p)
    back = rotation(-finger.base[2])
    now = {c.spec.joint: (back @ c.world / share, -h * c.force[1] / share) for c in touching}
    forces = {joint: force for joint, (force, _) in now.items()}
    couples = {joint: couple for joint, (_, couple) in now.items()}
    slope = ca.jacobian(ca.vertcat(missing, ca.vec(ends), angles), ca.vertcat(q, u, w))
    return ca.substitute(slope, ca.vertcat(q, u, w), ca.vertcat(finger.q, finger.u, _loads(spec, forces, couples)))


def _loads(spec: FingerSpec, forces: dict[int, ca.SX], couples: dict[int, ca.SX]) -> ca.SX:
    """The model's loads for forces and couples by joint; the tip is -1, its couple is an input."""
    middles, zero = range(len(spec.before)), ca.SX.zeros(2)
    return ca.vertcat(*(forces.get(k, zero) for k in [*middles, -1]), *(couples.get(k, 0.0) for k in middles))


def _moved(problem: Unknowns, change: _Change, index: int, slope: ca.SX) -> _Moved:
    """A finger after the changes."""
    finger = problem.fingers[index]
    unit, spec = finger.unit, finger.spec
    share, h = unit.number("force share"), problem.thickness(finger)
    back = rotation(-finger.base[2])
    touching = [(c, own) for c, own in zip(problem.contacts, change.forces, strict=True) if c.spec.finger == index]
    n, rows = unit.model.n, slope.shape[0] - spec.elements
    angles, du = slope[rows:, :], unit.input(change.pulls[index], ca.SX(0))
    moments = share * unit.number("length")
    for contact, own in touching:  # a round tip rolls about its own center
        if contact.spec.joint < 0:
            du[2] = -h * own[1] / moments
    turns = angles[:, : n + 3] @ ca.vertcat(change.q[index], du)
    rolls, couples, moved = {}, {}, {}
    for contact, own in touching:
        turn = turns[finger.end_of(contact.spec)]
        roll = rolls[contact.spec.name] = _Roll.of(problem, contact, turn, change.pose[2])
        lever = h * (turn - roll.turn) - roll.step
        couples[contact.spec.joint] = (-h * own[1] + contact.force[0] * lever) / moments
        moved[contact.spec.joint] = back @ _force_change(contact, own, roll.turn) / share
    values = slope @ ca.vertcat(change.q[index], du, _loads(spec, moved, couples))
    return _Moved(values[:n], ca.reshape(values[n:rows], 2, spec.elements), values[rows:], rolls)


def _balance_fingers(problem: Unknowns, change: _Change, moved: list[_Moved], k: int) -> None:
    for index, finger in enumerate(problem.fingers):
        name, require = finger.spec.name, problem.parts.require
        scale = finger.unit.number("force share") * finger.unit.number("length")
        require(f"disturbed finger, {name}, {k}", scale * moved[index].missing, "N m", "disturbances")
        if problem.spec.locked:
            retained = ca.vertcat(moved[index].angles[-1], ca.sum1(change.pulls[index]))
            require(f"locked tendons, {name}, {k}", retained, "rad", "disturbances.tendons")


def _balance_object(problem: Unknowns, change: _Change, rolls: dict[str, _Roll], wrench: ca.SX, k: int) -> None:
    force, moment = wrench[:2], wrench[2]
    turn = change.pose[2]
    for contact, own in zip(problem.contacts, change.forces, strict=True):
        arm = contact.point - problem.center_of_mass
        roll = rolls.get(contact.spec.name) or _Roll.of(problem, contact, ca.SX(0), turn)
        moved = _force_change(contact, own, roll.turn)
        force -= moved
        swung = _spin(turn, arm) + roll.step * contact.across
        load = contact.world
        moment -= arm[0] * moved[1] - arm[1] * moved[0] + swung[0] * load[1] - swung[1] * load[0]
    problem.parts.require(f"disturbed object, forces, {k}", force, "N", "disturbances")
    problem.parts.require(f"disturbed object, moment, {k}", moment / problem.numbers("size"), "N", "disturbances")


def _stick(problem: Unknowns, change: _Change, moved: list[_Moved], k: int) -> None:
    for contact in problem.contacts:
        gap = change.pose[:2] + _spin(change.pose[2], contact.point - problem.pose[:2])
        if contact.spec.finger >= 0:
            finger = problem.fingers[contact.spec.finger]
            own, end = moved[contact.spec.finger], finger.end_of(contact.spec)
            gap -= finger.unit.number("length") * rotation(finger.base[2]) @ own.ends[:, end]
            gap += _spin(own.angles[end], problem.thickness(finger) * contact.normal)
        problem.parts.require(f"sticking contact, {contact.spec.name}, {k}", gap, "m", "disturbances")


def _keep_limits(problem: Unknowns, change: _Change, k: int) -> None:
    require = problem.parts.require
    for contact, own in zip(problem.contacts, change.forces, strict=True):
        name = contact.spec.name
        n, f, lift = contact.force[0] + own[0], contact.force[1] + own[1], contact.force[2]
        friction = problem.numbers(f"{name}.friction")
        cone = friction_cone(problem, friction, n, f, lift)
        require(f"disturbed friction cone, {name}, {k}", cone, "N", "contacts.friction", upper=ca.inf)
        spare = problem.numbers(f"{name}.normal_force_max") - n
        require(f"disturbed normal force, {name}, {k}", spare, "N", "contacts.normal_force_max", upper=ca.inf)
    for finger, own in zip(problem.fingers, change.pulls, strict=True):
        pulls, number = finger.pulls + own, finger.unit.number
        spare = ca.vertcat(pulls - number("pull_min", 2), number("pull_most", 2) - pulls)
        require(f"disturbed tension, {finger.spec.name}, {k}", spare, "1", "tendons", upper=ca.inf)
