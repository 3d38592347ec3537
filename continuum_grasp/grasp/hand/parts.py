"""The parts of the problem of a hand: a finger with its contacts, two fingers that may cross, the object.

Units of the problem: length of the longest finger, greatest E I / L^2 of the fingers as force, radians. Each finger is
the planar one of `continuum_grasp.grasp.problem.unit_finger`, in a plane with axes x, y and normal z. At a contact the
backbone p of a round finger of half thickness h, displaced by w out of its plane to p + w z, is as far from the object;
n is the gradient of its distance d there, x = p + w z - h n the point touched:

    contact    d(p + w z) = h,  n . (t + w' z) = h' (middle)
    finger     its planar equilibrium under the part of f = N n + f1 a + f2 b in the plane, and the couple
               z . ((x - p) x f); a = z x n / |z x n|, b = n x a
    to the side  w and w' by bending E I_l and torsion G J under f and its couples (`continuum_grasp.grasp.hand.lean`)
    object     m g - sum f = 0,  moments about the center of mass = 0, with the forces on palm and table, whose contacts
               are at given points

Where h is constant, n . t = 0 with a gap of h says that the line touches the section of the grown object.
The object has no shape here: for each contact and place that stays clear, numbers are a cubic that stands for the
surface d = h near by. The search moves them until they are where contacts and places are; there they are exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca

from continuum_grasp.grasp.hand.lean import EndLoad, Lean
from continuum_grasp.grasp.problem.limits import keep_limits
from continuum_grasp.grasp.problem.parts import ProblemPart
from continuum_grasp.grasp.problem.structure import FingerSpec
from continuum_grasp.grasp.problem.unit_finger import UnitFinger

RELAXED = ("tension", "friction", "normal force", "mass")
"""Limits of a hand that may be relaxed."""
SURFACE = 45
"""Numbers of a surface near a place."""
GRIPPED = 1e-3
"""Weight of the tensions beside squared friction, so that tendons do not pull against each other."""
LITTLE = 1e-8
"""Weight of the squared contact forces, so that they are unique where equilibrium does not fix them."""


def grown(point: ca.SX, surface: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Distance of a point beyond a surface near by, to first order, and the gradient of that.

    The surface is a place of it (3,), the normal there (3,) and the slope of the distance (3,), which is another one on
    triangles that stand for a curved surface, and second and third derivatives (9,) and (27,).
    """
    near, outward, slope, bending, changing = ca.vertsplit(surface, [0, 3, 6, 9, 18, SURFACE])
    away = point - near
    curved = bending.reshape((3, 3))
    turning = (changing.reshape((9, 3)) @ away).reshape((3, 3))
    return ca.dot(slope + (curved / 2.0 + turning / 6.0) @ away, away), outward + (curved + turning / 2.0) @ away


@dataclass(frozen=True)
class Aims:
    """Aims that change all parts."""

    gripped: bool = False  # whether the sum of normal forces is given, and friction the least
    steadied: bool = False  # whether there is a bound on what the least eigenvalue is to first order


PLAIN = Aims()
"""The least sum of tensions, no more."""


class HandPart(ProblemPart):
    """A part of the problem of a hand."""

    def __init__(self, aims: Aims) -> None:
        super().__init__(RELAXED)
        self.aims = aims

    def arm(self, point: ca.SX) -> ca.SX:
        """A point (3,) from the object's center of mass."""
        return point - self.numbers("center of mass", 3)

    def _aim(self, forces: list[ca.SX], tension: ca.SX, grip: ca.SX, level: ca.SX) -> None:
        """Objective, and bounded terms of the sum of normal forces and of stability; last of all unknowns."""
        weight, reference = self.numbers("effort weight"), self.numbers("force reference")
        if self.aims.steadied:
            self.steady(level)
        if self.aims.gripped:
            pressed = sum((force[0] for force in forces), ca.SX(0))
            self.rows.require("grip", pressed - grip, "N", "contacts")
            across = ca.vertcat(*(force[1:] for force in forces)) / reference
            self.objective += weight * (ca.sumsqr(across) + GRIPPED * tension)
            return
        self.objective += weight * (tension + LITTLE * ca.sumsqr(ca.vertcat(*forces) / reference))


