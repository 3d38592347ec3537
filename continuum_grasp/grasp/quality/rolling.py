"""How a contact rolls: curvatures of the two surfaces that touch."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.quality.bent_finger import Section
from continuum_grasp.grasp.quality.contact_set import ContactSet, object_part
from continuum_grasp.scene.grasp import GraspScene

__all__ = ["Rolling", "finger_rolling", "support_rolling"]

Array = NDArray[Any]

CONFORMING = 1e-3
"""Least relative curvature of two surfaces that touch in a point, over the object's size: below it they count
as lying against each other and do not turn."""
_CORNER = 1e-6
"""Distance from a corner, as a part of the object's size, that counts as on it: the tolerance of stored contacts."""


@dataclass(frozen=True)
class Rolling:
    """Rolling without slip of a finger or support on the object.

    Attributes
    ----------
    travel : float
        Way of the contact point along the surfaces per turn of one against the other, 1 / (sum of curvatures) [m].
    finger_share, object_share : float
        Turn of the normal per turn of the finger's section, and per turn of the object.
    """

    travel: float
    finger_share: float
    object_share: float

    @classmethod
    def of(cls, object_curvature: float, other_curvature: float, size: float) -> Rolling:
        """Rolling of two surfaces with these curvatures [1/m], positive where convex, infinite at corners."""
        if math.isinf(object_curvature) and math.isinf(other_curvature):
            return cls(0.0, 0.0, 1.0)
        if math.isinf(object_curvature):
            return cls(0.0, 1.0, 0.0)
        if math.isinf(other_curvature):
            return cls(0.0, 0.0, 1.0)
        total = max(object_curvature + other_curvature, CONFORMING / size)
        share = object_curvature / total
        return cls(1.0 / total, share, 1.0 - share)


def finger_rolling(
    scene: GraspScene, contacts: ContactSet, contact: int, section: Section, thickness: float, at_tip: bool
) -> Rolling:
    """Rolling of a finger's side or rounded tip on the object."""
    part, local = object_part(scene, contacts, contact)
    size = scene.object.size
    if at_tip:
        other = 1.0 / thickness if thickness > 0.0 else math.inf
    else:
        inward = -np.array([math.cos(section.angle), math.sin(section.angle)])  # where positive curvature bends to
        towards = -section.curvature if contacts.normals[contact] @ inward > 0.0 else section.curvature
        other = -towards / max(1.0 - towards * thickness, 1e-9)
    return Rolling.of(part.curvature((local[0], local[1]), _CORNER * size), other, size)


def support_rolling(scene: GraspScene, contacts: ContactSet, contact: int) -> Rolling:
    """Rolling of the object on a wall or peg; a flat face on a wall touches at two points and does not roll."""
    name, size = contacts.names[contact], scene.object.size
    part, local = object_part(scene, contacts, contact)
    for peg in scene.pegs:
        if peg.name == name:
            other = 1.0 / peg.radius if peg.radius > 0.0 else math.inf
            return Rolling.of(part.curvature((local[0], local[1]), _CORNER * size), other, size)
    for wall in scene.walls:
        if wall.name == name:
            offset = contacts.positions[contact] - np.asarray(wall.point)
            at_end = abs(float(np.hypot(*offset)) - wall.half_length) <= _CORNER * size
            return Rolling.of(part.curvature((local[0], local[1]), _CORNER * size), math.inf if at_end else 0.0, size)
    return Rolling(0.0, 0.0, 0.0)
