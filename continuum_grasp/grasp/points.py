"""Between the unknowns of a grasp problem and physical numbers."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.obstacles import nearest_obstacles
from continuum_grasp.grasp.limits import guarded
from continuum_grasp.grasp.problem import FingerState, GraspProblem
from continuum_grasp.grasp.starts import FingerStart, Start
from continuum_grasp.grasp.surface import Feature
from continuum_grasp.grasp.values import Units
from continuum_grasp.scene.grasp import FingerSetup, GraspScene
from continuum_grasp.scene.objects import Part

__all__ = ["PointReader", "starting_point"]

Array = NDArray[Any]
Values = dict[str, Any]

BACKBONE_POINTS = 201
CLEAR = 1.0 - 1e-9
"""Part of the half thickness from which on a base counts as clear of a support."""


def starting_point(problem: GraspProblem, scene: GraspScene, start: Start, features: dict[str, Feature]) -> Array:
    """Unknowns for a start."""
    units = Units.of(scene)
    x, y, turn = start.object_pose
    values: Values = {"object pose": [x / units.length, y / units.length, turn], "friction margin": 0.1}
    for setup, state in zip(scene.setups, problem.fingers, strict=True):
        values |= _finger_start(setup, state, start.fingers[setup.name], units)
    force = max(scene.weight / units.force, 1.0)
    lift = force / max(len(problem.contacts), 1)
    values["greatest normal force"] = force
    for contact in problem.make.contacts:
        at = start.contacts[contact.name]
        part = scene.object.parts[at.part]
        values[f"place, {contact.name}"] = features[contact.name].place(part, at.point, at.normal_angle)
        spatial = problem.make.gravity == "out_of_plane"
        values[f"force, {contact.name}"] = [force, 0.0, lift if scene.weight else 0.0] if spatial else [force, 0.0]
    return problem.parts.pack(values, 0.0)


def _finger_start(setup: FingerSetup, state: FingerState, start: FingerStart, units: Units) -> Values:
    name, finger, length = setup.name, setup.finger, setup.finger.rod.length
    joints = [s / length for s in start.joints]
    lengths = np.array(state.unit.element_lengths(joints))
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    nodes = np.interp(ends * length, start.knots, start.curvatures) * length
    q = {"arc": 0.5 * lengths * (nodes[1:] + nodes[:-1]), "clothoid": nodes, "matched_clothoid": nodes[:-1]}
    moment = float(nodes[-1]) - finger.curvature_pieces[0][2] * length
    tendons = finger.tendons
    least = 0.0 if tendons is None else tendons.min_tension * tendons.offset * length / finger.rod.stiffness
    pulls = [least + max(moment, 0.1), least] if moment >= 0.0 else [least, least - min(moment, -0.1)]
    x, y, turn = start.base
    values: Values = {
        f"{name}.q": q[setup.family],
        f"{name}.pulls": pulls,
        f"{name}.base": [x / units.length, y / units.length, turn],
    }
    return values | {f"{name}.joint_{k}": s for k, s in enumerate(joints)}


class PointReader:
    """Turns unknowns into the numbers that a result stores, and into the obstacles nearest to the fingers.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self._problem = problem
        self._guarded = [guarded(finger) for finger in problem.fingers]
        self._places, self._values = _places(problem, self._guarded), _values(problem)

    def obstacles(self, scene: GraspScene, x: Array, numbers: Array) -> tuple[Values, float]:
        """Run-time numbers of all obstacles near a point, and the deepest penetration there (problem's units)."""
        units = Units.of(scene)
        found, deepest = self._object_obstacles(scene, x, numbers, units), -np.inf
        *points, pose = (np.array(v) for v in self._places(x, numbers))
        turn = pose[2, 0]
        rotate = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        for setup, places, at in zip(scene.setups, self._guarded, points, strict=True):
            half = setup.finger.thickness_radius / units.length
            local = (at.T - pose[:2, 0]) @ rotate
            for k, part in enumerate(scene.object.parts):
                obstacle, gap = scaled_obstacles(part, local, units.length)
                deepest = max(deepest, float((half - gap).max()))
                for j in range(len(places)):
                    found[f"{setup.name}.obstacle_{k}_{j}"] = obstacle[j]
            deepest = max(deepest, self._support_obstacles(scene, setup, places, at.T, units, found))
        return found, deepest

    def _support_obstacles(
        self, scene: GraspScene, setup: FingerSetup, places: list[tuple[int, float]], at: Array, units: Units, found: Values
    ) -> float:
        m, half = units.length, setup.finger.thickness_radius
        base, deepest = setup.finger.base.position, -np.inf
        planes = [wall for wall in scene.walls if np.isinf(wall.half_length)]
        lines = [wall for wall in scene.walls if np.isfinite(wall.half_length)]
        for k, support in enumerate([*planes, *lines, *scene.pegs]):
            needed = np.full(len(places), half / m)
            if k < len(planes):
                wall = planes[k]
                normal, point = np.asarray(wall.normal), np.asarray(wall.point) / m
                obstacle = np.tile([0.0, *normal, *point, 0.0], (len(places), 1))
                gap = (at - point) @ normal
                height = wall.height(base)
                if height < CLEAR * half and setup.finger.base_free is None:  # the finger comes out of it
                    before = np.array([element < setup.before[0] for element, _ in places])
                    needed[before] = min(0.0, height) / m
            elif k < len(planes) + len(lines):
                wall = lines[k - len(planes)]
                along = wall.half_length * np.array([-wall.normal[1], wall.normal[0]])
                a, b = np.asarray(wall.point) - along, np.asarray(wall.point) + along
                obstacle, gap = scaled_obstacles(Part((tuple(a), tuple(b))), at, m)
            else:
                peg = scene.pegs[k - len(planes) - len(lines)]
                obstacle, gap = scaled_obstacles(Part((peg.position,), peg.radius), at, m)
            deepest = max(deepest, float((needed - gap).max()))
            for j in range(len(places)):
                found[f"{setup.name}.support_{k}_{j}"] = obstacle[j]
                found[f"{setup.name}.needed_{k}_{j}"] = needed[j]
        return deepest

    def _object_obstacles(self, scene: GraspScene, x: Array, numbers: Array, units: Units) -> Values:
        """Parts of the object near the round supports, where its pose is sought."""
        found: Values = {}
        if not self._problem.make.free or not scene.pegs:
            return found
        pose = np.array(self._places(x, numbers)[-1]).ravel()
        c, s = np.cos(pose[2]), np.sin(pose[2])
        for i, peg in enumerate(scene.pegs):
            off = np.asarray(peg.position) / units.length - pose[:2]
            local = np.array([[c * off[0] + s * off[1], c * off[1] - s * off[0]]])
            for k, part in enumerate(scene.object.parts):
                found[f"peg_{i}.obstacle_{k}"] = scaled_obstacles(part, local, units.length)[0][0]
        return found

    def arrays(self, scene: GraspScene, start: Start, x: Array, numbers: Array) -> dict[str, Array]:
        """The physical numbers of a point; see `continuum_grasp.grasp.GraspResult`."""
        units, make = Units.of(scene), self._problem.make
        pose, points, normals, forces, stations, *rest = (np.array(v) for v in self._values(x, numbers))
        m = units.length
        out: dict[str, Array] = {"object.pose": pose.ravel() * [m, m, 1.0]}
        lengths = {}
        for k, setup in enumerate(scene.setups):
            q, shares, tip, pulls, base, line = rest[6 * k : 6 * k + 6]
            name, finger, length = setup.name, setup.finger, setup.finger.rod.length
            lengths[k] = length
            offset = 1.0 if finger.tendons is None else finger.tendons.offset
            out |= {
                f"{name}.family": np.array(setup.family),
                f"{name}.q": q.ravel() / (1.0 if setup.family == "arc" else length),
                f"{name}.lengths": shares.ravel() * length,
                f"{name}.tip_curvature": np.array(float(tip.ravel()[0]) / length),
                f"{name}.tensions": pulls.ravel() * finger.rod.stiffness / length / offset,
                f"{name}.base": base.ravel() * [m, m, 1.0],
                f"{name}.backbone": line.T * [length, m, m, 1.0],
            }
        scale = [lengths.get(contact.finger, np.nan) for contact in make.contacts]
        return out | {
            "contact_names": np.array([contact.name for contact in make.contacts]),
            "contact_positions": points.T * m,
            "contact_normals": normals.T,
            "contact_forces": forces.T * units.force,
            "contact_stations": stations.ravel() * scale,
            "contact_parts": np.array([start.contacts[contact.name].part for contact in make.contacts], dtype=int),
        }


