"""How far fingers reach, and how far the object is: bounds that hold for every posture and every pose allowed."""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np

from continuum_grasp.model.surfaces import surface_of
from continuum_grasp.model.surfaces.outline import Frame
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.objects.body import pose_bounds
from continuum_grasp.scene.parts import Part

__all__ = ["Reach", "reach_report"]

Interval = tuple[float, float]

_EXACT = 1e-5
"""Part of the object's size to which the distance is found where its angle is free."""
_MOST = 2000
"""Angles at which the distance is computed at most: stopping early leaves a valid bound."""


@dataclass(frozen=True)
class Reach:
    """How far one contact of a finger is from what it can reach.

    Attributes
    ----------
    contact : str
    finger : str
    reach : float
        Greatest distance from the base at which this contact can be [m].
    distance : float
        Least distance of the object from the base within the freedom of both; no pose has less [m].
    """

    contact: str
    finger: str
    reach: float
    distance: float

    @property
    def missing(self) -> float:
        """What the reach falls short by [m]; zero where it does not."""
        return max(0.0, self.distance - self.reach)


def reach_report(scene: GraspScene) -> tuple[Reach, ...]:
    """The contacts that must touch, the one that misses most first.

    Parameters
    ----------
    scene : GraspScene

    Returns
    -------
    tuple of Reach
        Of each contact that is on, or of a finger's farthest one where the choice is left.
    """
    found: list[Reach] = []
    for setup in scene.setups:
        distance = _distance(scene, setup)
        length, half = setup.finger.rod.length, setup.finger.thickness_radius
        switches = dict(zip((*setup.middle_names, setup.tip_name), (*setup.middles, setup.tip), strict=True))
        reaches = dict.fromkeys(setup.middle_names, setup.middle_bounds[1] + half) | {setup.tip_name: length + half}
        must = [name for name, switch in switches.items() if switch == "on"]
        may = [name for name, switch in switches.items() if switch == "auto"]
        must = must or sorted(may, key=lambda name: -reaches[name])[:1]
        found += [Reach(name, setup.name, reaches[name], distance) for name in must]
    return tuple(sorted(found, key=lambda r: -r.missing))


def _distance(scene: GraspScene, setup: FingerSetup) -> float:
    """Least distance of the object from a finger's base over the poses allowed."""
    base, body = setup.finger.base, scene.object
    x, y, turn = pose_bounds(body.pose, body.free)
    bx, by, _ = pose_bounds((*base.position, base.angle), setup.finger.base_free)
    box = (bx[0] - x[1], bx[1] - x[0]), (by[0] - y[1], by[1] - y[0])
    return max(0.0, min(_over_angles(part, box, turn) for part in body.parts))


def _over_angles(part: Part, box: tuple[Interval, Interval], turn: Interval) -> float:
    """Least distance of a part from a box, both about the object's origin, over an interval of its angle.

    A turn by an angle moves no point of the part by more than that times its extent, which bounds what lies between.
    """
    extent = part.extent
    low, high = turn
    high = min(high, low + math.tau)
    values = {angle: _to_box(part, box, angle) for angle in (low, high)}
    best = min(values.values())
    waiting = [(0.5 * (values[low] + values[high] - extent * (high - low)), low, high)]
    while len(values) < _MOST and waiting[0][0] < best - _EXACT * extent and best > 0.0:
        _, a, b = heappop(waiting)
        middle = 0.5 * (a + b)
        values[middle] = _to_box(part, box, middle)
        best = min(best, values[middle])
        for one, two in ((a, middle), (middle, b)):
            heappush(waiting, (0.5 * (values[one] + values[two] - extent * (two - one)), one, two))
    return max(0.0, min(best, waiting[0][0]))


def _to_box(part: Part, box: tuple[Interval, Interval], angle: float) -> float:
    """Least distance of a part, turned by an angle, from a box: by projections to and fro, then by the line that they
    find between the two, which is a bound.
    """
    shape = surface_of(part).outline(part, Frame(cmath.exp(1j * angle)), 0.0)
    (x0, x1), (y0, y1) = box
    q = complex(min(max(shape.center.real, x0), x1), min(max(shape.center.imag, y0), y1))
    best = 0.0
    for _ in range(500):
        gap, walk = shape.nearest(np.array([q]))
        if gap[0] <= 0.0:
            return 0.0
        normal = cmath.exp(1j * float(shape.walk(walk).angle[0]))
        foot = q - float(gap[0]) * normal
        corner = complex(x0 if normal.real > 0.0 else x1, y0 if normal.imag > 0.0 else y1)
        out = max((end * normal.conjugate()).real for end, _ in shape.extremes(normal, 0.0))
        best = max(best, (corner * normal.conjugate()).real - out)
        new = complex(min(max(foot.real, x0), x1), min(max(foot.imag, y0), y1))
        if abs(new - q) < 1e-12 * shape.extent:
            break
        q = new
    return best
