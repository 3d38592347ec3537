"""The paper's own models as finger models: printed or corrected, in closed form or by the appendix."""

from __future__ import annotations

import math
from collections.abc import Collection
from functools import cached_property
from typing import Any

import casadi as ca

from benchmarks.paper import appendix, closed_forms
from benchmarks.paper.coefficients import Reading
from benchmarks.paper.kinematics import Terms, TwoArcs
from benchmarks.paper.slips import DYNAMIC, AsPrinted
from continuum_grasp.base import InputError
from continuum_grasp.model import Equations, FingerModel, Scalar, Vec
from continuum_grasp.model.acting import Acting
from continuum_grasp.model.planar import Rotation
from continuum_grasp.model.structure import Structure
from continuum_grasp.scene import Finger, ForceLoad, Scene
from continuum_grasp.simulation.accuracy.choice import Errors, errors_of
from continuum_grasp.simulation.accuracy.truth import find_truth

_CLOSED: dict[str, frozenset[str]] = {"closed_printed": DYNAMIC, "closed_corrected": frozenset()}
_APPENDIX: dict[str, Reading] = {
    "appendix_printed": "printed",
    "appendix_corrected": "corrected",
    "appendix_unrotated": "unrotated",
}
VARIANTS = (*_CLOSED, *_APPENDIX)
"""Names of the variants."""


class PaperModel(FingerModel):
    """The two-arc model of doi:10.1155/2014/308283 as the paper writes it.

    The same coordinates, inputs and functions as ``FingerModel(..., family="arc", elements=2)``; mass matrix, velocity
    products, gravity and the generalized forces at contact and tip are the paper's. Elasticity (32), friction (39),
    (43) and actuation (42) are right in the paper and the same in both; positions and the potential energy are the
    exact ones, whatever the variant.

    ``finger`` and further keywords are as of ``FingerModel``; point masses and loads must be at the contact or at the
    tip, else it is an InputError. Variants: ``closed_printed``, equations (10)-(38) with every slip of
    ``slips.DYNAMIC``, read as said there; ``closed_corrected``, the same without, or with some ``slips`` of
    ``slips.SLIPS``; ``appendix_printed``, (A.1)-(A.4), with ``gravity_across`` the straight finger, which (A.4) does
    not have, from the corrected appendix; ``appendix_corrected``, their 56 wrong coefficients put right, with the
    rotary inertia that (A.1) drops; ``appendix_unrotated``, the same, but the velocity of the contact is not turned
    into the axes of the second arc. ``guard`` is the smallest angle of the closed forms [rad], which divide by it.
    """

    def __init__(
        self,
        finger: Scene | Finger,
        variant: str,
        *,
        slips: Collection[str] = (),
        gravity_across: bool = False,
        guard: float = closed_forms.GUARD,
        **settings: Any,
    ) -> None:
        if variant not in VARIANTS:
            raise InputError(f"unknown variant {variant!r}: expected one of {', '.join(VARIANTS)}")
        if slips and variant != "closed_corrected":
            raise InputError(f"slips are chosen for closed_corrected, not for {variant}")
        if gravity_across and variant != "appendix_printed":
            raise InputError(f"gravity_across is for appendix_printed; {variant} has gravity across the finger")
        if settings.setdefault("family", "arc") != "arc":
            raise InputError(f"the paper has circular arcs, not the family {settings['family']!r}")
        settings.setdefault("elements", 2)
        super().__init__(finger, **settings)
        self.variant = variant
        self._equations = _PaperEquations(self.structure, variant, AsPrinted(slips), guard)
        across = self._equations.arcs.gravity[0]
        if variant == "appendix_printed" and not gravity_across and not (isinstance(across, float) and across == 0.0):
            raise InputError(
                "(A.4) as printed has no gravity across the straight finger; gravity_across takes it from the "
                "corrected appendix"
            )


