"""Between the unknowns of a grasp problem and physical numbers."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.problem.problem import GraspProblem
from continuum_grasp.grasp.problem.unknowns import FingerState
from continuum_grasp.grasp.problem.values import Units
from continuum_grasp.grasp.starts.scan.curves import curvature_at, turning
from continuum_grasp.grasp.starts.values import Start
from continuum_grasp.model.surfaces.surface import Feature
from continuum_grasp.scene.grasp import FingerSetup, GraspScene

Array = NDArray[Any]
Values = dict[str, Any]

BACKBONE_POINTS = 201
"""Points of a stored backbone: 0.5 % of the length apart, for pictures; the certificate integrates its own."""
PRESSED = 1e-2
"""Least normal force of a contact to start with, as a part of the weight."""


def starting_point(problem: GraspProblem, scene: GraspScene, start: Start, features: dict[str, Feature]) -> Array:
    """Unknowns for a start."""
    units = Units.of(scene)
    x, y, turn = start.object_pose
    values: Values = {"object pose": [x / units.length, y / units.length, turn], "friction margin": 0.1}
    for setup, state in zip(scene.setups, problem.fingers, strict=True):
        values |= _finger_start(setup, state, start, units)
    force = max(scene.weight / units.force, 1.0)
    lift = force / max(len(problem.contacts), 1)
    values["greatest normal force"] = force
    for contact in problem.spec.contacts:
        at = start.contacts[contact.name]
        part, feature = scene.object.parts[at.part], features[contact.name]
        values[f"place, {contact.name}"] = contact.surface.place(part, feature, at.point, at.normal_angle)
        pressed = (force, 0.0, lift if scene.weight else 0.0)
        if contact.name in start.forces:
            n, f, carried = (component / units.force for component in start.forces[contact.name])
            pressed = max(n, PRESSED * force), f, carried
        values[f"force, {contact.name}"] = pressed if problem.spec.gravity == "out_of_plane" else pressed[:2]
    return problem.parts.pack(values, 0.0)


def _finger_start(setup: FingerSetup, state: FingerState, whole: Start, units: Units) -> Values:
    name, finger, length = setup.name, setup.finger, setup.finger.rod.length
    start = whole.fingers[name]
    joints = [s / length for s in start.joints]
    lengths = np.array(state.unit.element_lengths(joints))
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    knots, curvatures = np.array([start.knots]) / length, np.array([start.curvatures]) * length
    model = state.unit.model
    family = model.structure.family
    places = ends[:-1, None] + lengths[:, None] * family.places
    at = curvature_at(knots, curvatures, places.reshape(1, -1)).reshape(places.shape)
    bends = np.diff(turning(knots, curvatures, ends[None])[0])
    moment = float(curvature_at(knots, curvatures, ends[None, -1:])[0, 0]) - finger.curvature_pieces[0][2] * length
    tendons = setup.tendons
    least = tendons.min_tension * tendons.offset * length / finger.rod.stiffness
    pulls = [least + max(moment, 0.1), least] if moment >= 0.0 else [least, least - min(moment, -0.1)]
    if name in whole.tensions:
        pulls = [t * tendons.offset * length / finger.rod.stiffness for t in whole.tensions[name]]
    x, y, turn = start.base
    values: Values = {
        f"{name}.q": family.coordinates(bends, at)[: model.n],
        f"{name}.pulls": pulls,
        f"{name}.base": [x / units.length, y / units.length, turn],
    }
    return values | {f"{name}.joint_{k}": s for k, s in enumerate(joints)}


class PointReader:
    """Turns unknowns into the numbers that a result stores.

    Parameters
    ----------
    problem : GraspProblem
    """

    def __init__(self, problem: GraspProblem) -> None:
        self._problem = problem
        self._values = _values(problem)

    def arrays(self, scene: GraspScene, start: Start, x: Array, numbers: Array) -> dict[str, Array]:
        """The physical numbers of a point; see `continuum_grasp.grasp.GraspResult`."""
        units, spec = Units.of(scene), self._problem.spec
        pose, points, normals, forces, stations, *rest = (np.array(v) for v in self._values(x, numbers))
        m = units.length
        out: dict[str, Array] = {"object.pose": pose.ravel() * [m, m, 1.0]}
        lengths = {}
        for k, setup in enumerate(scene.setups):
            q, shares, tip, pulls, base, line = rest[6 * k : 6 * k + 6]
            name, finger, length = setup.name, setup.finger, setup.finger.rod.length
            lengths[k] = length
            family, elements = self._problem.fingers[k].unit.model.structure.family, shares.ravel() * length
            out |= {
                f"{name}.family": np.array(setup.family),
                f"{name}.q": family.coordinate_size(q.ravel(), length),
                f"{name}.lengths": elements,
                f"{name}.curvature_shapes": family.curvature_shapes(elements.tolist()),
                f"{name}.tip_curvature": np.array(float(tip.ravel()[0]) / length),
                f"{name}.tensions": pulls.ravel() * finger.rod.stiffness / length / setup.tendons.offset,
                f"{name}.base": base.ravel() * [m, m, 1.0],
                f"{name}.backbone": line.T * [length, m, m, 1.0],
            }
        scale = [lengths.get(contact.finger, np.nan) for contact in spec.contacts]
        return out | {
            "contact_names": np.array([contact.name for contact in spec.contacts]),
            "contact_positions": points.T * m,
            "contact_normals": normals.T,
            "contact_forces": forces.T * units.force,
            "contact_stations": stations.ravel() * scale,
            "contact_parts": np.array([start.contacts[contact.name].part for contact in spec.contacts], dtype=int),
        }


def _values(problem: GraspProblem) -> ca.Function:
    x, numbers = problem.parts.x, problem.numbers.symbol
    touched, count = problem.contacts, len(problem.contacts)
    stations = [
        ca.SX(0)
        if c.spec.finger < 0
        else ca.SX(1)
        if c.spec.joint < 0
        else problem.fingers[c.spec.finger].joints[c.spec.joint]
        for c in touched
    ]
    at = [
        ca.horzcat(*v) if count else ca.SX(k, 0)
        for v, k in (([c.point for c in touched], 2), ([c.normal for c in touched], 2), ([c.force for c in touched], 3))
    ]
    plain: list[Any] = [problem.pose, *at, ca.vertcat(*stations)]
    for finger in problem.fingers:
        lengths = finger.p[: finger.spec.elements]
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
