"""One finger of a grasp in units of its own: length, bending stiffness and linear density are 1.

Every number of the finger is then a run-time parameter of the same model, so that fingers of one structure share one
solver. Its base is at the origin, pointing along +Y.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from continuum_grasp.grasp.problem.blocks import Columns, rotation
from continuum_grasp.grasp.problem.structure import ContactSpec, FingerSpec
from continuum_grasp.model import FingerModel
from continuum_grasp.model.backbone import Backbone
from continuum_grasp.model.winches import SOFT, soft
from continuum_grasp.scene.damping import Damping, DryFriction
from continuum_grasp.scene.finger import Finger, PointMass
from continuum_grasp.scene.loads import MomentLoad
from continuum_grasp.scene.rod import Rod
from continuum_grasp.scene.tendons import Tendons

ACCURACY = 1e-7
"""Relative accuracy of the model's quadrature by default; its positions are some ten times better."""
_OFFSET = 0.5
"""Tendon offset of the unit finger; tensions are scaled so that any value does."""

PRESLIDING = 1e-3
"""Bend beyond a friction cell from which on its friction is that of a tendon that was pulled [rad]: below the model's
own errors, and wide enough for second derivatives. `continuum_grasp.grasp.certificate` has its own."""


class UnitFinger:
    """The unknowns and run-time numbers of a finger, its model, and what follows from them as expressions."""

    def __init__(self, spec: FingerSpec, x: Columns, numbers: Columns, tip: ca.SX) -> None:
        """Add the finger's unknowns to ``x``; its tip bears a contact's (N, f, lift) in units of the problem."""
        self.spec, self._numbers = spec, numbers
        self._optional = {
            "gravity": spec.weighs,
            "rest_curvature": spec.preshaped,
            "tendon_friction": spec.friction_cells > 0,
            "tip_mass": spec.tip_heavy,
            **{f"dry_friction_{k + 1}_{key}": True for k in range(spec.branches) for key in ("stiffness", "moment")},
        }
        self.model = self._model()
        self.backbone = self._backbone()
        name, number = spec.name, self.number
        self.q = x(f"{name}.q", self.model.n)  # bending coordinates of the unit finger
        # Positions of the middle contacts, as parts of the length.
        self.joints = [x(f"{name}.joint_{k}") if on else number(f"joint_{k}") for k, on in enumerate(spec.touching)]
        self.pulls = x(f"{name}.pulls", 2)  # tensions times offset, in E I / L of the finger
        self.base = x(f"{name}.base", 3) if spec.free else number("base", 3)  # x, y and angle in the world
        # Friction acts on the skin, half a thickness from the backbone; the tip's couple is an input of the model.
        couple = -self.half_at(spec.elements - 1) * tip[1] / number("force share") if spec.tip else ca.SX(0)
        self.u = self.input(self.pulls, couple)  # input of the model
        self.p = self._parameters()  # run-time argument of the model
        ends, angles = self.joints_at(self.q, self.u)
        if spec.drive is not None:
            # What the drives hold: cable per length, of each or of the pulley; of a pulley under a torque the
            # difference of the pulls, and what the pulley winds up beyond the path of the tendon.
            self.command = x(f"{name}.command", 1 if spec.drive.pulley else 2)
            self.wound = x(f"{name}.wound") if spec.drive.pulley and not spec.drive.locks else None
        # World positions (2, N) of the elements' ends, and world angles (N,) there.
        self.ends, self.angles = self.world(ends), angles + self.base[2]

    def _model(self) -> FingerModel:
        """The model of the finger, uniform."""
        spec = self.spec
        # The values only state what there is: the run-time argument replaces them.
        unit = Finger(
            rod=Rod(length=1.0, linear_density=1.0, bending_stiffness=1.0),
            masses=(PointMass(at=1.0, mass=1.0),) if spec.tip_heavy else (),
            tendons=Tendons(
                offset=_OFFSET,
                max_tension=1.0,
                friction=0.1 if spec.friction_cells else 0.0,
                friction_cells=spec.friction_cells or 1,
                presliding=_OFFSET * PRESLIDING,
            ),
            damping=Damping(
                dry_friction=(DryFriction(stiffness=1.0, moment=1.0),) * spec.branches,
                friction_cells=spec.bending_cells or 1,
            ),
        )
        contacts = tuple(count / spec.elements for count in spec.before)
        own = ["element_lengths"] if spec.graded is None else []
        return FingerModel(
            unit,
            contacts=contacts,
            gravity=(0.0, 0.0),
            family=spec.family,
            elements=(1.0 / spec.elements,) * spec.elements,
            bending_range=spec.bending_range,
            accuracy=spec.accuracy or ACCURACY,
            parameters=(*own, *(name for name, wanted in self._optional.items() if wanted)),
            loads=tuple(MomentLoad(at=at, moment=0.0) for at in (*contacts, 1.0)),
            tip_force=True,
        )

    def _backbone(self) -> Backbone:
        return self.model.backbone()

    def _along(self) -> list[ca.SX]:
        """Run-time arguments of the backbone beside those of the model that differ along the finger."""
        return []

    def _parameters(self) -> ca.SX:
        values = [ca.SX(ca.vertcat(*self.element_lengths(self.joints))), *self._along()]
        if self.spec.weighs:
            values.append(rotation(-self.base[2]) @ self.number("weight", 2))
        values += [self.number(key) for key, wanted in self._optional.items() if wanted and key != "gravity"]
        return ca.vertcat(*values)

    def number(self, name: str, size: int = 1) -> ca.SX:
        """A run-time number of this finger."""
        return self._numbers(f"{self.spec.name}.{name}", size)

    def half_at(self, end: int) -> ca.SX:
        """Half thickness at the end of an element, per the finger's length."""
        return self.number("thickness")

    def half(self, contact: ContactSpec) -> ca.SX:
        """Half thickness at a contact, in units of the problem."""
        return self.half_at(self.end_of(contact)) * self.number("length")

    def lean(self, contact: ContactSpec) -> ca.SX:
        """Slope of the half thickness along the finger at a contact."""
        return ca.SX(0.0)

    def joints_at(self, q: ca.SX, u: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Positions (2, N) and angles (N,) of the ends of the elements of the unit finger."""
        ends, angles = self.backbone.joints(q, u, self.p)
        return ends, angles

    def drawn(self, q: ca.SX, u: ca.SX) -> ca.SX:
        """How far the bend draws in the first tendon and pays out the other, per offset at the base [rad]."""
        turn: ca.SX = self.joints_at(q, u)[1][-1]
        return turn

    @cached_property
    def guarded(self) -> tuple[ca.SX, list[int], list[bool], ca.SX]:
        """World positions (2, K) that must stay clear, the elements that they are in, whether the finger touches the
        object there, and half its thickness (K,) in units of the problem, one where it is the same everywhere.

        These are fixed places, joints, and probes, which the search puts where a finger is deepest.
        """
        spec = self.spec
        touching = {n - 1 for n, on in zip(spec.before, spec.touching, strict=True) if on}
        touching |= {spec.elements - 1} if spec.tip else set()
        joints, count = range(spec.elements), self.probes
        at = ca.reshape(self.number("probes", count * spec.elements), count, spec.elements)
        fixed, owners, probed, half = self.places(at)
        points = ca.horzcat(self.world(fixed), *(self.ends[:, k] for k in joints), self.world(probed))
        elements = [*owners, *joints, *(k for k in joints for _ in range(count))]
        touches = [*(False for _ in owners), *(k in touching for k in joints)]
        return points, elements, [*touches, *(False for _ in range(count * len(joints)))], half

    def places(self, fractions: ca.SX) -> tuple[ca.SX, list[int], ca.SX, ca.SX]:
        """Positions (2, K) of the unit finger that must stay clear, the elements that they are in, positions (2, M) at
        ``fractions`` (count, N) of the elements, and half the thickness in units of the problem: one, or that at all
        places, the ends of the elements being between both.
        """
        even = (np.arange(self.guards) + 0.5) / self.guards
        points = self.backbone.fixed_places(even.tolist())(self.q, self.u, self.p)
        probed = self.backbone.places(self.probes)(self.q, self.u, fractions, self.p)
        owners = [k for k in range(self.spec.elements) for _ in even]
        return points, owners, probed, self.number("thickness") * self.number("length")

    def stored(self) -> list[ca.SX]:
        """What a result stores: coordinates, lengths of the elements, curvature at the tip, tensions, base."""
        # Where the tip is matched, what the moment balance imposes.
        tip = self.curvatures()[1][-1, -1]
        return [self.q, self.p[: self.spec.elements], tip, self.pulls, self.base]

    def section(self, s: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Position and angle of the unit finger at a place."""
        point, angle = self.backbone.section(self.q, self.u, s, self.p)
        return point, angle

    def world(self, points: ca.SX) -> ca.SX:
        """World positions (2, K) of points of the unit finger."""
        turned = self.number("length") * rotation(self.base[2]) @ points
        return turned + ca.repmat(self.base[:2], 1, points.shape[1])

    def end_of(self, contact: ContactSpec) -> int:
        """Index of the element at whose end a contact sits."""
        return self.spec.elements - 1 if contact.joint < 0 else self.spec.before[contact.joint] - 1

    def element_lengths(self, joints: Sequence[Any]) -> list[Any]:
        """Element lengths for positions of the middle contacts: equal between them."""
        lengths: list[Any] = []
        counts = np.diff([0, *self.spec.before, self.spec.elements]).tolist()
        for (a, b), count in zip(pairwise([0.0, *joints, 1.0]), counts, strict=True):
            lengths += [(b - a) / count] * count
        return lengths

    def input(self, pulls: ca.SX, couple: ca.SX) -> ca.SX:
        """The model's input for tensions, as moments at the tip, and a couple on the tip."""
        return ca.vertcat(pulls / _OFFSET, couple)

    def loads(self, forces: dict[int, ca.SX], couples: dict[int, ca.SX]) -> ca.SX:
        """The model's loads for forces and couples by joint; the tip is -1, its couple is an input."""
        middles, zero = range(len(self.spec.before)), ca.SX.zeros(2)
        return ca.vertcat(*(forces.get(k, zero) for k in [*middles, -1]), *(couples.get(k, 0.0) for k in middles))

    def missing_force(self, q: ca.SX, u: ca.SX, w: ca.SX) -> ca.SX:
        """Generalized force that is missing for rest under inputs and loads, in E I / L."""
        masses = [ca.vertcat(self.number(f"mass_{k}"), self.number(f"mass_{k}.at")) for k in range(self.spec.masses)]
        missing: ca.SX = self._missing(q, u, w, ca.horzcat(ca.SX(2, 0), *masses), self.history, self.p)
        return missing

    @property
    def history(self) -> ca.SX:
        """Friction states of tendons and bending, and whether they are moved; empty where there are none."""
        states = self.spec.friction_states
        return self.number("friction_history", states + 1) if states else ca.SX(0, 1)

    def compliances(self) -> list[ca.SX]:
        """Elongation of each tendon, per length, per pull at the drive."""
        means: list[Any] = [1.0, 1.0]
        if self.spec.friction_cells:
            means = ca.vertsplit(self.backbone.mean_shares(self.q, self.u, self.history, self.p))
        return [self.number("series") + self.number("axial") * mean for mean in means]

    def drive_rows(self) -> ca.SX:
        """What is zero where the tensions are those of the drives, per length."""
        spec = self.spec.drive
        if spec is None:
            return ca.SX(0, 1)
        servo = self.number("servo")
        path = self.number("arm") * self.drawn(self.q, self.u)
        stretched = [c * pull for c, pull in zip(self.compliances(), ca.vertsplit(self.pulls), strict=True)]
        length = self.number("meters")
        if not spec.pulley and not self.spec.in_error:
            given = self.command - ca.vertcat(path, -path) - servo * self.pulls
            # Where nothing pulls, let out until it is slack.
            width = SOFT / length
            return ca.vertcat(*(a - width / (1.0 + (a / width) ** 4) for a in stretched)) - given
        rows: list[ca.SX] = []
        difference = self.pulls[0] - self.pulls[1]
        if self.wound is not None:
            rows, wound = [self.number("series") * (self.command - difference)], self.wound
        elif spec.pulley:
            wound = self.command - servo * difference - path
        if spec.pulley:
            beyond = [self.number("start") + wound, self.number("start") - wound]
        else:
            beyond = ca.vertsplit(self.command - servo * self.pulls - ca.vertcat(path, -path))
        return ca.vertcat(*rows, *(a - soft(length * b) / length for a, b in zip(stretched, beyond, strict=True)))

    @property
    def held(self) -> ca.SX:
        """What stays while friction or the object change."""
        return self.pulls if self.spec.drive is None else self.command

    @cached_property
    def _missing(self) -> ca.Function:
        return self.backbone.missing(self.spec.masses)

    @cached_property
    def _curvatures(self) -> ca.Function:
        return self.model.curvatures()

    def curvatures(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Curvatures that the strain limit is for; (degree + 1, N) at the family's places on each element; and the
        latter times the lengths of the elements.
        """
        kappa, at, bends = self._curvatures.call([self.q, self.u, self.p])
        return kappa, at, bends

    @property
    def probes(self) -> int:
        """Guarded places per element, where it is deepest: long elements can enter an object at two places."""
        return 2 if self.spec.elements < 4 else 1

    @property
    def guards(self) -> int:
        """Guarded places per element that are spread evenly."""
        # Few are enough beside the probes.
        return 4 if self.spec.elements > 3 else 6
