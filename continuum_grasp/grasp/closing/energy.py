"""Motion of fingers and object at given tensions: the least of an energy outside each other, with friction from before.

The energy is that of the fingers, less the work of their tendons, plus what friction takes; multipliers of the gaps are
the normal forces. Friction is that of Coulomb with the normal forces and the tangents of the pass before (M. Li et al.,
ACM Trans. Graph. 39(4), 2020, doi:10.1145/3386569.3392425, section 5), so that places stick or slide.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp import nlp
from continuum_grasp.arrays import Array
from continuum_grasp.grasp.problem.blocks import rotation
from continuum_grasp.grasp.shape import skin
from continuum_grasp.model import FingerModel
from continuum_grasp.model.planar import Vec
from continuum_grasp.model.surfaces import surface_of
from continuum_grasp.scene.finger import BasePose
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.grasp_options import PlanarGravity
from continuum_grasp.scene.parts import Part
from continuum_grasp.scene.supports import Wall

ELEMENTS, PER_ELEMENT = 8, 3
"""Elements of a finger on its way, and places per element that may touch: 24 along it, 4 % of its length apart."""
REACH = (0.1, 0.1, 0.3)
"""Greatest movement of the object in a step: per length of the longest finger, and its turn [rad]."""
FOOT = 2.0 / 3.0
"""Mean distance of a round foot's places from its center, per its radius: the arm of friction against turning on a
table (ellipsoid in place of the limit surface: R. D. Howe, M. R. Cutkosky, Int. J. Robot. Res. 15(6), 1996)."""


class ClosingFinger:
    """A finger on its way, as expressions of its coordinates, which are per its length."""

    def __init__(self, scene: GraspScene, setup: FingerSetup, base: Array) -> None:
        self.setup, self.name = setup, setup.name
        self.length = length = setup.finger.rod.length
        x, y, angle = base.tolist()
        planted = setup.finger.replaced(base=BasePose(position=(x, y), angle=angle), base_free=None)
        planted = planted.with_tendons(
            friction=0.0, conduit_bend=0.0, drive=None, axial_stiffness=None, series_stiffness=None
        )
        gravity = scene.gravity.vector if isinstance(scene.gravity, PlanarGravity) else (0.0, 0.0)
        self.model = model = FingerModel(planted, contacts=(), gravity=gravity, family="clothoid", elements=ELEMENTS)
        count = ELEMENTS * PER_ELEMENT
        self.stations = length * np.arange(1, count + 1) / count
        self.halves = skin(setup.finger.profile.half_thickness)(self.stations)
        idle, none = np.zeros(model.nu), ca.SX(0, 1)
        # Tendons do work that is linear in the coordinates.
        self.arms = np.array([np.array(model.actuation(np.zeros(model.n), e, [])).ravel() for e in np.eye(model.nu)])
        self.q = ca.SX.sym(f"{setup.name}.q", model.n)
        q = self.q / length
        self.potential = model.energy.call([ca.vertcat(q, ca.SX.zeros(model.nx - model.n)), idle, none])[1]
        at = [float(s) for s in self.stations]
        self.places = [model.position.call([q, idle, s, none])[0] for s in at]
        self.angles = [model.orientation.call([q, idle, s, none])[0] for s in at]

    def work(self, tensions: ca.SX) -> ca.SX:
        """Work of tensions [J]."""
        return ca.dot(ca.DM(self.arms).T @ tensions, self.q) / self.length

    def heights_needed(self, wall: Wall) -> Array:
        """Distances that places must keep from a half plane [m]: a finger comes out of one that its base is in."""
        height = float((np.asarray(self.model.finger.base.position) - wall.point) @ np.asarray(wall.normal))
        inner = (self.stations < self.setup.middle_bounds[0]) & (height < self.halves[0])
        return np.where(inner, min(height, 0.0), self.halves)

    def discs(self, index: int, friction: float | None = None) -> list[Disc]:
        """Discs that it may touch with, as the finger of an index; with its own friction where none is given."""
        friction = self.setup.friction if friction is None else friction
        halves = self.halves.tolist()
        return [
            Disc(place, angle, half, friction, index)
            for place, angle, half in zip(self.places, self.angles, halves, strict=True)
        ]


@dataclass(frozen=True)
class Disc:
    """A disc that may touch, at a place in the world whose skin turns with an angle."""

    place: ca.SX
    angle: ca.SX
    radius: float
    friction: float
    finger: int = -1  # -1: a support, which does not turn

    def beside(self, part: Part, pose: ca.SX | None) -> Pair:
        """The disc and a part of the object at a pose, or of the world."""
        turn, origin = (ca.SX.eye(2), ca.SX.zeros(2)) if pose is None else (rotation(pose[2]), pose[:2])
        local = turn.T @ (self.place - origin)
        near = surface_of(part).nearest(part, Vec(local[0], local[1]))
        normal, gap = turn @ near.normal.column(), ca.SX(near.distance) - self.radius
        at = self.place if pose is None else self.place - near.distance * normal
        return Pair(gap, normal, self, at, pose is not None)


@dataclass(frozen=True)
class Pair:
    """A place of a finger, or a support, against a part of the object or a support, as expressions in the world."""

    gap: ca.SX
    normal: ca.SX  # outward, of the object, or of the support where a finger meets one
    disc: Disc  # what touches; of a wall no more than its friction
    point: ca.SX  # of the object, world; of the place where a finger meets a support
    on_object: bool = True


class Closing:
    """The energy of fingers and object, whose least outside each other is the next step."""

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any], table_friction: float | None) -> None:
        self.scene = scene
        self.fingers = [ClosingFinger(self.scene, setup, arrays[f"{setup.name}.base"]) for setup in self.scene.setups]
        self.length = max(finger.length for finger in self.fingers)
        self.unit = max(finger.setup.stiffness / finger.length for finger in self.fingers)
        self.free = table_friction is not None
        self.scale = np.array([self.length, self.length, 1.0])
        self.grasped = np.asarray(arrays["object.pose"], dtype=float)
        self._build(table_friction or 0.0)

    def _build(self, table_friction: float) -> None:
        length, symbol = self.length, ca.SX.sym
        unknown = symbol("pose", 3)
        pose = unknown * ca.DM(self.scale)
        self.pairs = pairs = [*self._on_object(pose), *self._on_supports()]
        count = len(pairs)
        tensions = [symbol(f"{f.name}.tensions", f.model.nu) for f in self.fingers]
        energy = sum((f.potential - f.work(t) for f, t in zip(self.fingers, tensions, strict=True)), ca.SX(0))
        # Friction, given by the pass before: friction force, tangent, place in the object, and slip so far.
        force, past = symbol("force", count), symbol("past", count)
        tangent, at = symbol("tangent", 2, count), symbol("at", 2, count)
        slips = ca.vertcat(*(self._slip(pair, tangent[:, k], at[:, k], pose) for k, pair in enumerate(pairs)))
        share = symbol("stick")
        stick = share * length
        energy += ca.dot(force, ca.sqrt((slips - past) ** 2 + stick**2) - stick)
        last = symbol("last", 3)
        if self.free:
            arm = 0.5 * FOOT * self.scene.object.size
            center = self._center(pose) - self._center(last)
            slide = ca.sqrt(ca.sumsqr(center) + (arm * (pose[2] - last[2])) ** 2 + stick**2) - stick
            energy += table_friction * self.scene.weight * slide
        q = ca.vertcat(*(f.q for f in self.fingers))
        given = [*tensions, force, ca.vec(tangent), ca.vec(at), past, share, last, *([] if self.free else [unknown])]
        gaps = ca.vertcat(*(pair.gap for pair in pairs))
        x = ca.vertcat(q, unknown) if self.free else q
        self.problem = nlp.NLP("closing", x, energy / self.unit, gaps / length, ca.vertcat(*given))
        self.solver = nlp.new_solver(nlp.Settings())
        columns = [ca.horzcat(*(getattr(pair, name) for pair in pairs)) for name in ("normal", "point")]
        lines = ca.horzcat(*(place for f in self.fingers for place in f.places))
        self.look = ca.Function("look", [q, unknown], [gaps, *columns, lines])
        self.slips = ca.Function("slips", [q, unknown, tangent, at], [slips])

    def _center(self, pose: ca.SX) -> ca.SX:
        return pose[:2] + rotation(pose[2]) @ ca.DM(self.scene.object.com)

    @staticmethod
    def _slip(pair: Pair, tangent: ca.SX, at: ca.SX, pose: ca.SX) -> ca.SX:
        """Position of the skin along a tangent, relative to the object's."""
        other = pose[:2] + rotation(pose[2]) @ at if pair.on_object else ca.SX.zeros(2)
        return ca.dot(tangent, pair.disc.place - other) - pair.disc.radius * pair.disc.angle

    def _on_object(self, pose: ca.SX) -> list[Pair]:
        """Fingers against the object, and the object, where it is free, against the supports."""
        discs = [disc for k, finger in enumerate(self.fingers) for disc in finger.discs(k)]
        if self.free:
            discs += [
                Disc(ca.SX(peg.position), ca.SX(0), peg.radius, self.scene.friction(peg.name))
                for peg in self.scene.pegs
            ]
        found = [disc.beside(part, pose) for disc in discs for part in self.scene.object.parts]
        turn = rotation(pose[2])
        for wall in self.scene.walls if self.free else ():
            down, still = -ca.DM(wall.normal), Disc(ca.SX.zeros(2), ca.SX(0), 0.0, self.scene.friction(wall.name))
            direction = turn.T @ down
            for part in self.scene.object.parts:
                for lowest in surface_of(part).lowest_points(part, Vec(direction[0], direction[1])):
                    point = pose[:2] + turn @ lowest.column()
                    gap = -ca.dot(down, point - ca.DM(wall.point))
                    found.append(Pair(gap, ca.SX(down), still, point))
        return found

    def _on_supports(self) -> list[Pair]:
        """Fingers against walls and pegs."""
        found = []
        for k, finger in enumerate(self.fingers):
            for support in self.scene.places:
                discs = finger.discs(k, self.scene.friction(support.name))
                if support.part is not None:
                    found += [disc.beside(support.part, None) for disc in discs]
                elif isinstance(support, Wall):
                    normal = ca.SX(ca.DM(support.normal))
                    for disc, need in zip(discs, finger.heights_needed(support), strict=True):
                        height = ca.dot(normal, disc.place - ca.DM(support.point))
                        found.append(Pair(height - float(need), normal, disc, disc.place, on_object=False))
        return found

    # -- steps

    def found(self, x: Array, pose: Array) -> Sight:
        """State at a point."""
        q, unknown = (x[:-3], x[-3:]) if self.free else (x, pose / self.scale)
        gaps, normals, points, lines = (np.array(v) for v in self.look(q, unknown))
        return Sight(q, gaps.ravel(), normals, points, lines, unknown * self.scale)

    def sliding(self, sight: Sight, pressed: Array, stick: float) -> Sliding:
        """Friction from what presses at a point."""
        tangents = np.stack([-sight.normals[1], sight.normals[0]])
        turn = turned(sight.pose[2])
        at = turn.T @ (sight.points - sight.pose[:2, None])
        past = self.slip(sight, tangents, at)
        friction = np.array([pair.disc.friction for pair in self.pairs])
        return Sliding(friction * pressed, tangents, at, past, stick)

    def slip(self, sight: Sight, tangents: Array, at: Array) -> Array:
        """Positions (M,) of skins along tangents, relative to places of the object (2, M) [m]."""
        return np.array(self.slips(sight.q, sight.pose / self.scale, tangents, at)).ravel()

    def solve(
        self, tensions: Array, sliding: Sliding, last: Array, start: Array, near: nlp.Multipliers | None, open_: bool
    ) -> nlp.Attempt:
        """The least energy at tensions (all fingers' in a row), next to a start; ``open_``: through everything."""
        m = len(self.pairs)
        low, high = np.full(m, -np.inf if open_ else 0.0), np.full(m, np.inf)
        # Within a step fingers bend by less than a radian and the object moves little: what is farther is not next.
        reach = np.full(len(start), np.inf if open_ else 1.0)
        if self.free:
            reach[-3:] = REACH
        given = np.concatenate([tensions, *sliding.packed, last, *([] if self.free else [last / self.scale])])
        known = nlp.Start(start, start - reach, start + reach, low, high, given, near)
        attempt = self.solver.solve(self.problem, known, nlp.Budget())
        if near is not None and not attempt.converged:
            attempt = self.solver.solve(self.problem, replace(known, multipliers=None), nlp.Budget())
        return attempt

    def pressed(self, attempt: nlp.Attempt) -> Array:
        """Normal forces of all pairs [N]."""
        return np.maximum(-attempt.multipliers.constraints, 0.0) * self.unit / self.length


def turned(angle: float) -> Array:
    """Rotation matrix (2, 2)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


@dataclass(frozen=True)
class Sliding:
    """Friction of M pairs: greatest forces (M,) [N], tangents and places in the object (2, M), slips (M,) [m], and the
    slip of a step up to which it is not full, per length.
    """

    forces: Array
    tangents: Array
    at: Array
    past: Array
    stick: float

    @property
    def packed(self) -> list[Array]:
        """As the problem takes it."""
        return [self.forces, self.tangents.ravel("F"), self.at.ravel("F"), self.past, np.array([self.stick])]


@dataclass(frozen=True)
class Sight:
    """Coordinates of the fingers, gaps (M,) [m], normals and points (2, M) of the pairs, the places of all fingers
    (2, S) [m] and the object's pose.
    """

    q: Array
    gaps: Array
    normals: Array
    points: Array
    lines: Array
    pose: Array
