"""Disturbances as part of the problem: the elastic answer of fingers and object to a wrench, to first order.

Under a small wrench the fingers bend, the object moves, the contacts stick (surface points of finger and object stay
together, supports stay), and forces and tensions change. With the changes d( ) per wrench as unknowns:

    finger    d(inverse dynamics at rest) = 0
    object    d(sum of forces and moments about the centre of mass) + rho * wrench = 0
    contact   d(surface point of the finger) = d(surface point of the object)
    limits    forces + changes within their cones, tensions + changes within their limits

Retensioned tendons change their tension freely; locked ones keep their length, so the tip's angle stays and the tension
reacts, shared equally where both tendons are there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca

from continuum_grasp.grasp.numbers import APEX
from continuum_grasp.grasp.unit_finger import FingerMake, rotation

if TYPE_CHECKING:
    from continuum_grasp.grasp.problem import FingerState, GraspProblem, TouchState

__all__ = ["add_disturbances"]


@dataclass(frozen=True)
class _Change:
    """Changes of the unknowns under one wrench."""

    q: list[ca.SX]
    pulls: list[ca.SX]
    forces: list[ca.SX]
    """Per contact, changes of N and f in the axes of the contact, which turn with the object."""
    pose: ca.SX


def add_disturbances(problem: GraspProblem) -> ca.SX:
    """Add unknowns and constraints for all wrenches; returns the factor by which each of them is resisted."""
    factor = problem.parts.unknown("resisted disturbance")
    wrenches = ca.reshape(problem.numbers("wrenches", 3 * problem.make.wrenches), 3, problem.make.wrenches)
    slopes = [
        _slope(finger, [c for c in problem.contacts if c.make.finger == index])
        for index, finger in enumerate(problem.fingers)
    ]
    for k in range(problem.make.wrenches):
        change = _changes(problem, k)
        moved = [_moved(problem, change, index, slope) for index, slope in enumerate(slopes)]
        _balance_fingers(problem, change, moved, k)
        _balance_object(problem, change, factor * wrenches[:, k], k)
        _stick(problem, change, moved, k)
        _keep_limits(problem, change, k)
    return factor


def _changes(problem: GraspProblem, k: int) -> _Change:
    add = problem.parts.unknown
    return _Change(
        [add(f"{f.make.name}.change of q, {k}", f.unit.model.n) for f in problem.fingers],
        [add(f"{f.make.name}.change of pulls, {k}", 2) for f in problem.fingers],
        [add(f"change of force, {c.make.name}, {k}", 2) for c in problem.contacts],
        add(f"change of pose, {k}", 3),
    )


def _spin(turn: ca.SX, arm: ca.SX) -> ca.SX:
    """Change of an arm that turns."""
    return turn * ca.vertcat(-arm[1], arm[0])


def _force_change(contact: TouchState, change: ca.SX, turn: ca.SX) -> ca.SX:
    """Change of the world force of a contact whose axes turn with the object."""
    return change[0] * contact.normal + change[1] * contact.across + _spin(turn, contact.world)


@dataclass(frozen=True)
class _Moved:
    """What the changes make of a finger."""

    missing: ca.SX
    """Generalised force, in units of the finger."""
    ends: ca.SX
    """Elements' ends (2, N), in units and axes of the finger."""
    angles: ca.SX
    """Angles there (N,)."""


def _slope(finger: FingerState, touching: list[TouchState]) -> ca.SX:
    """Derivative of (missing force, ends, angles) with respect to (q, u, w), in units and axes of the finger."""
    unit, make = finger.unit, finger.make
    model, share, h = unit.model, unit.number("force share"), unit.number("thickness")
    q, u, w = (ca.SX.sym(name, size) for name, size in (("q", model.n), ("u", 3), ("w", model.nw)))
    rest = ca.SX.zeros(model.n)
    missing = model.inverse_dynamics(q, rest, rest, u, w, finger.p)
    missing -= unit.hanging_masses(q, u, finger.p, finger.base[2])
    ends, angles = model.joints(q, u, finger.p)
    back = rotation(-finger.base[2])
    now = {c.make.joint: (back @ c.world / share, -h * c.force[1] / share) for c in touching}
    forces = {joint: force for joint, (force, _) in now.items()}
    couples = {joint: couple for joint, (_, couple) in now.items()}
    slope = ca.jacobian(ca.vertcat(missing, ca.vec(ends), angles), ca.vertcat(q, u, w))
    return ca.substitute(slope, ca.vertcat(q, u, w), ca.vertcat(finger.q, finger.u, _loads(make, forces, couples)))


def _loads(make: FingerMake, forces: dict[int, ca.SX], couples: dict[int, ca.SX]) -> ca.SX:
    """The model's loads for forces and couples by joint; the tip is -1, its couple is an input."""
    middles, zero = range(len(make.before)), ca.SX.zeros(2)
    return ca.vertcat(*(forces.get(k, zero) for k in [*middles, -1]), *(couples.get(k, 0.0) for k in middles))


