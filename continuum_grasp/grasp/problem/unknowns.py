"""Unknowns, named constraints and run-time numbers of a grasp, and the expressions of fingers and contacts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.problem.relaxations import RELAXATIONS
from continuum_grasp.grasp.problem.structure import ContactSpec, ProblemSpec
from continuum_grasp.grasp.problem.unit_finger import FingerSpec, Numbers, UnitFinger, rotation
from continuum_grasp.model.surfaces.surface import SurfacePoint
from continuum_grasp.nlp import Constraints, Violation

Array = NDArray[Any]


@dataclass(frozen=True)
class FingerState:
    """A finger's unknowns and what follows from them, as expressions.

    Attributes
    ----------
    spec : FingerSpec
    unit : UnitFinger
    q : casadi.SX
        Bending coordinates of the unit finger.
    joints : list of casadi.SX
        Positions of the middle contacts, as parts of the length.
    pulls : casadi.SX
        (2,) tensions times offset, in E I / L of the finger.
    base : casadi.SX
        (3,) x, y and angle in the world.
    u, p : casadi.SX
        Input and run-time argument of the unit finger's model.
    ends : casadi.SX
        (2, N) world positions of the elements' ends.
    angles : casadi.SX
        (N,) world angles there.
    """

    spec: FingerSpec
    unit: UnitFinger
    q: ca.SX
    joints: list[ca.SX]
    pulls: ca.SX
    base: ca.SX
    u: ca.SX
    p: ca.SX
    ends: ca.SX
    angles: ca.SX

    def world(self, points: ca.SX) -> ca.SX:
        """World positions (2, K) of points of the unit finger."""
        turned = self.unit.number("length") * rotation(self.base[2]) @ points
        return turned + ca.repmat(self.base[:2], 1, points.shape[1])

    def end_of(self, contact: ContactSpec) -> int:
        """Index of the element at whose end a contact sits."""
        return self.spec.elements - 1 if contact.joint < 0 else self.spec.before[contact.joint] - 1


@dataclass(frozen=True)
class TouchState:
    """A contact's unknowns and what follows from them, as expressions in the world.

    Attributes
    ----------
    spec : ContactSpec
    point, normal : casadi.SX
        (2,) surface point and outward normal of the object.
    local : SurfacePoint
        The same in the object's frame.
    force : casadi.SX
        (3,) N, f, lift.
    """

    spec: ContactSpec
    point: ca.SX
    normal: ca.SX
    local: SurfacePoint
    force: ca.SX

    @property
    def across(self) -> ca.SX:
        """The normal turned by +90 degrees."""
        return ca.vertcat(-self.normal[1], self.normal[0])

    @property
    def world(self) -> ca.SX:
        """Force on what touches the object."""
        return self.force[0] * self.normal + self.force[1] * self.across


class Unknowns:
    """What constraints and objective of a grasp are written in.

    Parameters
    ----------
    spec : ProblemSpec

    Attributes
    ----------
    spec : ProblemSpec
    parts : BlockList
        Unknowns and constraints.
    numbers : Numbers
        Run-time numbers.
    fingers : list of FingerState
    contacts : list of TouchState
    pose : casadi.SX
        (3,) of the object.
    slack : dict of str to casadi.SX
        Amount by which each limit that can be relaxed is relaxed.
    """

    def __init__(self, spec: ProblemSpec) -> None:
        self.spec = spec
        self.parts, self.numbers = BlockList(), Numbers()
        self.slack = {r.name: self.parts.unknown(f"relaxed {r.name}", r.size) for r in RELAXATIONS}
        self.pose = self.parts.unknown("object pose", 3) if spec.free else self.numbers("object pose", 3)
        if "greatest_friction_margin" in spec.aims:
            self.parts.unknown("friction margin")
        self._forces = {c.name: self._force(c) for c in spec.contacts}
        self.fingers = [self._finger(finger) for finger in spec.fingers]
        self.contacts = [self._touch(contact) for contact in spec.contacts]

    def thickness(self, finger: FingerState) -> ca.SX:
        """Half thickness of a finger."""
        return finger.unit.number("thickness") * finger.unit.number("length")

    @property
    def center_of_mass(self) -> ca.SX:
        """World position of the object's center of mass (2,)."""
        return self.pose[:2] + rotation(self.pose[2]) @ self.numbers("center of mass", 2)

    def _force(self, contact: ContactSpec) -> ca.SX:
        force = self.parts.unknown(f"force, {contact.name}", 3 if self.spec.gravity == "out_of_plane" else 2)
        return force if force.numel() == 3 else ca.vertcat(force, 0.0)

    def _finger(self, spec: FingerSpec) -> FingerState:
        unit, add = UnitFinger(spec, self.numbers), self.parts.unknown
        q = add(f"{spec.name}.q", unit.model.n)
        joints = [
            add(f"{spec.name}.joint_{k}") if on else unit.number(f"joint_{k}") for k, on in enumerate(spec.touching)
        ]
        pulls = add(f"{spec.name}.pulls", 2)
        base = add(f"{spec.name}.base", 3) if spec.free else unit.number("base", 3)
        tip = next((self._forces[c.name] for c in self.spec.contacts if self._on_tip(c, spec)), ca.SX.zeros(3))
        couple = -unit.number("thickness") * tip[1] / unit.number("force share") if spec.tip else ca.SX(0)
        u = unit.input(pulls, couple)
        p = unit.parameters(ca.SX(ca.vertcat(*unit.element_lengths(joints))), base[2])
        ends, angles = unit.model.joints(q, u, p)
        turned = unit.number("length") * rotation(base[2]) @ ends
        return FingerState(
            spec, unit, q, joints, pulls, base, u, p, turned + ca.repmat(base[:2], 1, ends.shape[1]), angles + base[2]
        )

    def _on_tip(self, contact: ContactSpec, finger: FingerSpec) -> bool:
        return contact.joint == -1 and self.spec.fingers[contact.finger] == finger

    def _touch(self, contact: ContactSpec) -> TouchState:
        number = self.numbers
        if contact.finger < 0 and not self.spec.free:  # a fixed object: numbers in place of unknowns
            local = SurfacePoint(number(f"{contact.name}.point", 2), number(f"{contact.name}.normal", 2), ca.SX(0, 1))
        else:
            place = self.parts.unknown(f"place, {contact.name}", 2)
            surface = contact.surface
            local = surface.point(place, number(f"{contact.name}.feature", surface.feature_count))
        self.parts.require(f"contact on the surface, {contact.name}", local.on_surface, "1", "object")
        turn = rotation(self.pose[2])
        point = self.pose[:2] + turn @ local.point
        return TouchState(contact, point, turn @ local.normal, local, self._forces[contact.name])


