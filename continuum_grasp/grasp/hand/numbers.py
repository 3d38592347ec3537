"""Run-time numbers of the problem of a hand, and the forces that go with a posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.body import BodySurface
from continuum_grasp.grasp.hand.frames import PlaneFrame
from continuum_grasp.grasp.hand.parts import RELAXED
from continuum_grasp.grasp.hand.problem import HandProblem
from continuum_grasp.grasp.hand.starts import TouchingPosture
from continuum_grasp.grasp.problem.values import APEX, Units, Values, finger_values
from continuum_grasp.grasp.quality.conic import Cones, solve_conic
from continuum_grasp.grasp.starts.values import FingerStart, GraspStart
from continuum_grasp.scene import FingerSetup, HandScene

STENCIL = 1e-3
"""Distance of points between which curvatures of an object are compared, per half thickness of the finger."""
JUMP = 3.0
"""Change of the curvature per length and curvature squared above which it jumps, as at the rim of a face."""
PRESSED = 1e-2
"""Least normal force of a finger's contact, per weight: of starts, and of grasps where palm or table carries too."""


def hand_units(scene: HandScene) -> Units:
    """Units of the problem of a hand, as in the plane."""
    rods = [(setup.finger.rod.length, setup.stiffness) for setup in scene.setups]
    return Units(max(length for length, _ in rods), max(stiff / length**2 for length, stiff in rods))


def hand_numbers(scene: HandScene, frames: Sequence[PlaneFrame], chosen: Sequence[TouchingPosture]) -> Values:
    """Run-time numbers by name, in units of the problem."""
    units = hand_units(scene)
    solid = scene.object
    weight = scene.weight
    lengths = {setup.name: setup.finger.rod.length for setup in scene.setups}
    fingers = {
        name: FingerStart((0.0, 0.0, 0.0), (posture.joint * lengths[name],), (1,), *posture.knots)
        for name, posture in zip(lengths, chosen, strict=True)
    }
    start = GraspStart("hand", (0.0, 0.0, 0.0), fingers, {})
    numbers: Values = {
        "center of mass": solid.com / units.length,
        "size": solid.size / units.length,
        "weight": solid.weighed * np.array(scene.acceleration) / units.force,
        "tolerance": scene.solver.penetration_tolerance,
        "cone share": 1.0 - scene.contacts.reserve,
        "cone rounding": APEX * (weight or units.force) / units.force,
        "force reference": max(weight, units.force) / units.force,
        "effort weight": 1.0,
        "relaxation weights": np.zeros(len(RELAXED)),
    }
    total = max(s.stiffness / s.finger.rod.length / s.tendons.offset for s in scene.setups)
    for setup, frame in zip(scene.setups, frames, strict=True):
        gravity = frame.axes[:, :2].T @ np.array(scene.acceleration)
        tolerance = scene.solver.penetration_tolerance
        numbers |= finger_values(setup, start, units, gravity.tolist(), 1.0 / total, tolerance)
        section: Any = setup.finger
        numbers |= {
            f"{setup.name}.position": frame.base / units.length,
            f"{setup.name}.axes": frame.axes.T.ravel(),
            f"{setup.name}.side weight": float(frame.axes[:, 2] @ np.array(scene.acceleration))
            * (setup.finger.rod.mass_per_length * setup.finger.rod.length**3 / setup.stiffness),
            f"{setup.name}.lateral": section.cross_section.lateral,
            f"{setup.name}.torsion": section.cross_section.torsion,
        }
        for name in (*setup.middle_names, setup.tip_name):
            numbers[f"{name}.friction"] = setup.friction
            numbers[f"{name}.normal_force_max"] = setup.normal_force_max / units.force
            numbers[f"{name}.torsional arm"] = scene.contacts.torsional_friction / setup.friction / units.length
    return numbers | _support_numbers(scene, units)


def _support_numbers(scene: HandScene, units: Units) -> Values:
    """Numbers of palm and table and of the object's contacts with them."""
    numbers: Values = {}
    for support in scene.supports:
        normal = np.array(support.normal)
        height = normal @ np.array(support.point) / units.length
        numbers[f"{support.name}.plane"] = np.append(normal, height)
    for contact in scene.support_contacts:
        name = contact.name
        normal = -np.array(contact.support.normal)
        side = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
        side = side / np.linalg.norm(side)
        numbers |= {
            f"{name}.point": np.array(contact.position) / units.length,
            f"{name}.axes": np.concatenate([normal, side, np.cross(normal, side)]),
            f"{name}.friction": contact.support.friction,
            f"{name}.as elsewhere": 0.0 if contact.support.has_own_friction else 1.0,
            f"{name}.normal_force_max": scene.contacts.normal_force_max / units.force,
        }
    return numbers


