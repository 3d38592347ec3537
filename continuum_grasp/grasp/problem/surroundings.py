"""What is near the fingers at a point of the search: obstacles for the guarded places, and the depth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.problem.limits import guarded
from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.unknowns import FingerState
from continuum_grasp.grasp.problem.values import Units
from continuum_grasp.grasp.starts.scan.curves import sample
from continuum_grasp.model.surfaces import surface_of
from continuum_grasp.model.surfaces.surface import CORNERS
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.parts import OffsetPolygon, Part

Array = NDArray[Any]
Values = dict[str, Any]
Nearest = tuple[Array, Array, Array]
"""Directions (K,) of the nearest surface points' normals [rad], distances (K,), and corners (K, 2 * CORNERS)."""

FINE = 64
"""Places per element at which the depth is looked at: parabolas through the deepest place the probes."""
CLEAR = 1.0 - 1e-9
"""Part of the half thickness from which on a base counts as clear of a support."""


@dataclass(frozen=True)
class Sight:
    """What a look found.

    Attributes
    ----------
    numbers : dict
        Run-time numbers: probes, corners, needed gaps.
    directions : dict
        Values of the separating directions among the unknowns.
    deepest : float
        Greatest penetration beyond the relaxation, in units of the problem.
    """

    numbers: Values
    directions: Values
    deepest: float


@dataclass(frozen=True)
class _Obstacle:
    """What fingers must stay clear of: a part, or where there is none a half plane."""

    label: str
    direction: str
    """What the separating directions among a finger's unknowns are called; empty where there are none."""
    part: Part | None
    moves: bool = False
    """Whether it moves with the object."""
    normal: Array = field(default_factory=lambda: np.zeros(2))
    point: Array = field(default_factory=lambda: np.zeros(2))