@dataclass(frozen=True)
class Variable:
    """Some unknowns, in units of the problem.

    Attributes
    ----------
    name : str
    symbol : casadi.SX
        A column.
    start : int
        Position of the first entry among all unknowns.
    """

    name: str
    symbol: ca.SX
    start: int

    @property
    def stop(self) -> int:
        """Position behind the last entry."""
        return self.start + int(self.symbol.numel())


class BlockList(Constraints):
    """Collects unknowns and constraints, and keeps their places."""

    def __init__(self) -> None:
        super().__init__()
        self.variables: dict[str, Variable] = {}
        self._columns: list[ca.SX] = []
        self._unknowns = 0

    def unknown(self, name: str, size: int = 1) -> ca.SX:
        """Add unknowns."""
        variable = Variable(name, ca.SX.sym(name, size), self._unknowns)
        self.variables[name] = variable
        self._unknowns += size
        return variable.symbol

    def require(
        self, name: str, expression: ca.SX, unit: str, key: str, *, lower: float = 0.0, upper: float = 0.0
    ) -> None:
        """Add constraints ``lower <= expression <= upper``."""
        column = ca.vec(ca.SX(expression))
        if column.numel():
            self.rows(name, key, unit, int(column.numel()), 1.0, lower, upper)
            self._columns.append(column)

    @property
    def x(self) -> ca.SX:
        """All unknowns."""
        return ca.vertcat(*(v.symbol for v in self.variables.values()))

    @property
    def g(self) -> ca.SX:
        """All constraint expressions."""
        return ca.vertcat(*self._columns)

    def pack(self, values: Mapping[str, Any], default: float) -> Array:
        """A column for all unknowns from values by name."""
        out = np.full(self._unknowns, default)
        for name, variable in self.variables.items():
            if name in values:
                out[variable.start : variable.stop] = values[name]
        return out

    def violations(self, g: Array, tolerance: float, units: Mapping[str, float]) -> list[Violation]:
        """The constraints that a point violates by more than ``tolerance``, worst first.

        ``units`` are the amounts of a unit of the problem, by unit; they belong to a scene, the blocks to many.
        """
        scaled = (replace(block, scale=np.array([units.get(block.unit, 1.0)])) for block in self.blocks)
        found = [block.violation(g[block.rows]) for block in scaled]
        return sorted((v for v in found if v.scaled > tolerance), key=lambda v: -v.scaled)