def _moved(problem: GraspProblem, change: _Change, index: int, slope: ca.SX) -> _Moved:
    """What the changes make of a finger."""
    finger = problem.fingers[index]
    unit, make = finger.unit, finger.make
    share, h = unit.number("force share"), unit.number("thickness")
    back = rotation(-finger.base[2])
    touching = [
        (c, _force_change(c, own, change.pose[2]))
        for c, own in zip(problem.contacts, change.forces, strict=True)
        if c.make.finger == index
    ]
    n, rows = unit.model.n, slope.shape[0] - make.elements
    angles, du = slope[rows:, :], unit.input(change.pulls[index], ca.SX(0))
    turns = angles[:, : n + 3] @ ca.vertcat(change.q[index], du)
    by_couple = angles[:, n + 2]
    couples = {}
    for contact, force in sorted(touching, key=lambda t: t[0].make.joint):  # the tip's first
        # The couple of a surface force about the backbone is -h n x F, and n turns with the section.
        end, pressure = finger.end_of(contact.make), contact.force[0]
        lever = contact.normal[0] * force[1] - contact.normal[1] * force[0]
        couple = -h * (lever - turns[end] * pressure) / share
        if contact.make.joint < 0:
            couple /= 1.0 - h * by_couple[end] * pressure / share  # which turns the tip itself
            du[2], turns = couple, turns + by_couple * couple
        couples[contact.make.joint] = couple
    moved = {c.make.joint: back @ force / share for c, force in touching}
    values = slope @ ca.vertcat(change.q[index], du, _loads(make, moved, couples))
    return _Moved(values[:n], ca.reshape(values[n:rows], 2, make.elements), values[rows:])


def _balance_fingers(problem: GraspProblem, change: _Change, moved: list[_Moved], k: int) -> None:
    for index, finger in enumerate(problem.fingers):
        name, require = finger.make.name, problem.parts.require
        scale = finger.unit.number("force share") * finger.unit.number("length")
        require(f"disturbed finger, {name}, {k}", scale * moved[index].missing, "N m", "disturbances")
        if problem.make.locked:
            kept = ca.vertcat(moved[index].angles[-1], ca.sum1(change.pulls[index]))
            require(f"locked tendons, {name}, {k}", kept, "rad", "disturbances.tendons")


def _balance_object(problem: GraspProblem, change: _Change, wrench: ca.SX, k: int) -> None:
    force, moment = wrench[:2], wrench[2]
    turn = change.pose[2]
    for contact, own in zip(problem.contacts, change.forces, strict=True):
        arm = contact.point - problem.centre_of_mass
        moved = _force_change(contact, own, turn)
        force -= moved
        swung = _spin(turn, arm)
        load = contact.world
        moment -= arm[0] * moved[1] - arm[1] * moved[0] + swung[0] * load[1] - swung[1] * load[0]
    problem.parts.require(f"disturbed object, forces, {k}", force, "N", "disturbances")
    problem.parts.require(f"disturbed object, moment, {k}", moment / problem.numbers("size"), "N", "disturbances")


def _stick(problem: GraspProblem, change: _Change, moved: list[_Moved], k: int) -> None:
    for contact in problem.contacts:
        gap = change.pose[:2] + _spin(change.pose[2], contact.point - problem.pose[:2])
        if contact.make.finger >= 0:
            finger = problem.fingers[contact.make.finger]
            own, end = moved[contact.make.finger], finger.end_of(contact.make)
            gap -= finger.unit.number("length") * rotation(finger.base[2]) @ own.ends[:, end]
            gap += _spin(own.angles[end], problem.thickness(finger) * contact.normal)
        problem.parts.require(f"sticking contact, {contact.make.name}, {k}", gap, "m", "disturbances")


def _keep_limits(problem: GraspProblem, change: _Change, k: int) -> None:
    require = problem.parts.require
    for contact, own in zip(problem.contacts, change.forces, strict=True):
        name = contact.make.name
        n, f, lift = contact.force[0] + own[0], contact.force[1] + own[1], contact.force[2]
        friction = problem.numbers(f"{name}.friction")
        if problem.make.gravity == "out_of_plane":
            apex = APEX * problem.numbers("force reference")
            cone = friction * n - ca.sqrt(f**2 + lift**2 + apex**2)
        else:
            cone = ca.vertcat(friction * n - f, friction * n + f)
        require(f"disturbed friction cone, {name}, {k}", cone, "N", "contacts.friction", upper=ca.inf)
        room = problem.numbers(f"{name}.normal_force_max") - n
        require(f"disturbed normal force, {name}, {k}", room, "N", "contacts.normal_force_max", upper=ca.inf)
    for finger, own in zip(problem.fingers, change.pulls, strict=True):
        pulls, number = finger.pulls + own, finger.unit.number
        room = ca.vertcat(pulls - number("pull_min", 2), number("pull_most", 2) - pulls)
        require(f"disturbed tension, {finger.make.name}, {k}", room, "1", "tendons", upper=ca.inf)