class ObjectPart(HandPart):
    """The object, and what palm and table carry of it."""

    def __init__(self, carried: tuple[str, ...], aims: Aims) -> None:
        super().__init__(aims)
        forces = list[ca.SX]()
        points = list[ca.SX]()
        loads = list[ca.SX]()
        for name in carried:
            force = self.x(f"force, {name}", 3)
            forces.append(force)
            points.append(self.numbers(f"{name}.point", 3))
            loads.append(self._axes(name) @ force)
            # Friction of a palm or table of its own is not relaxed.
            more = self.numbers(f"{name}.as elsewhere") * self.slack["friction"]
            self.bound(name, force, self.numbers(f"{name}.friction") + more)
        weight = self.numbers("weight", 3) * (1.0 - self.slack["mass"])
        none = ca.SX(3, 1)
        self.balance(weight, none, [(self.arm(point), load, none) for point, load in zip(points, loads, strict=True)])
        grip = self.numbers("grip") if aims.gripped else ca.SX(0)
        self._aim(forces, ca.SX(0), grip, self.numbers("stability level") if aims.steadied else ca.SX(0))
        if not aims.gripped:
            relaxed = ca.vertcat(*(self.slack[name] for name in RELAXED))
            self.objective += ca.dot(self.numbers("relaxation weights", len(RELAXED)), relaxed)
        # Of each contact with palm or table point, normal and force on them (3,).
        normals = [self._axes(name)[:, 0] for name in carried]
        touches = zip(points, normals, loads, strict=True)
        self.touched = self.read(*(value for touch in touches for value in touch))

    def _axes(self, name: str) -> ca.SX:
        """Normal of a contact with palm or table, outward of the object, and two directions across."""
        return self.numbers(f"{name}.axes", 9).reshape((3, 3))


@dataclass(frozen=True)
class SpatialTouch:
    """A contact's unknowns and what follows from them, as the hand sees them."""

    name: str
    joint: int  # 0 for the middle contact, -1 for the tip
    end: int  # index of the element at whose end it sits
    backbone: ca.SX  # (3,) point of the finger's line
    beyond: ca.SX  # the surface a half thickness from the object, to first order the distance of that point
    normal: ca.SX  # (3,) outward, of the object
    sine: ca.SX  # of the angle between the normal and the normal of the finger's plane
    force: ca.SX  # (3,) N and friction: along a, in the plane across the normal, and along b = n x a
    world: ca.SX  # (3,) force on the finger
    torsion: ca.SX  # moment about the normal on the finger per arm, as a force; none of a point
    moment: ca.SX  # (3,) that as a moment on the finger

    @property
    def across(self) -> ca.SX:
        """Force (3,), and what torsional friction takes of the cone."""
        return ca.vertcat(self.force, self.torsion)


class PlacedFinger:
    """A finger in its plane and displaced to the side, within a part; contacts are ``soft`` where they bear moments
    about their normals.
    """

    def __init__(self, part: HandPart, spec: FingerSpec, soft: bool) -> None:
        self._part = part
        self._soft = soft
        self.spec = spec
        self.name = spec.name
        self.axes = part.numbers(f"{spec.name}.axes", 9).reshape((3, 3))
        joints = {"middle": 0} if spec.touching[0] else {}
        joints |= {"tip": -1} if spec.tip else {}
        self.touches = [self._touch(f"{spec.name}.{place}", joint) for place, joint in joints.items()]
        tip = ca.SX(3, 1)
        twist = None
        for touch in self.touches:
            if touch.joint == -1:
                # In the plane, friction along a has all of its couple about z but for the lean of the normal.
                tip = ca.vertcat(touch.force[0], touch.force[1] * touch.sine, 0.0)
                twist = ca.dot(self.axes[:, 2], touch.moment) if soft else None
        self.finger = UnitFinger(spec, part.x, part.numbers, tip, twist)
        self.lean = Lean(self.finger, part.x)

    def _touch(self, name: str, joint: int) -> SpatialTouch:
        number = self._part.numbers
        axes = self.axes
        end = self.spec.elements - 1 if joint < 0 else self.spec.before[0] - 1
        backbone = self._part.x(f"place, {name}", 3)
        beyond, gradient = grown(backbone, number(f"{name}.surface", SURFACE))
        normal = gradient / ca.sqrt(ca.sumsqr(gradient))
        across = ca.cross(axes[:, 2], normal)
        sine = ca.sqrt(ca.sumsqr(across))
        a = across / sine
        force = self._part.x(f"force, {name}", 3)
        world = force[0] * normal + force[1] * a + force[2] * ca.cross(normal, a)
        torsion = ca.SX(0, 1)
        moment = ca.SX(3, 1)
        if self._soft:
            torsion = self._part.x(f"torsion, {name}")
            # Friction that is relaxed bears no more of it.
            friction = number(f"{name}.friction")
            arm = number(f"{name}.torsional arm") * friction / (friction + self._part.slack["friction"])
            moment = arm * torsion * normal
        return SpatialTouch(name, joint, end, backbone, beyond, normal, sine, force, world, torsion, moment)

    def in_space(self, points: ca.SX) -> ca.SX:
        """Points (3, K) of places in the finger's plane (2, K)."""
        base = self._part.numbers(f"{self.name}.position", 3)
        return ca.repmat(base, 1, points.shape[1]) + self.axes[:, :2] @ points

    def shift(self, end: int) -> ca.SX:
        """Shift of the end of an element out of the plane."""
        return self.finger.number("length") * self.lean.shift(end)

    @cached_property
    def guarded(self) -> ca.SX:
        """Places (3, K) that must stay clear, displaced by cubics between the ends of the elements."""
        finger = self.finger
        lean = self.lean
        aside = list[ca.SX]()
        points, owners, _, _ = finger.guarded
        for element, share in zip(owners, finger.guarded_shares, strict=True):
            first = lean.shift(element - 1)
            last = lean.shift(element)
            behind = share**2 * (3.0 - 2.0 * share)
            ahead = share * (1.0 - share)
            bent = lean.slope(element - 1) * (1.0 - share) - lean.slope(element) * share
            aside.append(first + (last - first) * behind + finger.lengths[element] * ahead * bent)
        return self.in_space(points) + self.axes[:, 2] @ (finger.number("length") * ca.horzcat(*aside))


