"""What becomes of a grasp when its object is not as it should be: the posture at given tensions, and its reserve.

The tensions are those of the grasp, or are changed as little as holds. An object that touches a support stays where it
lies; others yield to the fingers. A finger that touches along its length slides on the object as it closes, so that its
contacts settle anew; a tip that comes straight onto an object that yields stays where it lands: at the place next to
where it is in the grasp, seen from the object in error. Of all postures that balance, that is taken whose contacts are
farthest from slipping.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from continuum_grasp.grasp.problem.solver_run import Attempt, GraspSolverRun, solver_for
from continuum_grasp.grasp.problem.structure import ProblemSpec
from continuum_grasp.grasp.problem.values import Units
from continuum_grasp.grasp.robust.errors import InError
from continuum_grasp.grasp.starts.supports import support_contacts
from continuum_grasp.grasp.starts.values import Start, start_from
from continuum_grasp.nlp import Budget, Status
from continuum_grasp.scene.grasp import GraspScene

Array = NDArray[Any]

HOLDS = -1e-4
"""Least reserve, per force reference, with which all contacts hold: the places at which fingers are looked at for
clearance change it by up to 4e-5 (mug)."""
ITERATIONS = 150
"""Iterations for one error: 6 to 25 are enough with given tensions, 30 to 90 with others (mug, pinch)."""


@dataclass(frozen=True)
class Response:
    """The posture for one error.

    Attributes
    ----------
    error : ndarray, shape (6,)
        See `continuum_grasp.grasp.robust.errors`.
    scene : GraspScene
        With that error.
    reserve : float
        By how much all friction cones could be narrower, per force reference [1]; minus infinity where no posture was
        found.
    margin : float
        Least friction margin [1]; minus infinity where a contact parts or no posture balances, NaN where the solver has
        no answer.
    weakest : str
        The contact with that margin; empty where nothing balances.
    arrays : mapping
        As those of a grasp.
    """

    error: Array
    scene: GraspScene
    reserve: float
    margin: float
    weakest: str
    arrays: Mapping[str, Array]
    start: Start
    attempt: Attempt

    @property
    def holds(self) -> bool:
        """Whether all contacts hold."""
        return self.reserve >= HOLDS


class Responder:
    """Finds the postures of a grasp with errors.

    Parameters
    ----------
    scene : GraspScene
    arrays : mapping
        Of the grasp, as a result holds them.
    budget : Budget
    """

    def __init__(self, scene: GraspScene, arrays: Mapping[str, Any], budget: Budget) -> None:
        self.scene, self.arrays, self._budget = scene, dict(arrays), budget
        self.in_error = InError(scene, arrays)
        names = [str(name) for name in arrays["contact_names"]]
        forces = dict(zip(names, map(tuple, arrays["contact_forces"].tolist()), strict=True))
        tensions = {name: tuple(arrays[f"{name}.tensions"].tolist()) for name in scene.named_fingers}
        self.start = replace(start_from(scene, self.arrays), forces=forces, tensions=tensions)
        self.yields = not self.in_error.on
        spec = ProblemSpec.of(scene, self.start.contacts).in_error(landed=self.yields)
        self.solver: GraspSolverRun = solver_for(spec)

    def to(self, error: Array, *, retensioned: Response | None = None) -> Response:
        """The response to an error (6,), with the tensions of the grasp, or with such that hold if there are any: then
        ``retensioned`` is that with the tensions of the grasp, from which they are sought.
        """
        scene = self.in_error.scene_with(error, yields=self.yields)
        start = self._start(scene, 1.0 + float(error[3]))
        pinned = self.landings(error)
        if not self.yields and scene.object.free is not None:
            # What the supports decide follows from their contacts.
            pose = np.array(Units.of(scene).pose(scene.object.pose))
            pinned["object pose"] = np.where(np.isin(range(3), self.in_error.left), pose, np.nan)
        units, problem = Units.of(scene), self.solver.problem
        for setup in scene.setups:
            if retensioned is None:
                scale = setup.tendons.offset * setup.finger.rod.length / setup.stiffness
                pinned[f"{setup.name}.pulls"] = scale * np.asarray(start.tensions[setup.name])
            if setup.finger.base_free is not None:
                pinned[f"{setup.name}.base"] = np.array(units.pose(start.fingers[setup.name].base))
        attempt = self.solver.run(
            scene,
            start,
            self._budget,
            rung=2,
            iterations=ITERATIONS,
            pinned=pinned,
            # More than what holds is not asked for: the tensions change as little as they can.
            most={} if retensioned is None else {"reserve": 0.0},
            x0=None if retensioned is None or not retensioned.attempt.converged else retensioned.attempt.x.copy(),
        )
        arrays = self.solver.arrays(scene, attempt)
        reserve, margin, weakest = -np.inf, np.nan, ""
        if attempt.converged:
            reserve = float(attempt.x[problem.x.at["reserve"]][0])
            margin, weakest = least_margin(scene, arrays)
            if reserve >= HOLDS:  # a cone at its edge, up to rounding
                margin = max(margin, 0.0)
        elif attempt.status is Status.INFEASIBLE:
            margin = -np.inf
        return Response(error, scene, reserve, margin, weakest, arrays, start, attempt)

    def _start(self, scene: GraspScene, size: float) -> Start:
        """The grasp as a start for an object of another size that lies elsewhere."""
        contacts = {
            name: replace(contact, point=(size * contact.point[0], size * contact.point[1]))
            for name, contact in self.start.contacts.items()
        }
        contacts |= support_contacts(scene, scene.object.pose, self.in_error.on)
        contacts = {name: contacts[name] for name in self.start.contacts}
        return replace(self.start, object_pose=scene.object.pose, contacts=contacts)

    def landings(self, error: Array) -> dict[str, Array]:
        """Where tips land on an object that yields (2,), in its frame and in units of the problem."""
        pose = np.array(self.in_error.pose_in_error(error)) - self.in_error.pose
        units, problem = Units.of(self.scene), self.solver.problem
        back, turned = (_rotation(-angle) for angle in (self.in_error.pose[2], pose[2]))
        return {
            f"landing, {contact.name}": turned
            @ (np.asarray(self.start.contacts[contact.name].point) - back @ pose[:2])
            / units.length
            for contact in problem.spec.contacts
            if problem.spec.lands(contact)
        }


def least_margin(scene: GraspScene, arrays: Mapping[str, Any]) -> tuple[float, str]:
    """Least friction margin of a grasp, and the contact that has it."""
    found = []
    for name, (n, f, lift) in zip(arrays["contact_names"], arrays["contact_forces"], strict=True):
        most = scene.friction(str(name)) * n
        if n < 0.0 or scene.friction(str(name)) > 0.0:
            found.append((1.0 - float(np.hypot(f, lift)) / most if most > 0.0 else -np.inf, str(name)))
    return min(found, default=(1.0, ""))


def _rotation(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])
