"""Tensions and contact forces that go best with a posture of each finger.

In a posture that stays, the equilibrium of a finger along its length and the balance of the object are linear in the
tensions and in the forces of the contacts. Forces are per the greatest E I / L^2 of the fingers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.starts import FingerPlane, TouchingPosture
from continuum_grasp.grasp.quality.conic import Cones, solve_conic
from continuum_grasp.grasp.rods.geometry import cross, exerted
from continuum_grasp.scene import FingerSetup, HandScene

PRESSED = 1e-2
"""Least normal force of a contact of a finger, per weight: where it presses nothing, its normal does not matter."""
LIGHT = 0.1
"""Weight of the object that counts at least for that, per unit of force."""
_PANELS = 64
"""Panels of a finger along which its equilibrium is integrated."""
BENT = 0.3
"""Weight of moments that a posture needs, beside forces out of balance [1]: postures are no equilibria, objects must be
held."""
_UNIQUE = 1e-6
"""Weight of the squares of all forces beside those of the residual, so that forces are unique."""


@dataclass(frozen=True)
class TouchForce:
    """Limits of the force of a contact; its columns are normal force, both directions of friction, and the moment about
    the normal per arm where contacts bear one.
    """

    name: str
    friction: float  # less the reserve
    greatest: float  # normal force
    least: float
    size: int  # columns


@dataclass(frozen=True)
class PostureRows:
    """Rows of one finger in a posture, or of the supports alone: linear in its tensions, then in its contacts' forces.

    ``own`` (R, n) and ``offset`` (R,) are its equilibrium, ``wrench`` (6, n) forces and moments, per size of the
    object, on the object.
    """

    own: Array
    offset: Array
    wrench: Array
    bounds: tuple[Array, Array]  # of the tensions
    touches: tuple[TouchForce, ...]


class HandForces:
    """Rows of the fingers of a scene, and the forces that leave least of them."""

    def __init__(self, scene: HandScene) -> None:
        self.scene = scene
        self.unit = max(setup.stiffness / setup.finger.rod.length**2 for setup in scene.setups)
        self._center = np.asarray(scene.object.com, dtype=float)
        self._size = scene.object.size
        self._length = max(setup.finger.rod.length for setup in scene.setups)

    def finger(self, plane: FingerPlane, posture: TouchingPosture, on: frozenset[str]) -> PostureRows:
        """Rows of a finger in a posture with the contacts ``on`` by name."""
        setup, frame = plane.setup, plane.frame
        s = np.union1d(np.linspace(0.0, 1.0, _PANELS + 1), posture.joint)
        step = np.diff(s)
        middle = 0.5 * (s[1:] + s[:-1])
        curvature = np.interp(middle, *plane.knots(posture))
        angle = np.cumsum(curvature * step) - 0.5 * curvature * step
        moves = np.stack([-np.sin(angle), np.cos(angle)], axis=1) * step[:, None]
        line = plane.length * np.concatenate([np.zeros((1, 2)), np.cumsum(moves, axis=0)])
        at = 0.5 * (line[1:] + line[:-1])  # of the middles
        columns, offset = self._bent(plane, middle, curvature, at, step)
        wrenches, touches = [np.zeros((6, columns.shape[1]))], []
        moment = setup.stiffness / plane.length
        places = ((setup.middle_names[0], posture.joint), (setup.tip_name, 1.0))
        for name, place in ((name, place) for name, place in places if name in on):
            point = frame.world(np.append([np.interp(place, s, one) for one in line.T], 0.0))
            normal = np.asarray(plane.normal(point))
            skin = point - plane.length * float(plane.half(place)) * normal
            touch = self._touch(setup, name)
            forces, couples = self._columns(touch, normal, frame.axes[:, 2], setup)
            flat = forces @ frame.axes[:, :2]
            lever = (skin - frame.base) @ frame.axes[:, :2] - at[:, None]
            bending = lever[..., 0] * flat[:, 1] - lever[..., 1] * flat[:, 0] + couples @ frame.axes[:, 2]
            columns = np.column_stack([columns, np.where(middle[:, None] < place, bending, 0.0) / moment])
            wrenches.append(-self._wrench(skin, forces, couples))
            touches.append(touch)
        weights = BENT * np.sqrt(step) * moment / self.unit / self._length
        return PostureRows(
            columns * weights[:, None], offset * weights, np.hstack(wrenches), finger_bounds(setup), tuple(touches)
        )

    def _bent(self, plane: FingerPlane, s: Array, curvature: Array, at: Array, step: Array) -> tuple[Array, Array]:
        """Moments by each tendon (N, 2), and moments of weight less those that bend the finger (N,) [E I / L]."""
        section: Any = plane.setup.finger
        length, stiffness = plane.length, plane.setup.stiffness
        profile = section.profile
        where = s * length
        bent = profile.bending_stiffness(where) / stiffness * (curvature - length * profile.rest_curvature(where))
        pulls = np.zeros((len(s), 2))
        for channel in section.channels:
            pulls += np.outer(channel.shape(where), np.array(channel.arms) / plane.setup.tendons.offset)
        gravity = np.asarray(self.scene.acceleration) @ plane.frame.axes[:, :2]
        masses = profile.linear_density(where) * length * step
        points = [(masses, at), *((np.array([mass.mass]), _point(mass.at / length, s, at)) for mass in section.masses)]
        weight = np.zeros(len(s))
        places = [s, *(np.array([mass.at / length]) for mass in section.masses)]
        for (mass, point), place in zip(points, places, strict=True):
            lever = point[None] - at[:, None]
            turned = (lever[..., 0] * gravity[1] - lever[..., 1] * gravity[0]) * mass
            weight += np.where(place[None] > s[:, None], turned, 0.0).sum(axis=1)
        return pulls, weight * length / stiffness - bent

    def _touch(self, setup: FingerSetup, name: str) -> TouchForce:
        """Limits of a contact of a finger."""
        contacts = self.scene.contacts
        size = 4 if contacts.torsional_friction > 0.0 else 3
        least = PRESSED * max(self.scene.weight / self.unit, LIGHT)
        return TouchForce(name, setup.held_friction, setup.normal_force_max / self.unit, least, size)

    def _columns(self, touch: TouchForce, normal: Array, across: Array, setup: FingerSetup) -> tuple[Array, Array]:
        """Force and moment (size, 3) [N, N m] by each column of a contact on what touches the object."""
        forces, couples = np.zeros((touch.size, 3)), np.zeros((touch.size, 3))
        for k, held in enumerate(np.eye(3)):
            forces[k] = exerted(held.tolist(), normal.tolist(), across.tolist())
        if touch.size == 4:
            couples[3] = self.scene.contacts.torsional_friction / setup.friction * normal
        return self.unit * forces, self.unit * couples

    def _wrench(self, point: Array, forces: Array, couples: Array) -> Array:
        """Forces and moments (6, n) about the center of mass, per unit."""
        arm = (point - self._center).tolist()
        moments = np.array([cross(arm, force.tolist()) for force in forces]) + couples
        return np.vstack([forces.T, moments.T / self._size]) / self.unit

    @property
    def supports(self) -> PostureRows:
        """Rows of palm and table."""
        touches, wrenches = list[TouchForce](), [np.zeros((6, 0))]
        for contact in self.scene.support_contacts:
            normal = -np.array(contact.support.normal)
            across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
            friction = contact.support.friction * (1.0 - self.scene.contacts.reserve)
            most = self.scene.contacts.normal_force_max / self.unit
            touches.append(TouchForce(contact.name, friction, most, 0.0, 3))
            directions = [exerted(held, normal.tolist(), across.tolist()) for held in np.eye(3).tolist()]
            forces = self.unit * np.array(directions)
            wrenches.append(-self._wrench(np.array(contact.position), forces, np.zeros((3, 3))))
        none = np.zeros((0, sum(touch.size for touch in touches)))
        return PostureRows(none, np.zeros(0), np.hstack(wrenches), (np.zeros(0), np.zeros(0)), tuple(touches))

    def best(self, rows: Sequence[PostureRows]) -> tuple[float, Array]:
        """Residual of the rows of all fingers and supports with the tensions and forces within their limits that leave
        the least, and these (n,); infinite where the conic problem has no solution.
        """
        weight = np.zeros(6)
        weight[:3] = self.scene.object.weighed * np.array(self.scene.acceleration) / self.unit
        sizes = [part.wrench.shape[1] for part in rows]
        at = np.cumsum([0, *sizes])
        own = np.zeros((sum(len(part.offset) for part in rows), at[-1]))
        first = 0
        for part, begin, end in zip(rows, at[:-1], at[1:], strict=True):
            own[first : first + len(part.offset), begin:end] = part.own
            first += len(part.offset)
        matrix = np.vstack([own, np.hstack([part.wrench for part in rows])])
        offset = np.concatenate([*(part.offset for part in rows), weight])
        return self._least(rows, at, matrix, offset)

    @staticmethod
    def _least(rows: Sequence[PostureRows], at: Array, matrix: Array, offset: Array) -> tuple[float, Array]:
        # Unknowns are tensions and forces, then what they leave of each row.
        sought, size = matrix.shape[1], matrix.shape[1] + len(offset)
        low, high = np.full(size, -np.inf), np.full(size, np.inf)
        count = sum(len(part.touches) for part in rows)
        across, width = np.zeros((count, 3, size)), np.zeros((count, size))
        cone = 0
        for part, begin in zip(rows, at[:-1].tolist(), strict=True):
            column = begin + len(part.bounds[0])
            low[begin:column], high[begin:column] = part.bounds
            for touch in part.touches:
                low[column], high[column], width[cone, column] = touch.least, touch.greatest, touch.friction
                across[cone, range(touch.size - 1), range(column + 1, column + touch.size)] = 1.0
                column, cone = column + touch.size, cone + 1
        cones = Cones(across, np.zeros((count, 3)), width, np.zeros(count))
        squares = np.concatenate([np.full(sought, _UNIQUE), np.ones(len(offset))])
        wholes = np.hstack([matrix, -np.eye(len(offset))])
        found = solve_conic(np.zeros(size), wholes, -offset, -offset, low, high, cones, squares)
        if not found.optimal:
            return np.inf, np.zeros(sought)
        return float(np.linalg.norm(found.x[sought:])), found.x[:sought]

    def named(self, rows: Sequence[PostureRows], x: Array) -> tuple[list[Array], dict[str, Array]]:
        """Pulls (2,) [E I / L] of each finger, and force (N, f, g) with the moment per arm [N] of each contact by name,
        by the columns of all rows.
        """
        pulls, forces, first = [], dict[str, Array](), 0
        for part in rows:
            count = len(part.bounds[0])
            pulls += [x[first : first + count]] if count else []
            first += count
            for touch in part.touches:
                forces[touch.name] = np.zeros(4)
                forces[touch.name][: touch.size] = self.unit * x[first : first + touch.size]
                first += touch.size
        return pulls, forces


def finger_bounds(setup: FingerSetup) -> tuple[Array, Array]:
    """Least and greatest pulls of both tendons, as moments per E I / L."""
    moment = setup.stiffness / setup.finger.rod.length
    least, most = (t * setup.tendons.offset / moment for t in (setup.tendons.min_tension, setup.max_tension))
    used = setup.finger.tendons_used
    return np.full(2, least), np.array([most if used in ("both", side) else 0.0 for side in ("left", "right")])


def _point(place: float, s: Array, at: Array) -> Array:
    """Point (1, 2) at a place of a line."""
    return np.array([[np.interp(place, s, one) for one in at.T]])
