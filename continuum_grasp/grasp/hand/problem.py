"""The grasp of a hand in space as a nonlinear problem: fingers in planes of their own, an object with six balances.

Units of the problem: length of the longest finger, greatest E I / L^2 of the fingers as force, radians. Each finger is
the planar one of `continuum_grasp.grasp.problem.unit_finger`, in a plane with axes x, y and normal z. At a contact the
backbone p of a round finger of half thickness h, displaced by w out of its plane to p + w z, is as far from the object;
n is the gradient of its distance d there, x = p + w z - h n the point touched:

    contact    d(p + w z) = h,  n . (t + w' z) = 0 (middle)
    finger     its planar equilibrium under the part of f = N n + f1 a + f2 b in the plane, and the couple
               z . ((x - p) x f); a = z x n / |z x n|, b = n x a
    to the side  w and w' by bending E I_l and torsion G J under f and its couples (`continuum_grasp.grasp.hand.lean`)
    object     m g - sum f = 0,  moments about the center of mass = 0, with the forces on palm and table, whose contacts
               are at given points

In the plane of a round finger, n . t = 0 with a gap of h says that its line touches the section of the grown object.
The object has no part in the structure: for each contact and place that stays clear, numbers are a cubic that stands
for the surface d = h near by. The search moves them until they are where contacts and places are; there they are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from continuum_grasp.grasp.hand.lean import EndLoad, Lean
from continuum_grasp.grasp.problem.blocks import Columns, Expressed
from continuum_grasp.grasp.problem.limits import friction_cone, keep_limits
from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.structure import FingerSpec
from continuum_grasp.grasp.problem.unit_finger import UnitFinger
from continuum_grasp.nlp import NLP
from continuum_grasp.scene import HandScene

RELAXED = ("tension", "friction", "normal force", "mass")
"""Limits of a hand that may be relaxed."""
SURFACE = 45
"""Numbers of a surface near a place."""
GRIPPED = 1e-3
"""Weight of the tensions beside squared friction, so that tendons do not pull against each other."""
LITTLE = 1e-8
"""Weight of the squared contact forces, so that they are unique where equilibrium does not fix them."""


@dataclass(frozen=True)
class SpatialContact:
    """A contact that is on."""

    name: str
    finger: int  # index of the finger
    joint: int  # 0 for the middle contact, -1 for the tip


@dataclass(frozen=True)
class HandSpec:
    """The problem of a hand but for its numbers."""

    fingers: tuple[FingerSpec, ...]
    contacts: tuple[SpatialContact, ...]
    carried: tuple[str, ...] = ()  # names of the contacts with palm and table
    planes: tuple[str, ...] = ()  # names of what fingers keep clear of: palm, table
    pairs: tuple[tuple[int, int], ...] = ()  # indices of fingers that keep clear of each other
    dimensions: int = 3  # of a contact force
    gripped: bool = False  # whether the sum of normal forces is given, and friction the least
    steadied: bool = False  # whether there is a bound on what the least eigenvalue is to first order

    @staticmethod
    def of(scene: HandScene, on: frozenset[str]) -> HandSpec:
        """The structure of the problem of a scene with some contacts on, by name."""
        fingers, contacts = [], list[SpatialContact]()
        for k, setup in enumerate(scene.setups):
            fingers.append(FingerSpec.of(setup, on, any(scene.acceleration)))
            places = {setup.middle_names[0]: 0, setup.tip_name: -1}
            contacts += [SpatialContact(name, k, joint) for name, joint in places.items() if name in on]
        return HandSpec(tuple(fingers), tuple(contacts), *_supports(scene, on))


def _supports(scene: HandScene, on: frozenset[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Names of the contacts with palm and table that are on, and of those that the scene has."""
    carried = tuple(contact.name for contact in scene.support_contacts if contact.name in on)
    return carried, tuple(support.name for support in scene.supports)


