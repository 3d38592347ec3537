"""The planes of a hand's fingers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Numbers as Array
from continuum_grasp.scene import HandScene


@dataclass(frozen=True)
class PlaneFrame:
    """The plane of a finger in the hand: its base, and as columns its axes x, y (along the straight finger) and normal.

    A finger bends towards -x where its curvature is positive, as planar fingers do.
    """

    base: Array  # (3,) [m]
    axes: Array  # (3, 3)

    @staticmethod
    def each(scene: HandScene) -> list[PlaneFrame]:
        """Planes of all fingers of a hand."""
        frames = []
        for base in scene.hand.named_bases.values():
            along = np.array(base.direction) / np.linalg.norm(base.direction)
            bends = np.array(base.bends_toward) - along * (along @ np.array(base.bends_toward))
            bends = bends / np.linalg.norm(bends)
            axes = np.column_stack([-bends, along, np.cross(along, bends)])
            frames.append(PlaneFrame(np.array(base.position), axes))
        return frames

    def world(self, points: Array) -> Array:
        """Points (..., 3) of the plane's frame as the hand sees them [m]."""
        return np.asarray(self.base + points @ self.axes.T)
