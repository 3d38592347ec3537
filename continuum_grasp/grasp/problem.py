"""The grasp as a nonlinear programme: unknowns, named constraints, objective.

Scales: lengths by L, forces by E I / L^2, moments by E I / L, angles as they are. The finger's mechanics are
those of `continuum_grasp.model.FingerModel`; element lengths are its run-time parameters, so that the middle
contact, which is always a joint of two elements, can move along the finger.

With c the object's centre, rho its radius plus half the finger's thickness h, and n(a) = (cos a, sin a):

    middle    r(s_m) = c + rho n,  n across the finger there (tangency)
    tip       r(L) = c + rho n(a),  a free
    finger    inverse dynamics at rest = 0, contact forces N n + f t and couples -h f included
    object    weight - sum (N n + f t) = 0, moments about c, lift out of the plane
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
from numpy.typing import NDArray

from continuum_grasp.grasp.blocks import BlockList
from continuum_grasp.grasp.limits import add_limits
from continuum_grasp.grasp.relaxations import RELAXATIONS
from continuum_grasp.grasp.seeds import bending_side
from continuum_grasp.model import FingerModel
from continuum_grasp.scene.finger import Finger, Tendons
from continuum_grasp.scene.grasp import GraspScene, OutOfPlaneGravity, PlanarGravity
from continuum_grasp.scene.loads import MomentLoad

__all__ = ["GraspProblem"]

Array = NDArray[Any]

REGULARISATION = 1e-6
"""Weight of the squared contact forces (scaled) beside the tension, so that they are unique."""
TINY = 1e-6
"""Rounding of the norm of what gives way in several components (scaled)."""
MODEL_ACCURACY = 1e-10
"""Relative accuracy of the model's quadrature where the scene says nothing; far below the certificate's
limits."""


@dataclass(frozen=True)
class _Contact:
    name: str
    normal: ca.SX
    force: ca.SX
    """(N, f, lift) [N]."""
    friction: ca.SX

    @property
    def across(self) -> ca.SX:
        return ca.vertcat(-self.normal[1], self.normal[0])

    @property
    def world(self) -> ca.SX:
        """Force on what touches the object [N]."""
        return self.force[0] * self.normal + self.force[1] * self.across


class GraspProblem:
    """Variables, constraint blocks and objective of a grasp.

    Parameters
    ----------
    scene : GraspScene
    samples : int, optional
        Points along the finger at which penetration is excluded; the scene's where not given.

    Attributes
    ----------
    scene : GraspScene
    model : FingerModel
    parts : BlockList
        Unknowns and constraints.
    objective : casadi.SX
        Scaled objective.
    weights : casadi.SX
        Its run-time weights: of the tension term, then of each relaxation's amount.
    """

    def __init__(self, scene: GraspScene, samples: int | None = None) -> None:
        self.scene = scene
        self.finger = scene.finger
        self.length = self.finger.rod.length
        self.moment_scale = self.finger.rod.stiffness / self.length
        self.force_scale = self.moment_scale / self.length
        self.count = scene.element_count
        self.samples = max(3, -(-(samples or scene.solver.samples) // self.count))
        self.before = scene.elements_before_middle
        self.middle_on = scene.contacts.middle == "on"
        self.tip_on = scene.contacts.tip == "on"
        self.model = self._make_model()
        self.parts = BlockList()
        self._unknowns()
        self._contacts()
        self._balance_finger()
        self._balance_object()
        add_limits(self)
        self._set_objective()

    @property
    def tendons(self) -> Tendons:
        """The finger's tendons."""
        if self.finger.tendons is None:  # the scene's own validation excludes it
            raise ValueError("finger.tendons is needed")
        return self.finger.tendons

    # -- pieces ----------------------------------------------------------------------------------------------

    def _make_model(self) -> FingerModel:
        scene, fidelity = self.scene, self.scene.fidelity
        planar = isinstance(scene.gravity, PlanarGravity)
        gravity = scene.gravity.vector if isinstance(scene.gravity, PlanarGravity) else (0.0, 0.0)
        lengths = self.element_lengths(0.5 * self.length)
        at = sum(lengths[: self.before])
        return FingerModel(
            _at_rest(self.finger, planar),
            contacts=(at,),
            gravity=gravity,
            family=fidelity.family,
            elements=lengths,
            bending_range=scene.bending_range,
            accuracy=fidelity.accuracy or MODEL_ACCURACY,
            parameters=("element_lengths",),
            loads=(MomentLoad(at=at, moment=0.0), MomentLoad(at=self.length, moment=0.0)),
            tip_force=True,
        )

    def element_lengths(self, middle: Any) -> tuple[Any, ...]:
        """Element lengths for a position of the middle contact: equal on each side of it."""
        behind = self.count - self.before
        return (middle / self.before,) * self.before + ((self.length - middle) / behind,) * behind

    @property
    def q_scale(self) -> float:
        """Scale of the bending coordinates."""
        return 1.0 if self.model.family == "arc" else 1.0 / self.length

    def _unknowns(self) -> None:
        add, scene = self.parts.unknown, self.scene
        tension_scale = self.moment_scale / self.tendons.offset
        bounds = scene.middle_bounds if self.middle_on else (self.before / self.count * self.length,) * 2
        self.q = add("bending", self.model.n, self.q_scale)
        self.middle = add("middle contact position", 1, self.length, bounds[0], bounds[1])
        self.tensions = add("tensions", 2, tension_scale, self.tendons.min_tension)
        self.tip_angle = add("tip contact angle", 1 if self.tip_on else 0, 1.0)
        self.names = [n for n, on in (("middle", self.middle_on), ("tip", self.tip_on)) if on]
        if scene.palm_touches:
            self.names.append("palm")
        spatial = isinstance(scene.gravity, OutOfPlaneGravity)
        for name in self.names:
            add(f"normal force, {name}", 1, self.force_scale, 0.0)
            add(f"friction force, {name}", 1, self.force_scale)
            add(f"lift, {name}", 1 if spatial else 0, self.force_scale)
        scales = {"tension": tension_scale, "normal force": self.force_scale, "strain": 1.0 / self.length}
        scales |= {"room at the palm": self.length, "room at the object": self.length}
        scales |= {"tilt balance": self.moment_scale}
        self.give = {r.name: add(f"relaxed {r.name}", r.size, scales.get(r.name, 1.0), 0.0, 0.0) for r in RELAXATIONS}
        self.lengths = ca.vertcat(*self.element_lengths(self.middle))

    @cached_property
    def _couples(self) -> dict[str, ca.SX]:
        """Couples of the friction forces about the backbone [N m]."""
        thickness = self.finger.thickness_radius
        variables = self.parts.variables
        return {
            name: -thickness * variables[f"friction force, {name}"].physical if name in self.names else ca.SX(0)
            for name in ("middle", "tip")
        }

    @cached_property
    def u(self) -> ca.SX:
        """The model's input: tensions and the couple on the tip."""
        return ca.vertcat(self.tensions, self._couples["tip"])

    def position(self, s: Any) -> ca.SX:
        """World position of a section [m]."""
        return self.model.position(self.q, self.u, s, self.lengths)

    def _contacts(self) -> None:
        scene, variables = self.scene, self.parts.variables
        centre = ca.DM(scene.object.position)
        reach = scene.object.radius + self.finger.thickness_radius
        extra = self.give["friction"]
        self.contacts: list[_Contact] = []
        for name in self.names:
            if name == "palm" and scene.palm is not None:
                normal = -ca.SX(ca.DM(scene.palm.normal))
            elif name == "tip":
                normal = ca.vertcat(ca.cos(self.tip_angle), ca.sin(self.tip_angle))
            else:
                angle = self.model.orientation(self.q, self.u, self.middle, self.lengths)
                normal = bending_side(scene) * ca.vertcat(ca.cos(angle), ca.sin(angle))
            lift = variables[f"lift, {name}"]
            force = ca.vertcat(
                variables[f"normal force, {name}"].physical,
                variables[f"friction force, {name}"].physical,
                lift.physical if lift.symbol.numel() else ca.SX(0),
            )
            given = scene.palm_friction if name == "palm" else scene.contacts.friction
            self.contacts.append(_Contact(name, normal, force, given + extra))
            if name != "palm":
                at = self.middle if name == "middle" else self.length
                gap = self.position(at) - centre - reach * normal
                self.parts.require(f"contact gap, {name}", gap, self.length, "m", f"contacts.{name}")

    def _force(self, name: str) -> ca.SX:
        return next((c.world for c in self.contacts if c.name == name), ca.SX.zeros(2))

    def _balance_finger(self) -> None:
        zero = ca.SX.zeros(self.model.n)
        w = ca.vertcat(self._force("middle"), self._force("tip"), self._couples["middle"])
        missing = self.model.inverse_dynamics(self.q, zero, zero, self.u, w, self.lengths)
        if isinstance(self.scene.gravity, PlanarGravity):
            for mass in self.finger.masses:
                if not _on_tip(mass.at, self.length):
                    arm = self.model.jacobian(self.q, self.u, mass.at, self.lengths)
                    missing -= mass.mass * arm.T @ ca.DM(self.scene.gravity.vector)
        scale = self.moment_scale / self.q_scale
        unit = "N m" if self.model.family == "arc" else "N m2"
        self.parts.require("finger equilibrium", missing, scale, unit, "finger")

    def _balance_object(self) -> None:
        scene, thing, require = self.scene, self.scene.object, self.parts.require
        mass = thing.mass * (1.0 - self.give["mass"])
        force, moment, lift, tilt = ca.SX.zeros(2), ca.SX(0), ca.SX(0), ca.SX.zeros(2)
        for contact in self.contacts:
            force -= contact.world
            moment -= thing.radius * contact.force[1]
            lift += contact.force[2]
            tilt += contact.force[2] * contact.normal
        if isinstance(scene.gravity, PlanarGravity):
            force += mass * ca.DM(scene.gravity.vector)
        require("object force balance", force, self.force_scale, "N", "object.mass")
        require("object moment balance", moment, self.moment_scale, "N m", "object")
        if isinstance(scene.gravity, OutOfPlaneGravity):
            weight = mass * scene.gravity.magnitude
            require("object lift balance", lift - weight, self.force_scale, "N", "object.mass")
            if scene.gravity.tilt == "balance":
                tilt -= self.give["tilt balance"] / thing.radius
                require("object tilt balance", tilt, self.force_scale, "N", "gravity.tilt")

    @cached_property
    def curvatures(self) -> ca.SX:
        """Curvature of each arc, or at each node of the clothoids [1/m]."""
        if self.model.family == "arc":
            return ca.SX(self.q / self.lengths)
        if self.model.family == "clothoid":
            return self.q
        return ca.vertcat(self.q, self.tip_curvature)

    @cached_property
    def tip_curvature(self) -> ca.SX:
        """Curvature that the moment balance imposes at the tip [1/m]."""
        moment = (self.tensions[0] - self.tensions[1]) * self.tendons.offset + self._couples["tip"]
        return moment / self.finger.rod.stiffness + self.finger.curvature_pieces[-1][2]

    def _set_objective(self) -> None:
        scaled = [self.parts.variables["tensions"].symbol[k] for k in range(2)]
        force = ca.vertcat(*(c.force for c in self.contacts)) / self.force_scale
        effort = sum(scaled) + REGULARISATION * ca.sumsqr(force)
        self.weights = ca.SX.sym("weights", 1 + len(RELAXATIONS))
        given = (self.parts.variables[f"relaxed {r.name}"].symbol for r in RELAXATIONS)
        relaxed = ca.vertcat(*(z if z.numel() == 1 else ca.sqrt(ca.sumsqr(z) + TINY**2) for z in given))
        self.objective = self.weights[0] * effort + ca.dot(self.weights[1:], relaxed)


def _at_rest(finger: Finger, weighs: bool) -> Finger:
    """The finger as statics need it: no drive dynamics, and only those masses that the model can keep in
    place.
    """
    length = finger.rod.length
    masses = tuple(m for m in finger.masses if _on_tip(m.at, length)) if weighs else ()
    tendons = finger.tendons and finger.tendons.model_copy(update={"time_constant": None})
    return finger.model_copy(update={"masses": masses, "tendons": tendons})


def _on_tip(at: float, length: float) -> bool:
    return abs(at - length) <= 1e-9 * length