class FingerPart(HandPart):
    """A finger and its contacts."""

    name = "{0}."

    def __init__(self, spec: FingerSpec, planes: tuple[str, ...], soft: bool, aims: Aims) -> None:
        super().__init__(aims)
        self.placed = PlacedFinger(self, spec, soft)
        self.spec = spec
        self.finger = self.placed.finger
        self.touches = self.placed.touches
        self._rest()
        for touch in self.touches:
            self._close(touch)
        self._keep_clear(planes)
        keep_limits(self, self.finger)
        for touch in self.touches:
            friction = self.numbers(f"{touch.name}.friction") + self.slack["friction"]
            self.bound(touch.name, touch.across, friction)
        loads = [(self.arm(self._point(touch)), touch.world, touch.moment) for touch in self.touches]
        self.balance(ca.SX(3, 1), ca.SX(3, 1), loads)
        tension = self.finger.number("tension weight") * ca.sum1(self.finger.pulls)
        self._aim([touch.across for touch in self.touches], tension, ca.SX(0), ca.SX(0))

    def _rest(self) -> None:
        """Equilibrium in the plane and to the side."""
        finger = self.finger
        axes = self.placed.axes
        require = self.rows.require
        share = finger.number("force share")
        length = finger.number("length")
        name = finger.spec.name
        forces = dict[int, ca.SX]()
        couples = dict[int, ca.SX]()
        loads = list[EndLoad]()
        for touch in self.touches:
            force = axes.T @ touch.world / share
            half = finger.half_at(touch.end)
            moment = axes.T @ touch.moment / (share * length)
            forces[touch.joint] = force[:2]
            couples[touch.joint] = -half * touch.force[1] * touch.sine / share + moment[2]
            loads.append(EndLoad(touch.end, force, moment - half * ca.cross(axes.T @ touch.normal, force)))
        missing = finger.missing_force(finger.q, finger.u, finger.loads(forces, couples))
        require(f"finger equilibrium, {name}", share * length * missing, "N m", name)
        if finger.spec.drive is not None:
            require(f"drive, {name}", length * finger.drive_rows(), "m", f"{name}.tendons.drive")
        turns, shifts = self.placed.lean.rows(loads)
        require(f"turns to the side, {name}", turns, "rad", name)
        require(f"shifts to the side, {name}", length * shifts, "m", name)

    def _thick(self, touch: SpatialTouch) -> ca.SX:
        return self.finger.half_at(touch.end) * self.finger.number("length")

    def _point(self, touch: SpatialTouch) -> ca.SX:
        """Point of the object (3,) that is touched."""
        return touch.backbone - self._thick(touch) * touch.normal

    def _close(self, touch: SpatialTouch) -> None:
        """The finger touches: no gap, and along the finger it is tangent."""
        finger = self.finger
        axes = self.placed.axes
        name = touch.name
        require = self.rows.require
        place = self.placed.in_space(finger.ends[:, touch.end]) + axes[:, 2] * self.placed.shift(touch.end)
        require(f"contact place, {name}", place - touch.backbone, "m", f"contacts.{name}")
        require(f"contact gap, {name}", touch.beyond, "m", f"contacts.{name}")
        angle = finger.angles[touch.end]
        along = ca.vertcat(-ca.sin(angle), ca.cos(angle))
        tilt = ca.dot(axes[:, :2] @ along + self.placed.lean.slope(touch.end) * axes[:, 2], touch.normal)
        tilt -= finger.slope_at(touch.end)
        if touch.joint == 0:
            require(f"contact tangency, {name}", tilt, "rad", f"contacts.{name}")
        else:
            spare = ca.sqrt(self.numbers("tolerance")) - tilt
            require(f"contact direction, {name}", spare, "rad", f"contacts.{name}", upper=ca.inf)

    @cached_property
    def free(self) -> list[int]:
        """Guarded places that do not touch, by index."""
        return [j for j, touching in enumerate(self.finger.guarded[2]) if not touching]

    @property
    def owners(self) -> list[int]:
        """Elements that the guarded places are on."""
        return self.finger.guarded[1]

    def _keep_clear(self, planes: tuple[str, ...]) -> None:
        """Guarded places keep clear of the object as it is near them, and of palm and table."""
        finger = self.finger
        points = self.placed.guarded
        require = self.rows.require
        thick = finger.guarded[3]
        name = finger.spec.name
        near = finger.number("surfaces", SURFACE * len(self.free)).reshape((SURFACE, len(self.free)))
        beyond = [grown(points[:, j], near[:, k])[0] for k, j in enumerate(self.free)]
        spare = ca.vertcat(*beyond) + finger.number("tolerance")
        require(f"penetration into the object, {name}", spare, "m", "object", upper=ca.inf)
        for support in planes:
            plane = self.numbers(f"{support}.plane", 4)
            there = finger.number(f"clear of {support}", points.shape[1])
            heights = points.T @ plane[:3] - plane[3]
            spare = there * (heights - thick) + finger.number("tolerance")
            require(f"penetration into the {support}, {name}", spare, "m", support, upper=ca.inf)

    # -- functions that read a point -----------------------------------------------------------------------------

    @cached_property
    def guards(self) -> ca.Function:
        """Guarded places (3, K) and half the finger's thickness there (K,)."""
        return self.read(self.placed.guarded, self.finger.guarded[3])

    @cached_property
    def halves(self) -> ca.Function:
        """Half the finger's thickness at each contact."""
        return self.read(ca.vertcat(*(self._thick(touch) for touch in self.touches)))

    @cached_property
    def stored(self) -> ca.Function:
        """Coordinates, lengths, curvature at the tip, pulls and base, as a result stores them."""
        return self.read(*self.finger.stored())

    @cached_property
    def state(self) -> ca.Function:
        """Arguments of the functions that the finger shares with others."""
        return self.read(self.finger.q, self.finger.u, self.finger.p)

    @cached_property
    def touched(self) -> ca.Function:
        """Per contact point, normal and force on the finger (3,), place along it, shift and moment about the normal."""
        values = list[ca.SX]()
        for touch in self.touches:
            along = ca.SX(self.finger.edges[touch.end + 1])
            values += [self._point(touch), touch.normal, touch.world, along, self.placed.shift(touch.end)]
            values.append(ca.dot(touch.normal, touch.moment))
        return self.read(*values)


