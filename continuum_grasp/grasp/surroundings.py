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

FINE = 64
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
        self._touches: list[Array] = []
        for finger in problem.fingers:
            points, elements, touches = guarded(finger)
            count = points.shape[1] - finger.unit.probes * finger.make.elements
            self._elements.append(elements[:count])
            self._touches.append(np.array(touches[:count]))
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
            line = _Line(finger, curvatures.ravel(), lengths.ravel(), base.ravel(), setup, units)

            def look(
                at: Array, owner: Array, setup: FingerSetup = setup, base: Array = base.ravel()
            ) -> list[tuple[Array, Array, Array]]:
                return [_look(thing, setup, base, at, owner, pose, units) for thing in things]

            even = np.tile(np.arange(FINE + 1) / FINE, (finger.make.elements, 1))
            depth = _depth(look(*line.at(even)))
            probes = _deepest(depth.reshape(-1, FINE + 1), finger.unit.probes)
            at, owner = line.at(probes)
            count = points.shape[1]
            looked = look(np.concatenate([points.T, at]), np.concatenate([self._elements[k], owner]).astype(int))
            free = [i for i in range(count + len(at)) if i >= count or not self._touches[k][i]]
            inside = [entry if thing.moves else None for thing, entry in zip(things, looked, strict=True)]
            deepest = max(
                deepest,
                *(float((needed - gap).max()) for i, (_, gap, needed) in enumerate(looked) if inside[i] is None),
                *(float((entry[2] - entry[1])[free].max()) for entry in inside if entry is not None),
            )
            found[f"{setup.name}.probes"] = probes.ravel()
            for thing, (obstacle, _, needed) in zip(things, looked, strict=True):
                for j in range(len(needed)):
                    found[f"{setup.name}.{thing.label}_{j}"] = obstacle[j]
                    if not thing.moves:
                        found[f"{setup.name}.{thing.label.replace('support', 'needed')}_{j}"] = needed[j]
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
    thing: _Thing, setup: FingerSetup, base: Array, at: Array, owner: Array, pose: Array, units: Units
) -> tuple[Array, Array, Array]:
    """Obstacles (K, 6), gaps (K,) and the gaps that are needed (K,)."""
    half = setup.finger.thickness_radius
    needed = np.full(len(at), half / units.length)
    if thing.part is not None:
        return *_nearest(thing.part, _local(at, pose) if thing.moves else at, units), needed
    point = thing.point / units.length
    obstacle = np.tile([0.0, *thing.normal, *point, 0.0], (len(at), 1))
    height = float((base[:2] - point) @ thing.normal)
    if height < CLEAR * half / units.length:  # the finger comes out of it
        needed[owner < setup.before[0]] = min(0.0, height)
    return obstacle, (at - point) @ thing.normal, needed


class _Line:
    """The backbone of a finger at a point of the search."""

    def __init__(
        self, finger: FingerState, curvatures: Array, lengths: Array, base: Array, setup: FingerSetup, units: Units
    ) -> None:
        self._ends = np.concatenate([[0.0], np.cumsum(lengths)])
        self._lengths, self._base = lengths, base
        self._scale = setup.finger.rod.length / units.length
        arcs = finger.make.family == "arc"
        self._knots = np.repeat(self._ends, 2)[1:-1] if arcs else self._ends
        self._curvatures = np.repeat(curvatures, 2) if arcs else curvatures

    def at(self, fractions: Array) -> tuple[Array, Array]:
        """World positions (N * M, 2) at increasing fractions (N, M) of the elements, and their elements (N * M,)."""
        inner = (self._ends[:-1, None] + self._lengths[:, None] * fractions).ravel()
        even = np.linspace(0.0, 1.0, 129)
        every = np.concatenate([even, inner])
        order = np.argsort(every, kind="stable")
        line = np.empty(len(every), complex)
        line[order] = sample(self._knots[None], self._curvatures[None], every[None, order])[0][0]
        line = line[len(even) :] * np.exp(1j * self._base[2]) * self._scale
        owner = np.repeat(np.arange(len(fractions)), fractions.shape[1])
        return np.stack([self._base[0] + line.real, self._base[1] + line.imag], axis=1), owner


def _depth(looked: list[tuple[Array, Array, Array]]) -> Array:
    return np.asarray(np.max([needed - gap for _, gap, needed in looked], axis=0))


def _deepest(depth: Array, count: int) -> Array:
    """Per element, the fractions (N, count) where it is deepest, apart from each other, by parabolas."""
    left, picks = depth.copy(), []
    left[:, [0, -1]] = -np.inf  # ends are looked after on their own
    near, rows = FINE // (2 * count), np.arange(len(depth))
    for _ in range(count):
        pick = left.argmax(axis=1)
        a, b, c = (depth[rows, pick + k] for k in (-1, 0, 1))
        bent = a - 2.0 * b + c
        with np.errstate(divide="ignore", invalid="ignore"):
            shift = np.where(bent < 0.0, 0.5 * (a - c) / bent, 0.0)
        picks.append((pick + np.clip(shift, -1.0, 1.0)) / FINE)
        for k, j in enumerate(pick):
            left[k, max(j - near, 0) : j + near + 1] = -np.inf
    return np.sort(np.stack(picks, axis=1), axis=1)


def _local(points: Array, pose: Array) -> Array:
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return np.asarray((points - pose[:2]) @ np.array([[c, -s], [s, c]]))


def _nearest(part: Part, points: Array, units: Units) -> tuple[Array, Array]:
    """`nearest_obstacles` in units of the problem."""
    obstacle, gap = nearest_obstacles(part, points * units.length)
    obstacle[:, 3:] /= units.length
    return obstacle, gap / units.length
