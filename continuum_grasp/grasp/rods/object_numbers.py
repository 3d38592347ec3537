"""The plain numbers of an object, wherever it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from continuum_grasp.base import Array
from continuum_grasp.grasp.body.table import DistanceTable
from continuum_grasp.grasp.rods.geometry import Geometry


@dataclass(frozen=True, eq=False)
class ObjectNumbers:
    """An object in the plane or in space."""

    geometry: Geometry
    table: DistanceTable  # [object size]
    size: float  # [m]
    axes: Array  # (`Geometry.axes`,)
    center: Array  # (3,) of mass, in the object's frame [object size]

    def distance(self, place: Array, pose: Array, contact: str = "") -> tuple[float, Array]:
        """Distance of a place (3,) from the object, both per its size, and outward normal (3,) of the object."""
        (gap,), (slope,) = self.table.values(self.in_object(place, pose)[None], contact)
        normal = np.array(self.geometry.turn(pose, self.axes), dtype=float)[:, : len(slope)] @ slope
        return float(gap), np.asarray(normal / np.linalg.norm(normal))

    def in_object(self, place: Array, pose: Array) -> Array:
        """A place (3,) in the object's frame (dimensions,), both per its size."""
        turn: Array = np.array(self.geometry.turn(pose, self.axes), dtype=float)
        away = place - np.array(self.geometry.place(pose), dtype=float)
        return np.asarray(away @ turn)[: self.geometry.dimensions]