class PairPart(HandPart):
    """Two fingers that keep their gap at the place of each element of the first that is nearest to the other and the
    one next to it; the search says which these are.
    """

    def __init__(self, first: FingerSpec, second: FingerSpec, soft: bool) -> None:
        super().__init__(PLAIN)
        pair = [PlacedFinger(self, first, soft), PlacedFinger(self, second, soft)]
        name, count = f"{first.name}, {second.name}", first.elements
        places = list[ca.SX]()
        thick = ca.SX(0)
        for placed, side in zip(pair, ("first", "second"), strict=True):
            finger, points = placed.finger, placed.guarded
            chosen = ca.reshape(self.numbers(f"{side} of {name}", points.shape[1] * count), points.shape[1], count)
            places.append(points @ chosen)
            even = finger.half_at(placed.spec.elements - 1) * finger.number("length")
            thick += chosen.T @ finger.guarded[3] if placed.spec.tapered else even
        # 1e-24 keeps the root differentiable where the fingers cross.
        away = ca.sqrt(ca.sum1((places[0] - places[1]) ** 2).T + 1e-24)
        spare = away - thick + self.numbers("tolerance")
        self.rows.require(f"overlap of fingers, {name}", spare, "m", "hand", upper=ca.inf)


finger_part = lru_cache(maxsize=24)(FingerPart)
"""The part of a finger; built once in a process."""
pair_part = lru_cache(maxsize=16)(PairPart)
object_part = lru_cache(maxsize=24)(ObjectPart)
