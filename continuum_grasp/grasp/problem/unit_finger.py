"""A finger of a grasp in units of its own: length, bending stiffness and linear density are 1.

Every number of the finger is then a run-time parameter of the same model, so that fingers of one structure share one
solver. Its base is at the origin, pointing along +Y.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property, lru_cache
from itertools import accumulate, pairwise
from typing import Any

import casadi as ca

from continuum_grasp.grasp.problem.blocks import Columns, rotation
from continuum_grasp.grasp.problem.structure import ContactSpec, FingerSpec
from continuum_grasp.model import Family, FingerModel, backbone_of, soft
from continuum_grasp.scene import Finger, MomentLoad

_OFFSET = 0.5
"""Tendon offset of the unit finger; tensions are scaled so that any value does."""

BACKBONE_POINTS = 201
"""Points of a stored backbone: 0.5 % of the length apart, for pictures; the certificate integrates its own."""
PRESLIDING = 1e-3
"""Bend beyond a friction cell from which on its friction is as in a tendon that was pulled [rad]: below the model's
own errors, and wide enough for second derivatives. `continuum_grasp.grasp.certificate` has its own."""


class UnitFinger:
    """The unknowns and run-time numbers of a finger, its model, and what follows from them as expressions."""

    def __init__(self, spec: FingerSpec, x: Columns, numbers: Columns, tip: ca.SX, twist: ca.SX | None = None) -> None:
        """Add the finger's unknowns to ``x``; its tip bears a contact's (N, f, lift) and a moment ``twist`` too,
        in units of the problem.
        """
        self.spec = spec
        self._numbers = numbers
        self.curves = spec.curves.expressions(self.number("curves", spec.curves.size))
        self.shared = shared_by(spec)
        self.backbone = self.shared.backbone
        name, number = spec.name, self.number
        self.q = x(f"{name}.q", self.shared.model.n)  # bending coordinates of the unit finger
        # Positions of the middle contacts, as parts of the length.
        self.joints = [x(f"{name}.joint_{k}") if on else number(f"joint_{k}") for k, on in enumerate(spec.touching)]
        self.pulls = x(f"{name}.pulls", 2)  # tensions times offset, in E I / L of the finger
        self.lengths = self._element_lengths()  # as parts of the whole
        self.edges = [ca.SX(0.0), *accumulate(self.lengths)]
        self.base = x(f"{name}.base", 3) if spec.free else number("base", 3)  # x, y and angle in the world
        # Friction acts on the skin, half a thickness from the backbone; the tip's couple is an input of the model.
        couple = -self.half_at(spec.elements - 1) * tip[1] / number("force share") if spec.tip else ca.SX(0)
        if twist is not None:
            couple += twist / (number("force share") * number("length"))
        self.u = self.input(self.pulls, couple)  # input of the model
        self.p = self._parameters()  # run-time argument of the model
        ends, angles = self.backbone.joints(self.q, self.u, self.p)
        if spec.drive is not None:
            # What the drives hold: cable per length, of each or of the pulley; of a pulley under a torque the
            # difference of the pulls, and what the pulley winds up beyond the path of the tendon.
            self.command = x(f"{name}.command", 1 if spec.drive.pulley else 2)
            self.wound = x(f"{name}.wound") if spec.drive.winds else None
        # World positions (2, N) of the elements' ends, and world angles (N,) there.
        self.ends, self.angles = self.world(ends), angles + self.base[2]

    def _parameters(self) -> ca.SX:
        number = self.number
        nodes = self.spec.elements + 1
        values = [*self.lengths]
        if self.spec.curves.graded:
            sizes = {"curves": self.spec.curves.size, "node stiffness": nodes, "node shapes": nodes}
            values += [number(name, size) for name, size in sizes.items()]
        if self.spec.weighs:
            values.append(rotation(-self.base[2]) @ number("weight", 2))
        values += [number(key) for key in _optional(self.spec) if key != "gravity"]
        return ca.vertcat(*values)

    @property
    def family(self) -> Family:
        """Family of the elements."""
        return self.shared.model.structure.family

    @property
    def size(self) -> int:
        """Number of bending coordinates."""
        return int(self.q.numel())

    def number(self, name: str, size: int = 1) -> ca.SX:
        """A run-time number of this finger."""
        return self._numbers(f"{self.spec.name}.{name}", size)

    def half_at(self, end: int) -> ca.SX:
        """Half thickness at the end of an element, per the finger's length."""
        return self.curves.at(self.edges[end + 1])("thickness")

    def half(self, contact: ContactSpec) -> ca.SX:
        """Half thickness at a contact, in units of the problem."""
        return self.half_at(self.end_of(contact)) * self.number("length")

    def slope_at(self, end: int) -> ca.SX:
        """Slope of the half thickness along the finger at the end of an element."""
        return self.curves.slope("thickness", self.edges[end + 1])

    def lean(self, contact: ContactSpec) -> ca.SX:
        """Slope of the half thickness along the finger at a contact."""
        return self.slope_at(self.end_of(contact))

    @cached_property
    def guarded(self) -> tuple[ca.SX, list[int], list[bool], ca.SX]:
        """World positions (2, K) that must stay clear, the elements that they are in, whether the finger touches the
        object there, and half its thickness (K,) in units of the problem.

        These are fixed places, joints, and probes, which the search puts where a finger is deepest.
        """
        spec = self.spec
        touching = {n - 1 for n, on in zip(spec.before, spec.touching, strict=True) if on}
        touching |= {spec.elements - 1} if spec.tip else set()
        joints = range(spec.elements)
        count = spec.probes
        fractions = ca.reshape(self.number("probes", count * spec.elements), count, spec.elements)
        fixed, at = self.shared.fixed(self.q, self.u, self.p)
        probed = self.shared.probed(self.q, self.u, fractions, self.p)
        points = ca.horzcat(self.world(fixed), *(self.ends[:, k] for k in joints), self.world(probed))
        elements = [*self.shared.owners, *joints, *(k for k in joints for _ in range(count))]
        touches = [*(False for _ in self.shared.owners), *(k in touching for k in joints)]
        deep = [self.edges[k] + fractions[j, k] * self.lengths[k] for k in joints for j in range(count)]
        half = [self.curves.at(s)("thickness") for s in (*ca.vertsplit(at), *self.edges[1:], *deep)]
        clear = [*touches, *(False for _ in range(count * len(joints)))]
        return points, elements, clear, ca.cse(self.number("length") * ca.vertcat(*half))

    @property
    def unprobed(self) -> list[int]:
        """Elements of the guarded places that follow from the unknowns: probes are where a look puts them."""
        return [*self.shared.owners, *range(self.spec.elements)]

    @property
    def touches(self) -> list[bool]:
        """Whether the finger touches the object, of all guarded places."""
        return self.guarded[2]

    @property
    def guarded_shares(self) -> list[ca.SX]:
        """Places on their elements of what must stay clear, per length of the element."""
        count, elements = self.spec.guards, self.spec.elements
        probes = ca.vertsplit(self.number("probes", self.spec.probes * elements))
        even = [ca.SX((j + 0.5) / count) for _ in range(elements) for j in range(count)]
        _, at = self.shared.fixed(self.q, self.u, self.p)
        there = zip(ca.vertsplit(at), self.shared.owners, strict=True)
        fixed = [(s - self.edges[k]) / self.lengths[k] for s, k in there] if self.spec.curves.graded else even
        return [*fixed, *[ca.SX(1)] * elements, *probes]

    def stored(self) -> list[ca.SX]:
        """Expressions that a result stores: coordinates, lengths of the elements, curvature at the tip, tensions, base.

        Of graded fingers moments at the nodes (N + 1,), less the tendons' moments that belong to the shape, take the
        place of coordinates.
        """
        q, tip = self.backbone.stored(self.q, self.u, self.p)
        return [q, ca.vertcat(*self.lengths), tip, self.pulls, self.base]

    def world(self, points: ca.SX) -> ca.SX:
        """World positions (2, K) of points of the unit finger."""
        turned = self.number("length") * rotation(self.base[2]) @ points
        return turned + ca.repmat(self.base[:2], 1, points.shape[1])

    def end_of(self, contact: ContactSpec) -> int:
        """Index of the element at whose end a contact sits."""
        return self.spec.elements - 1 if contact.joint < 0 else self.spec.before[contact.joint] - 1

    def _element_lengths(self) -> list[ca.SX]:
        """Between contacts they are equal, or of graded fingers in the shares of the start."""
        spec = self.spec
        lengths = list[ca.SX]()
        ends = [ca.SX(0.0), *self.joints, ca.SX(1.0)]
        counts = pairwise([0, *spec.before, spec.elements])
        for (a, b), (first, end) in zip(pairwise(ends), counts, strict=True):
            if spec.curves.graded:
                shares = ca.vertsplit(self.number("shares", spec.elements)[first:end])
                lengths += [(b - a) * share for share in shares]
            else:
                lengths += [(b - a) / (end - first)] * (end - first)
        return lengths

    def input(self, pulls: ca.SX, couple: ca.SX) -> ca.SX:
        """The model's input for tensions, as moments at the tip, and a couple on the tip."""
        return ca.vertcat(pulls / _OFFSET, couple)

    def loads(self, forces: dict[int, ca.SX], couples: dict[int, ca.SX]) -> ca.SX:
        """The model's loads for forces and couples by joint; the tip is -1, its couple is an input."""
        middles = range(len(self.spec.before))
        zero = ca.SX.zeros(2)
        return ca.vertcat(*(forces.get(k, zero) for k in [*middles, -1]), *(couples.get(k, 0.0) for k in middles))

    def missing_force(self, q: ca.SX, u: ca.SX, w: ca.SX) -> ca.SX:
        """Generalized force that is missing for rest under inputs and loads, in E I / L."""
        masses = [ca.vertcat(self.number(f"mass_{k}"), self.number(f"mass_{k}.at")) for k in range(self.spec.masses)]
        missing: ca.SX = self.shared.missing(q, u, w, ca.horzcat(ca.SX(2, 0), *masses), self.history, self.p)
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
        """Rows that are zero where the drives have the tensions, per length."""
        spec = self.spec.drive
        if spec is None:
            return ca.SX(0, 1)
        servo = self.number("servo")
        path = self.number("arm") * self.backbone.drawn(self.q, self.u, self.p)
        stretched = [c * pull for c, pull in zip(self.compliances(), ca.vertsplit(self.pulls), strict=True)]
        onset = self.number("onset")
        if not spec.pulley and not self.spec.in_error:
            commanded = self.command - ca.vertcat(path, -path) - servo * self.pulls
            # Where nothing pulls, let out until it is slack.
            return ca.vertcat(*(a - onset / (1.0 + (a / onset) ** 4) for a in stretched)) - commanded
        rows: list[ca.SX] = []
        difference = self.pulls[0] - self.pulls[1]
        if self.wound is not None:
            rows = [self.number("series") * (self.command - difference)]
            wound = self.wound
        elif spec.pulley:
            wound = self.command - servo * difference - path
        if spec.pulley:
            beyond = [self.number("start") + wound, self.number("start") - wound]
        else:
            beyond = ca.vertsplit(self.command - servo * self.pulls - ca.vertcat(path, -path))
        return ca.vertcat(*rows, *(a - soft(b, onset) for a, b in zip(stretched, beyond, strict=True)))

    def curvatures(self) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Curvatures for the strain limit; curvatures (degree + 1, N) at the family's places on each element; and the
        latter times the lengths of the elements.
        """
        fractions = self.number("strain probes", self.spec.elements) if "depth" in self.curves.names else ca.SX(0, 1)
        limited, at, bends = self.backbone.curvatures(self.q, self.u, fractions, self.p)
        return limited, at, bends


def _optional(spec: FingerSpec) -> list[str]:
    """Names of the run-time arguments that a finger's model has beside the lengths of its elements."""
    wanted = {
        "gravity": spec.weighs,
        "rest_curvature": spec.preshaped,
        "tendon_friction": spec.friction_cells > 0,
        "tip_mass": spec.tip_heavy,
        **{f"dry_friction_{k + 1}_{key}": True for k in range(spec.branches) for key in ("stiffness", "moment")},
    }
    return [name for name, on in wanted.items() if on]


