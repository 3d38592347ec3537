"""Task of a finger in a mission: knowledge and setpoints of its controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from continuum_grasp.addons.mission.scene import MissionScene
from continuum_grasp.base import Array
from continuum_grasp.grasp import GraspResult, Resistance
from continuum_grasp.scene import ControlScene

T = TypeVar("T")

LARGEST = 5.0
"""Multiple of a wrench beyond which nothing is pulled with: what presses the object on a support is resisted anyhow."""


@dataclass(frozen=True)
class Assignment:
    """Task of one finger; a mission has one for each finger."""

    mission: MissionScene
    grasp: GraspResult  # that is carried out, of all fingers
    name: str  # of the finger in the grasp
    control: ControlScene  # finger, object and controller of all phases; the object stands where the mission begins
    object_pose: tuple[float, float, float]  # pose of the object in the grasp: world x, y [m] and angle [rad]
    tensions: Array  # of each tendon in the grasp [N]
    held: Array  # inputs (nu) under which the finger holds the object with them
    tight: Array  # inputs (nu) beyond ``held``, as seen from ``before``, where a drive is at its limit
    reserve: float  # share of the tensions beyond ``before`` by which ``tight`` has more than ``held`` [1]
    before: Array  # inputs (nu) with which the finger is about to touch
    rest: Array  # inputs (nu) that leave the finger alone
    holding: tuple[Array, Array]  # least and greatest inputs (nu) while the object is held, whatever its force
    bends: Array  # bending angles of the controller's elements (N) when it is about to touch [rad]
    posture: Array  # bending angles of the same elements in the grasp [rad]
    forces: dict[str, float]  # normal force of the grasp at each held contact, by its name in the controller [N]
    middles: tuple[str, ...]  # names in the grasp of the contacts ``finger.1`` and so on
    resisted: Resistance  # disturbances that the grasp resists as certified, with drives that hold
    pulls: Array  # wrenches that are pulled with (K, 3): world force x, y [N], moment about the center of mass [N m]
    standing: float = 0.0
    """Share by which all fingers press harder than in the grasp from the lift on, since slip is over before they could
    answer it [1]."""
    gives: float = 0.0  # height that an object which weighs in the plane loses while it is pulled, without slip [m]

    @property
    def contact(self) -> str:
        """The held contact that presses hardest."""
        return max(self.forces, key=lambda contact: self.forces[contact])

    @property
    def force(self) -> float:
        """Normal force of the followed contact in the grasp [N]."""
        return self.forces[self.contact]

    def own_name(self, contact: str) -> str:
        """Name in the mission of a contact of this finger's controller or plant: ``finger.tip`` with this name."""
        body, _, part = contact.partition(".")
        return f"{self.name}.{part}" if body == "finger" else contact


def present(value: T | None) -> T:
    """A value that a mission always has, where other scenes and closed loops may have none."""
    if value is None:
        raise ValueError("a mission needs an object that moves")
    return value
