"""Poses of the object and of the fingers' bases that are tried."""

from __future__ import annotations

import numpy as np

from continuum_grasp.scene.grasp import FingerSetup, GraspScene

__all__ = ["base_poses", "object_poses"]

Pose = tuple[float, float, float]


def object_poses(scene: GraspScene, on: frozenset[str], rng: np.random.Generator) -> list[Pose]:
    """Poses of the object, the scene's own first."""
    return [scene.object.pose]


def base_poses(setup: FingerSetup, number: int) -> list[Pose]:
    """Poses of a finger's base for the pose of the object with this number."""
    base = setup.finger.base
    return [(*base.position, base.angle)]