def surfaces(body: BodySurface, places: Array, thick: Array, length: float) -> Array:
    """Cubics (K, `SURFACE`) near places (K, 3) [m], for the surfaces at distances ``thick`` (K,) [m] from the object,
    with a unit of length [m].

    With d beyond such a surface these are d + k d^2 / 2 to third order, which vanishes where d does. With k a mean
    curvature, the distance from balls and cylinders is of second order, and exact.
    """
    near = body.near(places)
    foot = places + (thick - near.distance)[:, None] * near.normal
    normal = near.normal
    if near.slope is not None:  # triangles, on which normals are linear and the distance, too
        rest = np.zeros((len(places), 27))
        return np.hstack([foot / length, normal, near.slope, near.bending.reshape(-1, 9) * length, rest])
    step = STENCIL * thick
    shifts = np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])[:, None, :] * step[:, None]
    around = body.near((foot + shifts).reshape(-1, 3)).bending.reshape(7, -1, 3, 3)
    bending = around[0]
    changing = np.moveaxis((around[1:4] - around[4:]) / (2.0 * step[:, None, None]), 0, -1)
    curved = np.linalg.eigvalsh(bending)
    jumps = np.abs(changing).max(axis=(1, 2, 3)) > JUMP * np.abs(curved).max(axis=1) ** 2
    changing[jumps] = 0.0
    mean = (curved * np.abs(curved)).sum(axis=1) / np.maximum(np.abs(curved).sum(axis=1), 1e-300)
    once = np.einsum("k,ki,kjl->kijl", mean, normal, bending)
    changing = changing + once + np.moveaxis(once, 1, 2) + np.moveaxis(once, 1, 3)
    bending = bending + mean[:, None, None] * normal[:, :, None] * normal[:, None, :]
    columns = [foot / length, normal, normal, bending.reshape(-1, 9) * length, changing.reshape(-1, 27) * length**2]
    return np.hstack(columns)


def finger_bounds(setup: FingerSetup) -> tuple[list[float], list[float]]:
    """Least and greatest pulls of both tendons, as moments per E I / L."""
    moment = setup.stiffness / setup.finger.rod.length
    least, most = (t * setup.tendons.offset / moment for t in (setup.tendons.min_tension, setup.max_tension))
    used = setup.finger.tendons_used
    return [least, least], [most if used in ("both", side) else 0.0 for side in ("left", "right")]


@dataclass(frozen=True)
class ForceColumns:
    """Columns of the force of a contact, the normal force first, and its limits."""

    owner: int  # index of the finger; -1 of palm and table
    columns: slice
    friction: float  # less the reserve
    normal_force_max: float


