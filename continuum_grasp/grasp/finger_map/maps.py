"""The maps of a scene's fingers, and the places of object and bases at which they are sampled."""

from __future__ import annotations

from functools import cached_property

from continuum_grasp.core import Compiler
from continuum_grasp.grasp.finger_map.fill import FingerMap
from continuum_grasp.grasp.finger_map.rod import FULL, MapFinger, MapSampling, ObjectTable
from continuum_grasp.grasp.object_supports import Pose, base_poses, object_poses
from continuum_grasp.scene import GraspScene

Place = tuple[Pose, tuple[Pose, ...]]
"""World pose of the object, and of each finger's base [m, rad]."""


def is_mapped() -> bool:
    """Whether fingers have maps: whether a C compiler is there."""
    return Compiler.find() is not None


def places_of(scene: GraspScene, on: frozenset[str]) -> list[Place]:
    """Places of object and bases that are sampled with the contacts ``on`` by name, the scene's own first, which is the
    only one where nothing may move.
    """
    places = list[Place]()
    for number, pose in enumerate(object_poses(scene, on)):
        bases = [base_poses(setup, number) for setup in scene.setups]
        for k in range(max(map(len, bases))):
            places.append((pose, tuple(of_finger[min(k, len(of_finger) - 1)] for of_finger in bases)))
    return places


class SceneMaps:
    """The maps of a scene's fingers, each made when it is first needed, with so much ``sampling``."""

    def __init__(self, scene: GraspScene, sampling: MapSampling = FULL) -> None:
        self.scene, self._sampling = scene, sampling
        self._maps: dict[tuple[str, Pose, Pose, frozenset[str]], FingerMap] = {}

    @cached_property
    def _table(self) -> ObjectTable:
        return ObjectTable(self.scene)

    def finger_of(self, name: str, base: Pose, pose: Pose, on: frozenset[str]) -> MapFinger:
        """A finger by name with a set of contacts, its base and the object at their poses."""
        (setup,) = (setup for setup in self.scene.setups if setup.name == name)
        return MapFinger(self.scene, setup, self._table, base, pose, on & setup.switches.keys(), self._sampling)

    def map_of(self, name: str, base: Pose, pose: Pose, on: frozenset[str]) -> FingerMap:
        """The map of such a finger."""
        finger = self.finger_of(name, base, pose, on)
        key = name, base, pose, frozenset(on & finger.setup.switches.keys())
        if key not in self._maps:
            self._maps[key] = FingerMap.of(finger)
        return self._maps[key]