def scaled_obstacles(part: Part, points: Array, length: float) -> tuple[Array, Array]:
    """`nearest_obstacles` in units of a problem whose length is given [m]."""
    obstacle, gap = nearest_obstacles(part, points * length)
    obstacle[:, 3:] /= length
    return obstacle, gap / length


def _places(problem: GraspProblem, places: list[list[tuple[int, float]]]) -> ca.Function:
    found = []
    for finger, at in zip(problem.fingers, places, strict=True):
        inner = finger.world(finger.unit.model.waypoints(finger.q, finger.u, finger.p))
        ends = [finger.ends[:, k] for k, _ in at[len(finger.unit.waypoint_shares) :]]
        found.append(ca.horzcat(inner, *ends))
    return ca.Function("places", [problem.parts.x, problem.numbers.symbol], [*found, problem.pose])


def _values(problem: GraspProblem) -> ca.Function:
    x, numbers = problem.parts.x, problem.numbers.symbol
    touched, count = problem.contacts, len(problem.contacts)
    stations = [
        ca.SX(0) if c.make.finger < 0 else ca.SX(1) if c.make.joint < 0 else problem.fingers[c.make.finger].joints[c.make.joint]
        for c in touched
    ]
    at = [ca.horzcat(*v) if count else ca.SX(k, 0) for v, k in (
        ([c.point for c in touched], 2), ([c.normal for c in touched], 2), ([c.force for c in touched], 3)
    )]
    plain: list[Any] = [problem.pose, *at, ca.vertcat(*stations)]
    for finger in problem.fingers:
        lengths = finger.p[: finger.make.elements]
        plain += [finger.q, lengths, finger.unit.tip_curvature(finger.q, finger.u, finger.p), finger.pulls, finger.base]
    read = ca.Function("read", [x, numbers], plain)
    mx, mp = ca.MX.sym("x", x.numel()), ca.MX.sym("p", numbers.numel())
    values = list(read(mx, mp))
    out = values[:5]
    s = ca.SX.sym("s")
    along = ca.DM(np.linspace(0.0, 1.0, BACKBONE_POINTS)).T
    for k, finger in enumerate(problem.fingers):
        model = finger.unit.model
        point = finger.world(model.position(finger.q, finger.u, s, finger.p))
        angle = model.orientation(finger.q, finger.u, s, finger.p) + finger.base[2]
        place = ca.Function("place", [s, x, numbers], [ca.vertcat(s, point, angle)])
        line = place.map(BACKBONE_POINTS, [False, True, True], [False])(along, mx, mp)
        out += [*values[5 + 5 * k : 10 + 5 * k], line]
    return ca.Function("values", [mx, mp], out)
