"""What is near the fingers at a point of the search: obstacles for the places that are kept clear, and the depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.limits import guarded
from continuum_grasp.grasp.obstacles import nearest_obstacles
from continuum_grasp.grasp.problem import FingerState, GraspProblem
from continuum_grasp.grasp.scan_curves import sample
from continuum_grasp.grasp.values import Units
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.objects import Part

__all__ = ["Surroundings"]

Array = NDArray[Any]
Values = dict[str, Any]

FINE = 24
"""Places per element at which the depth is looked at."""
CLEAR = 1.0 - 1e-9
"""Part of the half thickness from which on a base counts as clear of a support."""


@dataclass(frozen=True)
class _Thing:
    """Something that fingers keep clear of."""

    label: str
    part: Part | None
    """None: a half plane."""
    moves: bool
    """Whether it moves with the object."""
    normal: Array
    point: Array


class Surroundings:
    """Finds the obstacles near the fingers of one problem.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self._problem = problem
        x, numbers = problem.parts.x, problem.numbers.symbol
        out: list[ca.SX] = [problem.pose]
        self._elements: list[list[int]] = []
        for finger in problem.fingers:
            points, elements = guarded(finger)
            count = points.shape[1] - finger.unit.probes * finger.make.elements
            self._elements.append(elements[:count])
            curvatures = finger.unit.curvatures(finger.q, finger.u, finger.p)
            out += [points[:, :count], curvatures, finger.p[: finger.make.elements], finger.base]
        self._places = ca.Function("places", [x, numbers], out)

    def look(self, scene: GraspScene, x: Array, numbers: Array) -> tuple[Values, float]:
        """Run-time numbers of all obstacles and probes at a point, and the deepest penetration (problem's units).

        Parameters
        ----------
        scene : GraspScene
        x, numbers : ndarray
            Unknowns and run-time numbers; those of obstacles do not matter.
        """
        units = Units.of(scene)
        pose, *rest = (np.array(v) for v in self._places(x, numbers))
        pose = pose.ravel()
        things = _things(scene)
        found, deepest = self._pegs(scene, pose, units), -np.inf
        for k, (setup, finger) in enumerate(zip(scene.setups, self._problem.fingers, strict=True)):
            points, curvatures, lengths, base = rest[4 * k : 4 * k + 4]
            dense = _dense(finger, curvatures.ravel(), lengths.ravel(), base.ravel(), setup, units)
            known = points.T
            elements = np.repeat(np.arange(finger.make.elements), FINE)
            at = np.concatenate([known, dense])
            owner = np.concatenate([self._elements[k], elements]).astype(int)
            looked = [_look(thing, scene, setup, at, owner, pose, units) for thing in things]
            depth = np.max([needed - gap for _, gap, needed in looked], axis=0)
            deepest = max(deepest, float(depth.max()))
            probes = _probes(depth[len(known) :].reshape(-1, FINE), finger.unit.probes)
            found[f"{setup.name}.probes"] = ((probes + 1) / FINE).ravel()
            chosen = len(known) + (probes + FINE * np.arange(len(probes))[:, None]).ravel()
            rows = np.concatenate([np.arange(len(known)), chosen])
            for thing, (obstacle, _, needed) in zip(things, looked, strict=True):
                for j, row in enumerate(rows):
                    found[f"{setup.name}.{thing.label}_{j}"] = obstacle[row]
                    if not thing.moves:
                        found[f"{setup.name}.{thing.label.replace('support', 'needed')}_{j}"] = needed[row]
        return found, deepest

    def _pegs(self, scene: GraspScene, pose: Array, units: Units) -> Values:
        """Parts of the object near the round supports, where its pose is sought."""
        found: Values = {}
        if not self._problem.make.free:
            return found
        for i, peg in enumerate(scene.pegs):
            local = _local(np.asarray(peg.position)[None] / units.length, pose)
            for k, part in enumerate(scene.object.parts):
                found[f"peg_{i}.obstacle_{k}"] = _nearest(part, local, units)[0][0]
        return found


