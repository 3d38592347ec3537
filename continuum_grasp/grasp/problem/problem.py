"""The grasp as a nonlinear problem (NLP): unknowns, named constraints, objective.

Units of the problem: length of the longest finger, greatest E I / L^2 of the fingers as force, radians. Each finger's
mechanics come from `continuum_grasp.model.FingerModel` in units of its own; element lengths are run-time parameters,
so that middle contacts, which are joints of two elements, can move along the finger. With surface point p, outward
normal n and half thickness h:

    middle    r(s) = p + h n,  n across the finger there (tangency)
    tip       r(L) = p + h n,  the finger not coming from within
    finger    inverse dynamics at rest = 0, contact forces N n + f t and couples -h f included
    object    weight - sum (N n + f t) + lift = 0, moments about the center of mass: six rows, less empty ones

All numbers of the scene are run-time arguments: two scenes of one structure share one solver. The problem is the sum of
its parts, see `continuum_grasp.grasp.problem.parts`.
"""

from __future__ import annotations

from dataclasses import replace

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.problem.finger_part import PlanarFinger, finger_part, pair_part
from continuum_grasp.grasp.problem.object_part import PlanarObject, object_part
from continuum_grasp.grasp.problem.parts import PartedProblem, PlacedPart
from continuum_grasp.grasp.problem.structure import ContactSpec, ProblemSpec


class GraspProblem(PartedProblem):
    """The problem of a planar grasp.

    Attributes
    ----------
    spec : ProblemSpec
    whole : PlacedPart of PlanarObject
    fingers : list of PlacedPart of PlanarFinger
    """

    def __init__(self, spec: ProblemSpec) -> None:
        super().__init__()
        self.spec = spec
        shared = spec.shared
        supports = tuple(contact for contact in spec.contacts if contact.finger < 0)
        names = [contact.name for contact in supports]
        surfaces = spec.surfaces if spec.free else ()
        self.whole: PlacedPart[PlanarObject] = self.add(object_part(shared, surfaces, _placed(supports, 0)), *names)
        self.fingers = [self._finger(k) for k in range(len(spec.fingers))]
        for k, other in spec.pairs:
            if k != other:
                self._pair(k, other)

    def pose(self, x: Array, p: Array) -> Array:
        """Pose of the object (3,) at a point."""
        return x[self.x.at["object pose"]] if self.spec.free else p[self.numbers.at["object pose"]]

    def _finger(self, k: int) -> PlacedPart[PlanarFinger]:
        spec, finger = self.spec, self.spec.fingers[k]
        contacts = tuple(contact for contact in spec.contacts if contact.finger == k)
        part = finger_part(spec.shared, replace(finger, name="{0}"), _placed(contacts, 1), (k, k) in spec.pairs)
        return self.add(part, finger.name, *(contact.name for contact in contacts))

    def _pair(self, k: int, other: int) -> None:
        pair = [self.spec.fingers[k], self.spec.fingers[other]]
        touching = [self._tip(k), self._tip(other)]
        names = [finger.name for finger in pair] + [tip.name if tip else "" for tip in touching]
        tips = [tip and replace(tip, name=f"{{{i}}}", finger=i - 2) for i, tip in enumerate(touching, 2)]
        first, second = (replace(finger, name=f"{{{i}}}") for i, finger in enumerate(pair))
        self.add(pair_part(self.spec.shared, (first, second), tuple(tips)), *names)

    def _tip(self, k: int) -> ContactSpec | None:
        """The contact at the tip of a finger, if that touches."""
        return next((contact for contact in self.spec.contacts if (contact.finger, contact.joint) == (k, -1)), None)


def _placed(contacts: tuple[ContactSpec, ...], first: int) -> tuple[ContactSpec, ...]:
    """Contacts of a part with one finger or none, whose names are given from ``first`` on."""
    return tuple(
        replace(contact, name=f"{{{k}}}", finger=min(contact.finger, 0)) for k, contact in enumerate(contacts, first)
    )
