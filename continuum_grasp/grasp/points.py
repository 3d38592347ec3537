"""Between the scaled unknowns of a grasp problem and physical numbers."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.problem import GraspProblem
from continuum_grasp.grasp.seeds import Seed
from continuum_grasp.scene.grasp import GraspGravity, OutOfPlaneGravity, PlanarGravity

__all__ = ["PointReader", "starting_point"]

Array = NDArray[Any]

BACKBONE_POINTS = 201


def starting_point(problem: GraspProblem, seed: Seed) -> Array:
    """Scaled unknowns for a starting shape."""
    lengths = np.array(problem.element_lengths(seed.middle))
    nodes = seed.nodes(lengths)
    q = {"arc": seed.bends(lengths), "clothoid": nodes, "matched_clothoid": nodes[:-1]}[problem.model.family]
    least, offset = problem.tendons.min_tension, problem.tendons.offset
    moment = max(abs(seed.curvatures[2] * problem.finger.rod.stiffness), problem.moment_scale)
    pulled = least + moment / offset
    weight = problem.scene.object.mass * _gravity(problem.scene.gravity)
    values: dict[str, Any] = {
        "bending": q,
        "middle contact position": seed.middle,
        "tensions": (pulled, least) if seed.curvatures[2] >= 0 else (least, pulled),
        "tip contact angle": _tip_direction(problem, nodes, lengths),
    }
    for name in problem.names:
        values[f"normal force, {name}"] = max(weight, problem.force_scale)
        values[f"lift, {name}"] = weight / len(problem.names)
    x = np.zeros(int(problem.parts.x.numel()))
    for name, variable in problem.parts.variables.items():
        x[variable.start : variable.stop] = np.asarray(values.get(name, 0.0)) / variable.scale
    low, high = problem.parts.x_bounds
    return np.clip(x, low, high)


def _gravity(gravity: GraspGravity) -> float:
    """Acceleration of gravity [m/s2]."""
    if isinstance(gravity, PlanarGravity):
        return float(np.hypot(*gravity.vector))
    return gravity.magnitude if isinstance(gravity, OutOfPlaneGravity) else 0.0


def _tip_direction(problem: GraspProblem, nodes: Array, lengths: Array) -> float:
    """World angle from the object to the tip of a starting shape [rad]."""
    point, angle = np.array(problem.finger.base.position), problem.finger.base.angle
    for k, h in enumerate(lengths):
        s = (np.arange(200) + 0.5) / 200
        turn = angle + h * s * (nodes[k] + 0.5 * (nodes[k + 1] - nodes[k]) * s)
        point = point + h * np.array([-np.sin(turn).mean(), np.cos(turn).mean()])
        angle += 0.5 * h * (nodes[k] + nodes[k + 1])
    off = point - np.asarray(problem.scene.object.position)
    return float(np.arctan2(off[1], off[0]))


class PointReader:
    """Turns scaled unknowns into the numbers that a result stores.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self._problem = problem
        parts, contacts = problem.parts, problem.contacts
        s = ca.SX.sym("s")
        angle = problem.model.orientation(problem.q, problem.u, s, problem.lengths)
        place = ca.Function("place", [s, parts.x], [ca.vertcat(s, problem.position(s), angle)])
        x = ca.MX.sym("x", parts.x.numel())
        stations = np.linspace(0.0, problem.length, BACKBONE_POINTS)
        line = ca.horzcat(*(place(float(at), x) for at in stations))
        values = [
            problem.q,
            problem.lengths,
            problem.curvatures[-1],
            problem.tensions,
            ca.horzcat(*(c.normal for c in contacts)),
            ca.horzcat(*(c.force for c in contacts)),
        ]
        read = ca.Function("values", [parts.x], values)
        self._function = ca.Function("reader", [x], [line, *read(x)])

    def arrays(self, x: Array) -> dict[str, Array]:
        """The physical numbers of a point; see `continuum_grasp.grasp.GraspResult`."""
        line, q, lengths, tip, tensions, normals, forces = (np.array(v) for v in self._function(x))
        thing = self._problem.scene.object
        return {
            "family": np.array(self._problem.model.family),
            "q": q.ravel(),
            "lengths": lengths.ravel(),
            "tip_curvature": np.array(float(tip.ravel()[0])),
            "tensions": tensions.ravel(),
            "contact_names": np.array(self._problem.names),
            "contact_positions": np.asarray(thing.position) + thing.radius * normals.T,
            "contact_normals": normals.T,
            "contact_forces": forces.T,
            "backbone": line.T,
        }