def _things(scene: GraspScene) -> list[_Thing]:
    none = np.zeros(2)
    things = [_Thing(f"obstacle_{k}", part, True, none, none) for k, part in enumerate(scene.object.parts)]
    planes = [wall for wall in scene.walls if np.isinf(wall.half_length)]
    lines = [wall for wall in scene.walls if np.isfinite(wall.half_length)]
    for wall in planes:
        label = f"support_{len(things) - len(scene.object.parts)}"
        things.append(_Thing(label, None, False, np.asarray(wall.normal), np.asarray(wall.point)))
    for wall in lines:
        along = wall.half_length * np.array([-wall.normal[1], wall.normal[0]])
        a, b = np.asarray(wall.point) - along, np.asarray(wall.point) + along
        label = f"support_{len(things) - len(scene.object.parts)}"
        things.append(_Thing(label, Part(((a[0], a[1]), (b[0], b[1]))), False, none, none))
    for peg in scene.pegs:
        label = f"support_{len(things) - len(scene.object.parts)}"
        things.append(_Thing(label, Part((peg.position,), peg.radius), False, none, none))
    return things


def _look(
    thing: _Thing, scene: GraspScene, setup: FingerSetup, at: Array, owner: Array, pose: Array, units: Units
) -> tuple[Array, Array, Array]:
    """Obstacles (K, 6), gaps (K,) and the gaps that are needed (K,)."""
    half = setup.finger.thickness_radius
    needed = np.full(len(at), half / units.length)
    if thing.part is not None:
        return *_nearest(thing.part, _local(at, pose) if thing.moves else at, units), needed
    point = thing.point / units.length
    obstacle = np.tile([0.0, *thing.normal, *point, 0.0], (len(at), 1))
    height = float((np.asarray(setup.finger.base.position) - thing.point) @ thing.normal)
    if height < CLEAR * half and setup.finger.base_free is None:  # the finger comes out of it
        needed[owner < setup.before[0]] = min(0.0, height) / units.length
    return obstacle, (at - point) @ thing.normal, needed


def _dense(
    finger: FingerState, curvatures: Array, lengths: Array, base: Array, setup: FingerSetup, units: Units
) -> Array:
    """World positions at `FINE` places of each element, its end included."""
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    if finger.make.family == "arc":
        knots, values = np.repeat(ends, 2)[1:-1], np.repeat(curvatures, 2)
    else:
        knots, values = ends, curvatures
    inner = ends[:-1, None] + lengths[:, None] * (np.arange(1, FINE + 1) / FINE)
    at = np.concatenate([[0.0], inner.ravel()])
    line = sample(knots[None], values[None], at[None])[0][0, 1:]
    line = line * np.exp(1j * base[2]) * setup.finger.rod.length / units.length
    return np.stack([base[0] + line.real, base[1] + line.imag], axis=1)


def _probes(depth: Array, count: int) -> Array:
    """Per element (N, FINE) the places that are deepest, apart from each other (N, count)."""
    depth, picks = depth.copy(), []
    depth[:, -1] = -np.inf  # the end is looked after on its own
    near = FINE // (2 * count)
    for _ in range(count):
        pick = depth.argmax(axis=1)
        picks.append(pick)
        for k, j in enumerate(pick):
            depth[k, max(j - near, 0) : j + near + 1] = -np.inf
    return np.sort(np.stack(picks, axis=1), axis=1)


def _local(points: Array, pose: Array) -> Array:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray((points - pose[:2]) @ np.array([[c, -s], [s, c]]))


def _nearest(part: Part, points: Array, units: Units) -> tuple[Array, Array]:
    """`nearest_obstacles` in units of the problem."""
    obstacle, gap = nearest_obstacles(part, points * units.length)
    obstacle[:, 3:] /= units.length
    return obstacle, gap / units.length
