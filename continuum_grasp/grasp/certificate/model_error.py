"""Distance of the exact elastic rods under the forces found from the grasp's shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import SolverError
from continuum_grasp.grasp.certificate.check import EXACT
from continuum_grasp.grasp.certificate.recomputed import RecomputedFinger, RecomputedGrasp
from continuum_grasp.rod import Elastica, RodEquations, RodProblem

SMALL = 0.005
"""Greatest displacement per finger length [1] that is not warned of: half a millimeter of a finger of 0.1 m."""
LARGE = 0.01
"""Greatest displacement per finger length [1] with which a grasp may be called optimal."""
SECTIONS = 200
"""Sections at which moments are compared, about: two per panel, as near to the ends of elements as 0.2 % of the length.
"""


@dataclass(frozen=True)
class ModelError:
    """Error of the fingers' curvature families; it falls with the number of elements."""

    # How far the exact rods are from the grasp's shape [m], at contacts by name and at tips as ``<finger>.tip``.
    displacements: dict[str, float]
    length: float  # of the shortest finger [m]
    # Greatest difference between the bending moment of a finger's shape and that of the forces beyond each section,
    # as a part of the greatest moment.
    moment: float
    lost: tuple[str, ...] = ()  # fingers whose exact rods have no equilibrium near the grasp; without displacements

    @property
    def found(self) -> bool:
        """Whether every exact rod has an equilibrium near the grasp."""
        return bool(self.displacements) and not self.lost

    @property
    def greatest(self) -> float:
        """Greatest displacement [m]; infinite where one was not found."""
        return max(self.displacements.values()) if self.found else float("inf")

    @property
    def limit(self) -> float:
        """Greatest displacement that is passed over in silence: 0.5 % of the shortest finger's length [m]."""
        return SMALL * self.length

    @property
    def small(self) -> bool:
        """Whether the displacements are within the limit."""
        return self.greatest <= self.limit

    @property
    def is_large(self) -> bool:
        """Whether the displacements are too large, or missing, for the tension to hold for a real finger."""
        return not self.greatest <= LARGE * self.length

    def __str__(self) -> str:
        if not self.found:
            of = f" of {', '.join(self.lost)}" if self.lost else ""
            return f"the exact rod{of} under these forces has no equilibrium near this shape"
        parts = [f"{1e3 * off:.2g} mm at {name}" for name, off in self.displacements.items()]
        return f"the exact rod under these forces differs by {' and '.join(parts)}"


def model_error(grasp: RecomputedGrasp) -> ModelError:
    """Compare the fingers of a grasp with the equilibria of exact rods under their forces."""
    displacements: dict[str, float] = {}
    lost, moment = [], 0.0
    for finger in grasp.fingers:
        problem = _problem(finger)
        moment = float(np.maximum(moment, _moment_left_out(finger, problem)))
        try:
            exact = Elastica.deformed(problem, finger.shape.curvature)
        except SolverError:
            lost.append(finger.name)
            continue
        joints = {contact.name: contact.joint for contact in finger.contacts}
        joints[finger.setup.tip_name] = finger.lengths.size
        for name, joint in joints.items():
            off = exact.position(finger.joint_position(joint)) - finger.points[finger.joint_edges[joint]]
            displacements[name] = float(np.hypot(*off))
    return ModelError(displacements, min(f.length for f in grasp.fingers), moment, tuple(lost))


def _problem(bent: RecomputedFinger) -> RodProblem:
    """The finger under its weight, tendons and contact forces, which keep their world directions."""
    return RodProblem.of(
        bent.finger,
        complex(*bent.gravity),
        base=(complex(*bent.base[:2]), float(bent.base[2])),
        dead=[(bent.joint_position(contact.joint), complex(*contact.force)) for contact in bent.contacts],
        couples=[
            *((bent.joint_position(contact.joint), contact.couple) for contact in bent.contacts),
            *([] if bent.dry is None else bent.dry.couples),
        ],
        tensions=bent.tensions.tolist(),
        marks=bent.rod.joints.tolist(),
    )


def _moment_left_out(bent: RecomputedFinger, problem: RodProblem) -> float:
    """Moment of the shape against the moment of everything beyond a section, greatest relative difference."""
    # Two nodes per panel; dimensionless, with lengths over L and moments over E I / L.
    equations = RodEquations.on_panels(problem, 2.0 / SECTIONS, 2)
    shape = bent.length * bent.shape.curvature(bent.length * equations.mesh.nodes)
    gap = equations.balance(shape).missing
    # Less than this is rounding: the share of a straight finger's moment means nothing.
    least = EXACT * bent.moment_scale * bent.length / problem.stiffness
    moment = equations.bending_stiffness * (shape - equations.rest) - gap
    return float(np.abs(gap).max() / max(np.abs(moment).max(), least))
