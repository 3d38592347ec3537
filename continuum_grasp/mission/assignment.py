"""From a grasp to what a controller has to know and do."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.errors import InputError, Interrupted, SolverError
from continuum_grasp.grasp import optimize_grasp
from continuum_grasp.grasp.result import FingerPosture, GraspResult
from continuum_grasp.model import System
from continuum_grasp.scene.control import ControlScene
from continuum_grasp.scene.controller import Controller
from continuum_grasp.scene.cost import Cost, ForceWeight, Reference, Weight
from continuum_grasp.scene.families import default_family
from continuum_grasp.scene.finger import BasePose, Finger
from continuum_grasp.scene.mission import MissionScene
from continuum_grasp.scene.objects import GraspObject
from continuum_grasp.scene.simulate import Fidelity, Initial

Array = NDArray[np.float64]

_LARGEST = 5.0
"""Multiple of a wrench beyond which nothing is pulled with: what presses the object on a support is resisted anyhow."""
_CLEARANCE = 0.003
"""Distance from the object at which the approach ends [m]."""
_MARGIN = 1.5
"""Greatest curvature per that of the free finger under the greatest tension."""
_DENSE = 60
"""Places along the finger whose distance is looked at."""
_STEPS = 200
"""Moments that are tried."""


@dataclass(frozen=True)
class Assignment:
    """What is to be done.

    Attributes
    ----------
    mission : MissionScene
    grasp : GraspResult
        The grasp that is carried out.
    control : ControlScene
        Finger, object and controller of all phases.
    tensions : (2,) ndarray
        Of the grasp [N].
    before : (2,) ndarray
        With which the finger is about to touch [N].
    rest : (2,) ndarray
        Least tensions [N].
    bends : (N,) ndarray
        Bending angles of the controller's elements when it is about to touch [rad].
    posture : (N,) ndarray
        Bending angles of the same elements in the grasp [rad].
    force : float
        Normal force of the grasp at the contact where it is held [N].
    pulls : (K, 3) ndarray
        Wrenches that are pulled with: world force x, y [N] and moment about the center of mass [N m].
    """

    mission: MissionScene
    grasp: GraspResult
    control: ControlScene
    tensions: Array
    before: Array
    rest: Array
    bends: Array
    posture: Array
    force: float
    pulls: Array


def assign(mission: MissionScene, grasp: GraspResult | None = None) -> Assignment:
    """Optimize the grasp of a mission and say what its controller has to do.

    Parameters
    ----------
    grasp : GraspResult, optional
        The grasp, where it has been found already.

    Raises
    ------
    SolverError
        If there is no verified grasp.
    InputError
        If the grasp is not one that a mission can carry out.
    """
    found = optimize_grasp(mission.grasp) if grasp is None else grasp
    if grasp is None and found.statistics["interrupted"]:
        raise Interrupted("interrupted while the grasp was optimized")
    if not found.solved:
        raise SolverError("no grasp to carry out", status=found.status.value, advice=found.advice, result=found)
    (name, posture), *_ = found.fingers.items()
    contacts = {contact.name: contact for contact in found.contacts}
    touching = [contacts.get(f"{name}.middle"), contacts.get(f"{name}.tip")]
    if any(contact is None for contact in touching):
        raise InputError("a mission needs a middle contact and one of the tip", key="grasp.contacts")
    held = touching[0 if mission.controller.held == "middle" else 1]
    middle, force = (touching[0].station, held.normal_force) if touching[0] and held else (0.0, 0.0)
    finger = _finger(mission, posture.base)
    control = _control_scene(mission, finger, _object(mission, found), middle, force)
    resistance = found.quality.resistance if found.quality is not None else None
    if finger.tendons is None or resistance is None:
        raise InputError("a mission needs tendons, and disturbances that the grasp resists", key="grasp")
    tensions = np.array(posture.tensions)
    side = 1.0 if tensions[0] >= tensions[1] else -1.0
    moment = side * _about_to_touch(control, side)
    rest = np.full(2, finger.tendons.min_tension)
    pull = np.array([max(moment, 0.0), max(-moment, 0.0)]) / finger.tendons.offset
    factors = np.minimum(np.asarray(resistance.factors), _LARGEST)
    return Assignment(
        mission=mission,
        grasp=found,
        control=control,
        tensions=tensions,
        before=rest + pull,
        rest=rest,
        bends=moment / finger.rod.stiffness * np.asarray(control.fidelity.elements),
        posture=_posture(posture, np.asarray(control.fidelity.elements)),
        force=force,
        pulls=mission.pull_share * factors[:, None] * np.asarray(resistance.wrenches),
    )


def _finger(mission: MissionScene, base: Array) -> Finger:
    """The finger of the grasp, as placed by it, with the whole range of its drive."""
    given = mission.grasp.setups[0].finger
    placed = given.replaced(base=BasePose(position=(float(base[0]), float(base[1])), angle=float(base[2])))
    if mission.drive_tension is None or given.tendons is None:
        return placed
    return placed.replaced(tendons=given.tendons.replaced(max_tension=mission.drive_tension))


def _posture(found: FingerPosture, lengths: Array) -> Array:
    """Bending angles in the grasp of elements of other lengths [rad]."""
    at, angle = found.backbone[:, 0], np.unwrap(found.backbone[:, 3])
    edges = np.concatenate([[0.0], np.cumsum(lengths)])
    return np.diff(np.interp(edges, at, angle))


def _object(mission: MissionScene, grasp: GraspResult) -> GraspObject:
    x, y, angle = (float(v) for v in grasp.object_pose)
    return mission.grasp.object.replaced(position=(x, y), angle=angle, free=None)


def _control_scene(
    mission: MissionScene, finger: Finger, body: GraspObject, middle: float, force: float
) -> ControlScene:
    asked = mission.controller
    before, after = asked.elements
    beyond = finger.rod.length - middle
    lengths = (*[middle / before] * before, *[beyond / after] * after)
    cost = Cost(
        bending=Weight(running=asked.posture),
        contact_force=ForceWeight(running=asked.force, of=(asked.contact,)),
        speed=Weight(running=asked.speed) if asked.speed else None,
        effort=asked.effort,
        input_rate=asked.input_rate,
    )
    return ControlScene(
        schema_version=1,
        name=mission.name,
        finger=finger,
        gravity=(0.0, 0.0),
        contacts=(middle,),
        object=body,
        contact_law=mission.contact_law.replaced(friction=0.0),
        fidelity=Fidelity(
            family=default_family(free_tip=False), elements=lengths, bending_range=_reach(finger, lengths)
        ),
        parameters=("bending_stiffness",) if mission.estimator.disturbances.bending_stiffness is not None else (),
        controller=Controller(
            period=asked.period,
            horizon=asked.horizon,
            cost=cost,
            input=asked.input,
            bounds=asked.bounds,
            deadline=asked.deadline,
        ),
        reference=Reference(contact_force=(force,)),
        estimator=mission.estimator,
        initial=Initial(pose="straight"),
        plant=mission.plant,
    )


def _reach(finger: Finger, lengths: tuple[float, ...]) -> float:
    """Bending range of an element that the greatest tension and some contact force do not exceed [rad]."""
    tendons = finger.tendons
    most = 0.0 if tendons is None else tendons.max_tension * tendons.offset / finger.rod.stiffness
    return min(max(lengths) * min(_MARGIN * most, finger.curvature_limit), 20.0)


def _about_to_touch(control: ControlScene, side: float) -> float:
    """Size of the tip moment at which the free finger comes close to the object [N m]."""
    finger, body = control.finger, control.object
    if body is None or finger.tendons is None:
        return 0.0
    system = System(finger, gravity=(0.0, 0.0), family=default_family(free_tip=True), elements=1, tip_force=False)
    family = system.finger_model.structure.family
    where = system.sections(tuple(np.linspace(0.0, finger.rod.length, _DENSE + 1)[1:]))
    most = (finger.tendons.max_tension - finger.tendons.min_tension) * finger.tendons.offset
    reached = 0.0
    for moment in np.linspace(0.0, most, _STEPS + 1):
        kappa = side * moment / finger.rod.stiffness
        shape = family.coordinates(np.array([kappa * finger.rod.length]), np.full((1, family.degree + 1), kappa))
        points = np.array(where(system.state(q=shape), [0.0, 0.0], [])[0]).T
        gap = min(body.distance((float(x), float(y))) for x, y in points) - finger.thickness_radius
        if gap < _CLEARANCE:
            break
        reached = float(moment)
    return reached