class _PaperEquations(Equations):
    """The equations of motion with the paper's mass matrix, velocity products, gravity and Jacobians."""

    def __init__(self, structure: Structure, variant: str, slips: AsPrinted, guard: float) -> None:
        super().__init__(structure)
        _check(structure)
        self._variant, self._guard = variant, guard
        self._slips = AsPrinted(_CLOSED[variant]) if _CLOSED.get(variant) else slips

    @cached_property
    def base(self) -> Rotation:
        """From the axes of the base to the world's."""
        angle = self._structure.finger.base.angle
        return Rotation(*(0.0 if abs(v) < 1e-15 else v for v in (math.cos(angle), math.sin(angle))))

    @cached_property
    def arcs(self) -> TwoArcs:
        """The finger as the paper describes it."""
        masses: list[Scalar] = [0.0, 0.0]
        for name, place in self._structure.masses():
            masses[place.link] = masses[place.link] + self._par[name]
        gx, gy = self._par.vector("gravity")
        weight = self.base.transposed().apply(Vec(gx, gy))
        return TwoArcs(
            lengths=(self.lengths[0], self.lengths[1]),
            mass_per_length=self._par["linear_density"],
            rotary_inertia=self._par["rotary_inertia"],
            contact_mass=masses[0],
            tip_mass=masses[1],
            gravity=(weight.x, weight.y),
        )

    @cached_property
    def theta(self) -> ca.SX:
        """Bending angles, of which the coordinates are what is above rest."""
        return ca.vertcat(*self.bends)

    @cached_property
    def terms(self) -> Terms:
        """The paper's terms."""
        if self._variant in _APPENDIX:
            return appendix.terms(self.arcs, self.theta, self.qd, _APPENDIX[self._variant])
        return closed_forms.terms(self.arcs, self.theta, self.qd, self._slips, guard=self._guard)

    @cached_property
    def point_forces(self) -> tuple[ca.SX, ca.SX]:
        """Forces of ``w`` on contact and tip [N, base axes]."""
        made, back = self._structure, self.base.transposed()
        starts = [(k, 2 * k) for k in range(len(made.contacts))]
        if made.tip_force:
            starts.append((1, 2 * len(made.contacts)))
        for load, (vector, start) in zip(made.loads, made.load_entries, strict=True):
            if vector == "w":
                starts.append((1 if made.on_tip(load.at) else 0, start))
        forces = [ca.SX(2, 1), ca.SX(2, 1)]
        for point, start in starts:
            forces[point] += back.apply(Vec(self.w[start], self.w[start + 1])).column()
        return forces[0], forces[1]

    @cached_property
    def mass_matrix(self) -> list[list[Scalar]]:
        """Mass matrix, (36) and (37), or (A.1)."""
        return [[self.terms.mass[i, j] for j in (0, 1)] for i in (0, 1)]

    @cached_property
    def bias(self) -> list[Scalar]:
        """Velocity products, (38) or (A.3)."""
        return [self.terms.bias[i] for i in (0, 1)]

    @cached_property
    def gravity(self) -> list[Scalar]:
        """Weight, (29) or (A.4)."""
        return [self.terms.gravity[i] for i in (0, 1)]

    @cached_property
    def external_force(self) -> list[Scalar]:
        """Generalized forces of ``w``, (41)."""
        at_contact, at_tip = self.point_forces
        force = self.terms.contact_jacobian.T @ at_contact + self.terms.tip_jacobian.T @ at_tip
        return [force[i] for i in (0, 1)]

    def net_force(self, acting: Acting, *, driven: bool = True) -> list[Scalar]:
        """M qdd, (43)."""
        outer = ca.vertcat(*self.external_force) - self.terms.bias - self.terms.gravity
        return [outer[i] + acting.actuation[i] - self.elastic[i] - self.damping[i] for i in (0, 1)]

    @cached_property
    def kinetic_energy(self) -> Scalar:
        """Kinetic energy of the variant's mass matrix [J]."""
        return ca.dot(self.qd, self.terms.mass @ self.qd) / 2


def _check(structure: Structure) -> None:
    """Refuse what the paper does not describe."""
    if len(structure.lengths) != 2:
        raise InputError(f"the paper has two arcs, this finger has {len(structure.lengths)}")
    for name, place in structure.masses():
        if place.fraction != 1.0:
            raise InputError(f"the paper has point masses at the contact and the tip only; {name} is elsewhere")
    for load, (vector, _) in zip(structure.loads, structure.load_entries, strict=True):
        if vector == "u":
            continue
        if not isinstance(load, ForceLoad) or load.follows:
            raise InputError("the paper has forces of fixed direction and moments on the tip only")
        if not structure.on_tip(load.at) and abs(load.at - structure.lengths[0]) > 1e-9 * structure.length:
            raise InputError(f"the paper has forces at the contact and the tip only; one is at {load.at} m")


def paper_errors(scene: Scene) -> dict[str, Errors]:
    """Errors of two exact arcs, and of each variant of the paper's equations, against the exact rod of a scene.

    Its ``fidelity`` is of two arcs; forces and masses are at contact and tip alone.
    """
    truth = find_truth(scene)
    held = scene.model_copy(update={"loads": truth.loads})
    models = {"two arcs": FingerModel(held, input_rates=False)}
    for variant in VARIANTS:
        models[variant] = PaperModel(held, variant, gravity_across=variant == "appendix_printed")
    return {name: errors_of(model, truth, moves=scene.time is not None) for name, model in models.items()}