@dataclass(frozen=True)
class ForceRows:
    """Equilibria of fingers and balances of the object where postures stay: linear in tensions and contact forces.

    Columns and rows belong to a finger, by index, or to all: -1.
    """

    matrix: Array
    offset: Array
    columns: Array  # places of the tensions, two per finger, and of the forces among the unknowns
    column_owners: Array
    row_owners: Array
    contacts: tuple[ForceColumns, ...]

    @staticmethod
    def of(scene: HandScene, problem: HandProblem, x: Array, p: Array) -> ForceRows:
        """Rows at a point."""
        columns = list[Array]()
        owners = list[int]()
        contacts = list[ForceColumns]()

        def add(name: str, owner: int) -> None:
            columns.append(np.arange(problem.x.size)[problem.x.at[name]])
            owners.extend([owner] * len(columns[-1]))

        fingers = [finger.name for finger in problem.spec.fingers]
        for k, name in enumerate(fingers):
            add(f"{name}.pulls", k)
        touching = [(contact.name, contact.finger) for contact in problem.spec.contacts]
        for name, owner in [*touching, *((name, -1) for name in problem.spec.carried)]:
            first = len(owners)
            add(f"force, {name}", owner)
            if problem.spec.soft and owner >= 0:
                add(f"torsion, {name}", owner)
            most, friction = (
                float(p[problem.numbers.at[f"{name}.{key}"]][0]) for key in ("normal_force_max", "friction")
            )
            held = friction * (1.0 - scene.contacts.reserve)
            contacts.append(ForceColumns(owner, slice(first, len(owners)), held, most))
        places = {f"finger equilibrium, {name}": k for k, name in enumerate(fingers)}
        places |= {"object force balance": -1, "object moment balance": -1}
        blocks = [block for block in problem.rows.blocks if block.name in places]
        rows = np.concatenate([np.ravel(block.rows) for block in blocks])
        row_owners = np.concatenate([np.full(block.rows.size, places[block.name]) for block in blocks])
        values, slopes = (np.array(part) for part in problem.nlp.functions["jac_g"](x, p))
        sought = np.concatenate(columns)
        matrix = slopes[np.ix_(rows, sought)]
        offset = values.ravel()[rows] - matrix @ x[sought]
        return ForceRows(matrix, offset, sought, np.array(owners), row_owners, tuple(contacts))

    @staticmethod
    def combined(each: Sequence[ForceRows]) -> ForceRows:
        """Rows of a hand whose finger k is as in the k-th of some points."""
        matrix = each[0].matrix.copy()
        offset = each[0].offset.copy()
        contacts = list(each[0].contacts)
        for k, rows in enumerate(each):
            columns, own = rows.column_owners == k, rows.row_owners == k
            matrix[:, columns], offset[own] = rows.matrix[:, columns], rows.offset[own]
            contacts = [
                theirs if theirs.owner == k else ours for ours, theirs in zip(contacts, rows.contacts, strict=True)
            ]
        return replace(each[0], matrix=matrix, offset=offset, contacts=tuple(contacts))

    def best(self, scene: HandScene) -> tuple[float, Array]:
        """Residual of the rows, in units of the problem, with the tensions and forces within their cones that leave the
        least, and these; infinite where the conic problem has no solution.
        """
        # Unknowns are tensions and forces, then what they leave of each row.
        sought = self.columns.size
        size = self.columns.size + self.offset.size
        low = np.full(size, -np.inf)
        high = np.full(size, np.inf)
        for k, setup in enumerate(scene.setups):
            low[2 * k : 2 * k + 2], high[2 * k : 2 * k + 2] = finger_bounds(setup)
        wide = max(contact.columns.stop - contact.columns.start - 1 for contact in self.contacts)
        width = np.zeros((len(self.contacts), size))
        across = np.zeros((len(self.contacts), wide, size))
        for c, contact in enumerate(self.contacts):
            normal, *others = range(size)[contact.columns]
            # Fingers press; palm and table may carry nothing.
            low[normal] = PRESSED * max(scene.weight / hand_units(scene).force, 0.1) if contact.owner >= 0 else 0.0
            high[normal], width[c, normal] = contact.normal_force_max, contact.friction
            across[c, range(len(others)), others] = 1.0
        cones = Cones(across, np.zeros(across.shape[:2]), width, np.zeros(len(self.contacts)))
        # 1e-6: weight of forces beside the residual, so that they are unique
        squares = np.concatenate([np.full(sought, 1e-6), np.ones(self.offset.size)])
        wholes = np.hstack([self.matrix, -np.eye(self.offset.size)])
        found = solve_conic(np.zeros(size), wholes, -self.offset, -self.offset, low, high, cones, squares)
        if not found.optimal:
            return np.inf, np.zeros(sought)
        return float(np.linalg.norm(found.x[sought:])), found.x[:sought]


def with_shifts(problem: HandProblem, x: Array, p: Array) -> Array:
    """A point whose turns and shifts to the side are those under its forces: the rows are linear in them."""
    columns = np.concatenate([
        np.arange(problem.x.size)[at] for name, at in problem.x.at.items() if name.endswith(("turns", ".shifts"))
    ])  # fmt: skip
    rows = np.concatenate([np.ravel(b.rows) for b in problem.rows.blocks if " to the side, " in b.name])
    values, slopes = (np.array(part) for part in problem.nlp.functions["jac_g"](x, p))
    x = x.copy()
    x[columns] -= np.linalg.solve(slopes[np.ix_(rows, columns)], values.ravel()[rows])
    return x