class SharedFinger:
    """Functions that all fingers of one structure have in common, whatever they are called.

    The model's backbone gives them: places that are ``fixed``, ``owners`` being the elements that they are
    on, ``probed`` ones, the force that is ``missing`` for rest, and the ``line`` of all of the backbone.
    """

    def __init__(self, spec: FingerSpec) -> None:
        self.model = _unit_model(spec)
        self.backbone = backbone_of(self.model, spec.curves)
        self.fixed, self.owners = self.backbone.fixed_places(spec.guards)
        self.probed = self.backbone.places(spec.probes)
        self.missing = self.backbone.missing(spec.masses)
        self.line = self.backbone.line(BACKBONE_POINTS)


def shared_by(spec: FingerSpec) -> SharedFinger:
    """Functions of fingers of a structure; built once in a process."""
    return _shared_by(replace(spec, name=""))


_shared_by = lru_cache(maxsize=24)(SharedFinger)


def _unit_model(spec: FingerSpec) -> FingerModel:
    """The model of a finger in units of its own, uniform."""
    # The values only state what there is: the run-time argument replaces them.
    tendons = {
        "offset": _OFFSET,
        "max_tension": 1.0,
        "friction": 0.1 if spec.friction_cells else 0.0,
        "friction_cells": spec.friction_cells or 1,
        "presliding": _OFFSET * PRESLIDING,
    }
    damping = {
        "dry_friction": [{"stiffness": 1.0, "moment": 1.0}] * spec.branches,
        "friction_cells": spec.bending_cells or 1,
    }
    unit = Finger.model_validate(
        {
            "rod": {"length": 1.0, "linear_density": 1.0, "bending_stiffness": 1.0},
            "masses": [{"at": 1.0, "mass": 1.0}] if spec.tip_heavy else [],
            "tendons": tendons,
            "damping": damping,
        }
    )
    contacts = tuple(count / spec.elements for count in spec.before)
    names = [] if spec.curves.graded else ["element_lengths"]
    return FingerModel(
        unit,
        contacts=contacts,
        gravity=(0.0, 0.0),
        family=spec.family,
        elements=(1.0 / spec.elements,) * spec.elements,
        bending_range=spec.bending_range,
        # 1e-7: relative accuracy of the model's quadrature by default; its positions are some ten times better
        accuracy=spec.accuracy or 1e-7,
        parameters=(*names, *_optional(spec)),
        loads=tuple(MomentLoad(at=at, moment=0.0) for at in (*contacts, 1.0)),
        tip_force=True,
    )