def grown(point: ca.SX, surface: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Distance of a point beyond a surface near by, to first order, and the gradient of that.

    The surface is a place of it (3,), the normal there (3,) and the slope of the distance (3,), which is another one on
    triangles that stand for a curved surface, and second and third derivatives (9,) and (27,).
    """
    near, outward, slope, bending, changing = ca.vertsplit(surface, [0, 3, 6, 9, 18, SURFACE])
    away, curved = point - near, bending.reshape((3, 3))
    turning = (changing.reshape((9, 3)) @ away).reshape((3, 3))
    return ca.dot(slope + (curved / 2.0 + turning / 6.0) @ away, away), outward + (curved + turning / 2.0) @ away


@dataclass(frozen=True)
class SpatialTouch:
    """A contact's unknowns and what follows from them, as the hand sees them."""

    spec: SpatialContact
    backbone: ca.SX  # (3,) point of the finger's line
    beyond: ca.SX  # the surface a half thickness from the object, to first order the distance of that point
    normal: ca.SX  # (3,) outward, of the object
    sine: ca.SX  # of the angle between the normal and that of the finger's plane
    force: ca.SX  # (3,) N and friction: along a, in the plane across the normal, and along b = n x a
    world: ca.SX  # (3,) force on the finger


@dataclass(frozen=True)
class CarriedPoint:
    """A contact of the object with palm or table: its unknown force and what follows from it, as the hand sees it."""

    name: str
    point: ca.SX  # (3,) of the object's surface
    normal: ca.SX  # (3,) outward, of the object
    force: ca.SX  # (3,) N and friction
    world: ca.SX  # (3,) force on the palm or table


class HandProblem:
    """Unknowns, constraints and objective of the grasp of a hand."""

    def __init__(self, spec: HandSpec) -> None:
        self.spec = spec
        self.x, self.numbers, self.rows = Columns(), Columns(), Expressed()
        self.slack = {
            r.name: self.x(f"relaxed {r.name}") if r.name in RELAXED else ca.SX(r.size, 1) for r in RELAXATIONS
        }
        self.frames = [self.numbers(f"{finger.name}.axes", 9).reshape((3, 3)) for finger in spec.fingers]
        self.contacts = [self._touch(contact) for contact in spec.contacts]
        self.carried = [self._carry(name) for name in spec.carried]
        tips = {c.spec.finger: c for c in self.contacts if c.spec.joint == -1}
        self.fingers, self.points = list[UnitFinger](), dict[str, ca.SX]()
        for k, of in enumerate(spec.fingers):
            # In the plane, friction along a has all of its couple about z but for the lean of the normal.
            tip = ca.vertcat(tips[k].force[0], tips[k].force[1] * tips[k].sine, 0.0) if k in tips else ca.SX(3, 1)
            self.fingers.append(UnitFinger(of, self.x, self.numbers, tip))
        self.leans = [Lean(finger, self.x) for finger in self.fingers]
        for k, finger in enumerate(self.fingers):
            self._add_finger(k, finger)
        for k, m in spec.pairs:
            self._keep_apart(k, m)
        self._balance_object()
        for contact in self.contacts:
            self._bound(contact.spec.name, contact.force, self.slack["friction"])
        for carried in self.carried:
            # Friction of a palm or table of its own is not relaxed.
            slack = self.numbers(f"{carried.name}.as elsewhere") * self.slack["friction"]
            self._bound(carried.name, carried.force, slack)
        if spec.steadied:
            self._steady()
        self.objective = self._objective()

    # -- contacts ------------------------------------------------------------------------------------------------

    def _touch(self, contact: SpatialContact) -> SpatialTouch:
        name, number, axes = contact.name, self.numbers, self.frames[contact.finger]
        backbone = self.x(f"place, {name}", 3)
        beyond, gradient = grown(backbone, number(f"{name}.surface", SURFACE))
        normal = gradient / ca.sqrt(ca.sumsqr(gradient))
        across = ca.cross(axes[:, 2], normal)
        sine = ca.sqrt(ca.sumsqr(across))
        a = across / sine
        force = self.x(f"force, {name}", 3)
        world = force[0] * normal + force[1] * a + force[2] * ca.cross(normal, a)
        return SpatialTouch(contact, backbone, beyond, normal, sine, force, world)

    def _carry(self, name: str) -> CarriedPoint:
        axes, force = self.numbers(f"{name}.axes", 9).reshape((3, 3)), self.x(f"force, {name}", 3)
        return CarriedPoint(name, self.numbers(f"{name}.point", 3), axes[:, 0], force, axes @ force)

    def _bound(self, name: str, force: ca.SX, slack: ca.SX) -> None:
        n, f, g = ca.vertsplit(force)
        cone = friction_cone(self, self.numbers(f"{name}.friction") + slack, n, f, g)
        self.rows.require(f"friction cone, {name}", cone, "N", f"contacts.friction ({name})", upper=ca.inf)
        limit = self.numbers(f"{name}.normal_force_max") + self.slack["normal force"]
        self.rows.require(f"normal force, {name}", limit - n, "N", "contacts.normal_force_max", upper=ca.inf)

    # -- fingers -------------------------------------------------------------------------------------------------

    def _add_finger(self, k: int, finger: UnitFinger) -> None:
        require, name = self.rows.require, finger.spec.name
        touching = [c for c in self.contacts if c.spec.finger == k]
        share, axes = finger.number("force share"), self.frames[k]
        forces = {c.spec.joint: (axes.T @ c.world)[:2] / share for c in touching}
        couples = {c.spec.joint: -finger.half_at(self.end_of(c.spec)) * c.force[1] * c.sine / share for c in touching}
        missing = finger.missing_force(finger.q, finger.u, finger.loads(forces, couples))
        require(f"finger equilibrium, {name}", share * finger.number("length") * missing, "N m", name)
        turns, shifts = self.leans[k].rows([self._end_load(contact, finger, axes) for contact in touching])
        require(f"turns to the side, {name}", turns, "rad", name)
        require(f"shifts to the side, {name}", finger.number("length") * shifts, "m", name)
        for contact in touching:
            self._close(contact, finger, axes)
        self._keep_clear(k)
        keep_limits(self, finger)

    def _end_load(self, contact: SpatialTouch, finger: UnitFinger, axes: ca.SX) -> EndLoad:
        """Force of a contact on its finger and the couple of it, in the axes of the finger's plane."""
        end, force = self.end_of(contact.spec), axes.T @ contact.world / finger.number("force share")
        return EndLoad(end, force, -finger.half_at(end) * ca.cross(axes.T @ contact.normal, force))

    def shift_of(self, contact: SpatialContact) -> ca.SX:
        """Shift of a contact's backbone out of its plane."""
        finger = self.fingers[contact.finger]
        return finger.number("length") * self.leans[contact.finger].shift(self.end_of(contact))

    def end_of(self, contact: SpatialContact) -> int:
        """Index of the element at whose end a contact sits."""
        spec = self.spec.fingers[contact.finger]
        return spec.elements - 1 if contact.joint < 0 else spec.before[0] - 1

    def _close(self, contact: SpatialTouch, finger: UnitFinger, axes: ca.SX) -> None:
        """The finger touches: no gap, and along the finger it is tangent."""
        name, end, require = contact.spec.name, self.end_of(contact.spec), self.rows.require
        key = f"contacts.{name}"
        thick = finger.half_at(end) * finger.number("length")
        place = self.in_space(finger, axes, finger.ends[:, end]) + axes[:, 2] * self.shift_of(contact.spec)
        require(f"contact place, {name}", place - contact.backbone, "m", key)
        require(f"contact gap, {name}", contact.beyond, "m", key)
        self.points[name] = contact.backbone - thick * contact.normal
        along = ca.vertcat(-ca.sin(finger.angles[end]), ca.cos(finger.angles[end]))
        slope = self.leans[contact.spec.finger].slope(end)
        tilt = ca.dot(axes[:, :2] @ along + slope * axes[:, 2], contact.normal)
        if contact.spec.joint == 0:
            require(f"contact tangency, {name}", tilt, "rad", key)
        else:
            require(f"contact direction, {name}", ca.sqrt(self.numbers("tolerance")) - tilt, "rad", key, upper=ca.inf)

    def in_space(self, finger: UnitFinger, axes: ca.SX, points: ca.SX) -> ca.SX:
        """Points (3, K) of places in the finger's plane (2, K)."""
        base = self.numbers(f"{finger.spec.name}.position", 3)
        return ca.repmat(base, 1, points.shape[1]) + axes[:, :2] @ points

    def guarded(self, k: int) -> ca.SX:
        """Places (3, K) of finger k that must stay clear, displaced by cubics between the ends of its elements."""
        finger, axes = self.fingers[k], self.frames[k]
        points, owners, _, _ = finger.guarded
        lean, aside = self.leans[k], list[ca.SX]()
        for element, share in zip(owners, finger.guarded_shares, strict=True):
            first, last = lean.shift(element - 1), lean.shift(element)
            behind, ahead = share**2 * (3.0 - 2.0 * share), share * (1.0 - share)
            bent = lean.slope(element - 1) * (1.0 - share) - lean.slope(element) * share
            aside.append(first + (last - first) * behind + finger.lengths[element] * ahead * bent)
        return self.in_space(finger, axes, points) + axes[:, 2] @ (finger.number("length") * ca.horzcat(*aside))

    def _keep_clear(self, k: int) -> None:
        """Guarded places keep clear of the object as it is near them."""
        finger, points = self.fingers[k], self.guarded(k)
        _, _, touches, thick = finger.guarded
        free = points[:, [j for j, touching in enumerate(touches) if not touching]]
        near = finger.number("surfaces", SURFACE * free.shape[1]).reshape((SURFACE, free.shape[1]))
        beyond = [grown(free[:, j], near[:, j])[0] for j in range(free.shape[1])]
        spare = ca.vertcat(*beyond) + finger.number("tolerance")
        self.rows.require(f"penetration into the object, {finger.spec.name}", spare, "m", "object", upper=ca.inf)
        for support in self.spec.planes:
            plane, free_there = self.numbers(f"{support}.plane", 4), finger.number(f"clear of {support}", len(touches))
            heights = points.T @ plane[:3] - plane[3]
            spare = free_there * (heights - thick) + finger.number("tolerance")
            self.rows.require(f"penetration into the {support}, {finger.spec.name}", spare, "m", support, upper=ca.inf)

    def _keep_apart(self, k: int, m: int) -> None:
        """Two fingers keep their gap at the place of each element that is nearest to the other and the one next to it;
        the search says which these are.
        """
        finger, other = self.fingers[k], self.fingers[m]
        name, count, places = f"{finger.spec.name}, {other.spec.name}", finger.spec.elements, []
        for points, side in ((self.guarded(k), "first"), (self.guarded(m), "second")):
            chosen = self.numbers(f"{side} of {name}", points.shape[1] * count)
            places.append(points @ ca.reshape(chosen, points.shape[1], count))
        thick = sum(f.half_at(f.spec.elements - 1) * f.number("length") for f in (finger, other))
        # 1e-24 keeps the root differentiable where the fingers cross.
        away = ca.sqrt(ca.sum1((places[0] - places[1]) ** 2).T + 1e-24)
        spare = away - thick + self.numbers("tolerance")
        self.rows.require(f"overlap of fingers, {name}", spare, "m", "hand", upper=ca.inf)

    # -- object --------------------------------------------------------------------------------------------------

    def _balance_object(self) -> None:
        center = self.numbers("center of mass", 3)
        force, moment = self.numbers("weight", 3) * (1.0 - self.slack["mass"]), ca.SX(3, 1)
        for contact in self.contacts:
            force -= contact.world
            moment -= ca.cross(self.points[contact.spec.name] - center, contact.world)
        for carried in self.carried:
            force -= carried.world
            moment -= ca.cross(carried.point - center, carried.world)
        self.rows.require("object force balance", force, "N", "object.mass")
        self.rows.require("object moment balance", moment / self.numbers("size"), "moment per size", "object")

    def _steady(self) -> None:
        """The least eigenvalue of the second-order test, to first order about a point, is not below a level."""
        x = self.x.symbol
        value = ca.dot(self.numbers("stability slope", x.numel()), x) - self.numbers("stability level")
        self.rows.require("stability", value, "1", "stability", upper=ca.inf)

    def _objective(self) -> ca.SX:
        """Sum of the tensions, or the friction where that is given, and by how much limits are relaxed."""
        total = sum((f.number("tension weight") * ca.sum1(f.pulls) for f in self.fingers), ca.SX(0))
        if self.spec.gripped:
            pressing = [*(c.force for c in self.contacts), *(c.force for c in self.carried)]
            grip, reference = ca.vertcat(*(force[0] for force in pressing)), self.numbers("force reference")
            self.rows.require("grip", ca.sum1(grip) - self.numbers("grip"), "N", "contacts")
            across = ca.vertcat(*(force[1:] for force in pressing)) / reference
            return self.numbers("effort weight") * (ca.sumsqr(across) + GRIPPED * total)
        pressed = [c.force for c in self.contacts] + [c.force for c in self.carried]
        forces = ca.vertcat(*pressed) / self.numbers("force reference")
        weights = self.numbers("relaxation weights", len(RELAXED))
        relaxed = ca.vertcat(*(self.slack[name] for name in RELAXED))
        return self.numbers("effort weight") * (total + LITTLE * ca.sumsqr(forces)) + ca.dot(weights, relaxed)


@dataclass(frozen=True, eq=False)
class HandEquations:
    """A problem, and the functions that read its points: solvers and results need no expressions."""

    problem: HandProblem
    nlp: NLP
    touches: ca.Function
    """``(x, p)``: per contact point, normal, force (3,), place along its finger and shift; of palm and table zero."""
    fingers: ca.Function
    """``(x, p)``: per finger coordinates, lengths, curvature at the tip, pulls and base, as it stores them."""
    guarded: ca.Function
    """``(x, p)``: per finger its guarded places (3, K)."""
    free: tuple[list[int], ...]  # of these, per finger, the places that do not touch
    states: ca.Function
    """``(x, p)``: per finger the arguments of its shared functions."""
    grown: ca.Function
    """`grown` in numbers."""


@lru_cache(maxsize=16)
def hand_equations(spec: HandSpec) -> HandEquations:
    """The equations of a structure; built once in a process."""
    problem = HandProblem(spec)
    x, p = problem.x.symbol, problem.numbers.symbol
    touches, fingers, guarded, states = (list[ca.SX]() for _ in range(4))
    free = list[list[int]]()
    for contact in problem.contacts:
        finger = problem.fingers[contact.spec.finger]
        along = ca.SX(finger.edges[problem.end_of(contact.spec) + 1])
        touches += [
            problem.points[contact.spec.name],
            contact.normal,
            contact.world,
            along,
            problem.shift_of(contact.spec),
        ]
    for carried in problem.carried:
        touches += [carried.point, carried.normal, carried.world, ca.SX(0.0), ca.SX(0.0)]
    for k, finger in enumerate(problem.fingers):
        _, _, touching, _ = finger.guarded
        free.append([j for j, touches_there in enumerate(touching) if not touches_there])
        fingers += finger.stored()
        guarded.append(problem.guarded(k))
        states += [finger.q, finger.u, finger.p]
    named = {"touches": touches, "fingers": fingers, "guarded": guarded, "states": states}
    read = {name: ca.Function(name, [x, p], outputs) for name, outputs in named.items()}
    point, surface = ca.SX.sym("point", 3), ca.SX.sym("surface", SURFACE)
    read["grown"] = ca.Function("grown", [point, surface], list(grown(point, surface)))
    return HandEquations(problem, NLP("hand", x, problem.objective, problem.rows.g, p), free=tuple(free), **read)
