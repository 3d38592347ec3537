"""The grasp of a hand in space as a nonlinear problem: the sum of its parts, see `continuum_grasp.grasp.hand.parts`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.grasp.hand.parts import (
    PLAIN,
    SURFACE,
    Aims,
    FingerPart,
    finger_part,
    grown,
    object_part,
    pair_part,
)
from continuum_grasp.grasp.problem.parts import PartedProblem
from continuum_grasp.grasp.problem.structure import FingerSpec
from continuum_grasp.scene import HandScene


@dataclass(frozen=True)
class SpatialContact:
    """A contact of a finger that is on."""

    name: str
    finger: int  # index of the finger
    end: int  # index of the element at whose end it sits


@dataclass(frozen=True)
class HandSpec:
    """The problem of a hand but for its numbers."""

    fingers: tuple[FingerSpec, ...]
    contacts: tuple[SpatialContact, ...]
    carried: tuple[str, ...] = ()  # names of the contacts with palm and table
    planes: tuple[str, ...] = ()  # names of what fingers keep clear of: palm, table
    pairs: tuple[tuple[int, int], ...] = ()  # indices of fingers that keep clear of each other
    soft: bool = False  # whether contacts of fingers bear moments about their normals
    aims: Aims = PLAIN

    @staticmethod
    def of(scene: HandScene, on: frozenset[str]) -> HandSpec:
        """The structure of the problem of a scene with some contacts on, by name."""
        fingers = []
        contacts = list[SpatialContact]()
        for k, setup in enumerate(scene.setups):
            fingers.append(FingerSpec.of(setup, on, any(scene.acceleration)))
            ends = {setup.middle_names[0]: setup.before[0] - 1, setup.tip_name: setup.elements - 1}
            contacts += [SpatialContact(name, k, end) for name, end in ends.items() if name in on]
        carried = tuple(contact.name for contact in scene.support_contacts if contact.name in on)
        planes = tuple(support.name for support in scene.supports)
        soft = scene.contacts.torsional_friction > 0.0
        return HandSpec(tuple(fingers), tuple(contacts), carried, planes, soft=soft)


class HandProblem(PartedProblem):
    """The problem of the grasp of a hand."""

    def __init__(self, spec: HandSpec) -> None:
        super().__init__()
        self.spec = spec
        alike = [replace(finger, name="{0}") for finger in spec.fingers]
        self.whole = self.add(object_part(spec.carried, spec.aims))
        self.fingers = [
            self.add(finger_part(finger, spec.planes, spec.soft, spec.aims), own.name)
            for finger, own in zip(alike, spec.fingers, strict=True)
        ]
        for k, m in spec.pairs:
            part = pair_part(alike[k], replace(alike[m], name="{1}"), spec.soft)
            self.add(part, spec.fingers[k].name, spec.fingers[m].name)

    def finger(self, k: int) -> FingerPart:
        """The part of a finger."""
        return self.fingers[k].part

    def guarded(self, x: Array, p: Array) -> list[tuple[Array, Array]]:
        """Guarded places (K, 3) of each finger, and half its thickness there (K,)."""
        each = [placed.values(self.finger(k).guards, x, p) for k, placed in enumerate(self.fingers)]
        return [(points.T, halves.ravel()) for points, halves in each]

    def halves(self, x: Array, p: Array) -> Array:
        """Half the thickness of the fingers at the contacts (C,)."""
        each = [placed.values(self.finger(k).halves, x, p)[0].ravel() for k, placed in enumerate(self.fingers)]
        return np.concatenate(each)

    def touches(self, k: int, x: Array, p: Array) -> list[list[Array]]:
        """Point, normal and force (3,) of each contact of a finger, its place along that, its shift and moment."""
        values = self.fingers[k].values(self.finger(k).touched, x, p)
        return [values[at : at + 6] for at in range(0, len(values), 6)]

    def carried(self, x: Array, p: Array) -> list[list[Array]]:
        """Point, normal and force on them (3,) of each contact with palm or table."""
        values = self.whole.values(self.whole.part.touched, x, p)
        return [values[at : at + 3] for at in range(0, len(values), 3)]


hand_problem = lru_cache(maxsize=16)(HandProblem)
"""The problem of a structure; built once in a process."""


@lru_cache(maxsize=1)
def grown_function() -> ca.Function:
    """`grown` in numbers."""
    point = ca.SX.sym("point", 3)
    surface = ca.SX.sym("surface", SURFACE)
    return ca.Function("grown", [point, surface], list(grown(point, surface)))