class Surroundings:
    """Looks for what is near the fingers of one problem.

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
            count = points.shape[1] - finger.unit.probes * finger.spec.elements
            self._elements.append(elements[:count])
            self._touches.append(np.array(touches))
            curvatures = finger.unit.curvatures_at_places(finger.q, finger.u, finger.p)
            out += [points[:, :count], curvatures, finger.p[: finger.spec.elements], finger.base]
        self._places = ca.Function("places", [x, numbers], out)

    def look(self, scene: GraspScene, x: Array, numbers: Array) -> Sight:
        """Look at a point of the search.

        Parameters
        ----------
        scene : GraspScene
        x, numbers : ndarray
            Unknowns and run-time numbers; what a look finds does not matter in them.
        """
        units = Units.of(scene)
        pose, *rest = (np.array(v) for v in self._places(x, numbers))
        pose, variables = pose.ravel(), self._problem.parts.variables
        given = tuple(float(x[variables[f"relaxed clearance at the {name}"].start]) for name in ("supports", "object"))
        found: Values = {}
        directions: Values = {}
        deepest = -np.inf
        for k, setup in enumerate(scene.setups):
            seen = self._along(scene, setup, k, rest[4 * k : 4 * k + 4], pose, units, given)
            found |= seen.numbers
            directions |= seen.directions
            deepest = max(deepest, seen.deepest)
        self._pegs(scene, pose, units, found, directions)
        return Sight(found, directions, deepest)

    def _along(
        self,
        scene: GraspScene,
        setup: FingerSetup,
        index: int,
        values: list[Array],
        pose: Array,
        units: Units,
        given: tuple[float, ...],
    ) -> Sight:
        """Look along one finger; supports and object may be ``given`` deep in it."""
        finger, name = self._problem.fingers[index], setup.name
        points, curvatures, lengths, base = values
        line = _Line(finger, curvatures, lengths.ravel(), base.ravel(), setup, units)
        obstacles = _obstacles(scene)

        def look(at: Array, owner: Array) -> list[tuple[Nearest, Array]]:
            return [_look(obstacle, setup, base.ravel(), at, owner, pose, units) for obstacle in obstacles]

        even = np.tile(np.arange(FINE + 1) / FINE, (finger.spec.elements, 1))
        spare = [given[obstacle.moves] for obstacle in obstacles]
        depth = np.max([needed - s[1] - r for (s, needed), r in zip(look(*line.at(even)), spare, strict=True)], axis=0)
        probes = _deepest(depth.reshape(-1, FINE + 1), finger.unit.probes)
        at, owner = line.at(probes)
        looked = look(np.concatenate([points.T, at]), np.concatenate([self._elements[index], owner]).astype(int))
        free = ~self._touches[index]
        found: Values = {f"{name}.probes": probes.ravel()}
        directions: Values = {}
        deepest, planes = -np.inf, 0
        for obstacle, ((direction, gap, corners), needed), slack in zip(obstacles, looked, spare, strict=True):
            retained = free if obstacle.moves else np.ones(len(gap), dtype=bool)
            deepest = max(deepest, float((needed - gap)[retained].max()) - slack)
            if obstacle.direction:
                directions[f"{name}.{obstacle.direction}"] = direction[retained]
            if obstacle.moves:
                found |= {f"{name}.corners_{obstacle.label}_{j}": row for j, row in enumerate(corners)}
            elif obstacle.part is None:
                found |= {f"{name}.needed_{planes}_{j}": value for j, value in enumerate(needed)}
                planes += 1
        return Sight(found, directions, deepest)

    def _pegs(self, scene: GraspScene, pose: Array, units: Units, found: Values, directions: Values) -> None:
        """Parts of the object near the round supports, where its pose is sought."""
        if not self._problem.spec.free:
            return
        for i, peg in enumerate(scene.pegs):
            local = _local(np.asarray(peg.position)[None] / units.length, pose)
            for k, part in enumerate(scene.object.parts):
                direction, _, corners = _nearest(part, local, units)
                directions[f"peg_{i}.separating_{k}"] = direction
                found[f"peg_{i}.corners_{k}"] = corners[0]


def _obstacles(scene: GraspScene) -> list[_Obstacle]:
    found = [_Obstacle(f"{k}", f"separating_{k}", part, moves=True) for k, part in enumerate(scene.object.parts)]
    planes = [wall for wall in scene.walls if np.isinf(wall.half_length)]
    edges = [wall for wall in scene.walls if np.isfinite(wall.half_length)]
    for wall in planes:
        found.append(_Obstacle(wall.name, "", None, normal=np.asarray(wall.normal), point=np.asarray(wall.point)))
    found += [_Obstacle(edge.name, f"beside_{k}", OffsetPolygon(edge.ends)) for k, edge in enumerate(edges)]
    return found + [_Obstacle(peg.name, "", OffsetPolygon((peg.position,), peg.radius)) for peg in scene.pegs]


def _look(
    obstacle: _Obstacle, setup: FingerSetup, base: Array, at: Array, owner: Array, pose: Array, units: Units
) -> tuple[Nearest, Array]:
    """What is nearest, and the gaps that are needed (K,)."""
    half = setup.finger.thickness_radius / units.length
    needed = np.full(len(at), half)
    if obstacle.part is not None:
        return _nearest(obstacle.part, _local(at, pose) if obstacle.moves else at, units), needed
    point = obstacle.point / units.length
    height = float((base[:2] - point) @ obstacle.normal)
    # A base within a support is no penetration: the finger comes out of it, up to its first contact.
    if height < CLEAR * half:
        needed[owner < setup.before[0]] = min(0.0, height)
    return (np.zeros(len(at)), (at - point) @ obstacle.normal, np.zeros((len(at), 2 * CORNERS))), needed


class _Line:
    """The backbone of a finger at a point of the search."""

    def __init__(
        self, finger: FingerState, curvatures: Array, lengths: Array, base: Array, setup: FingerSetup, units: Units
    ) -> None:
        self._ends = np.concatenate([[0.0], np.cumsum(lengths)])
        self._lengths, self._base = lengths, base
        self._scale = setup.finger.rod.length / units.length
        family = finger.unit.model.structure.family
        places = family.places if family.degree else np.array([0.0, 1.0])
        knots = self._ends[:-1, None] + lengths[:, None] * places
        values = np.broadcast_to(curvatures.T, knots.shape)
        if family.continuous:
            self._knots, self._curvatures = (np.append(v[:, :-1], v[-1, -1]) for v in (knots, values))
        else:
            self._knots, self._curvatures = knots.ravel(), values.ravel()

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


def _nearest(part: Part, points: Array, units: Units) -> Nearest:
    """What of a part is nearest to points of its frame (K, 2), in units of the problem."""
    at, surface = points * units.length, surface_of(part)
    direction, gap = surface.nearest_places(part, at)
    return direction, gap / units.length, surface.near_corners(part, at) / units.length
